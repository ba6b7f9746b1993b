"""dvc whose stages are forked from one process, so that Python and imports start once.

    python forked.py repro [...]

All else is dvc's own: what runs, in which order, with which environment, and what is written down.
Most of the time of a tiny stage is its imports; stages by themselves are run in test_disasters.
"""

import importlib
import os
import re
import runpy
import sys
import traceback
from pathlib import Path

COMMAND = re.compile(r"(cd \.\./\.\. && )?python -m pipeline\.(\w+)(?: ([\w@]+))?")


def run(executable: str, cmd: str, cwd: str, env: dict[str, str], **_: object) -> None:
    """Stands for dvc.stage.run._run."""
    from dvc.stage.exceptions import StageCmdFailedError

    up, name, item = COMMAND.fullmatch(cmd).groups()
    sys.stdout.flush(), sys.stderr.flush()
    child = os.fork()
    if not child:
        os.environ.clear(), os.environ.update(env)
        os.chdir(Path(cwd, "../..") if up else cwd)
        os._exit(stage(name, [item] if item else []))
    if failed := os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]):
        raise StageCmdFailedError(cmd, failed)


def stage(name: str, words: list[str]) -> int:
    """Run a stage as the program that it is; its exit status."""
    sys.argv = [name, *words]
    try:
        runpy.run_module(f"pipeline.{name}", run_name="__main__", alter_sys=True)
    except SystemExit as end:
        return int(end.code or 0)
    except BaseException:
        traceback.print_exc()
        return 1
    finally:
        sys.stdout.flush(), sys.stderr.flush()
    return 0


def main() -> None:
    """Import what stages import, then let dvc run them."""
    import dvc.stage.run
    from dvc.cli import main as dvc_main

    for file in Path("pipeline").glob("[a-z]*.py"):
        importlib.import_module(f"pipeline.{file.stem}")
        if file.stem != "stage":  # a stage itself begins anew, as a program
            del sys.modules[f"pipeline.{file.stem}"]
    dvc.stage.run._run = run
    sys.exit(dvc_main(sys.argv[1:]))


if __name__ == "__main__":
    sys.path[0] = os.getcwd()
    main()
