"""`make paper`: run the pipeline by a profile, a list of parameters that differ from params.yaml.

    python benchmarks/study/by_profile.py paper [-S clips=cmu] [STAGE ...]

It is `dvc exp run` with the profile's keys, and what follows its name goes to that command too.
Back to the default: `git checkout params.yaml && dvc repro`, which finds its results in the cache.
"""

import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from ruamel.yaml import YAML

ROOT = Path(__file__).resolve().parents[2]
PROFILES = ROOT / "profiles"


def changes(name: str) -> dict[str, Any]:
    """A profile's keys, dotted, and their values.

    Raises:
        SystemExit: there is no such profile, or params.yaml lacks one of its keys.
    """
    path = PROFILES / f"{name}.yaml"
    if path.parent != PROFILES or not path.is_file():
        known = ", ".join(sorted(file.stem for file in PROFILES.glob("*.yaml")))
        raise SystemExit(f"no profile '{name}'; there are: {known}")
    yaml = YAML(typ="safe")
    found, params = yaml.load(path), yaml.load(ROOT / "params.yaml")
    for key in found:
        *section, own = key.split(".")
        if own not in (params.get(section[0], {}) if section else params):
            raise SystemExit(f"{path}: params.yaml has no {key}")
    return found


def overrides(changed: dict[str, Any]) -> list[str]:
    """The same as words for `dvc exp run`."""
    words = []
    for key, value in changed.items():
        told = str(value).lower() if isinstance(value, bool) else str(value)
        words += ["-S", f"{key}={told}"]
    return words


def main(
    context: typer.Context, name: Annotated[str, typer.Argument(help="of profiles/NAME.yaml")]
) -> None:
    """Run the whole pipeline by a profile."""
    changed = changes(name)
    words = [sys.executable, "-m", "dvc", "exp", "run", *overrides(changed), *context.args]
    done = subprocess.run(words, cwd=ROOT, check=False)
    if done.returncode:
        raise SystemExit(done.returncode)
    typer.echo(
        f"that was profile '{name}'; dvc metrics diff: against the last commit, in numbers;\n"
        "back: git checkout params.yaml && dvc repro"
    )


if __name__ == "__main__":
    app = typer.Typer(add_completion=False)
    app.command(context_settings={"allow_extra_args": True, "ignore_unknown_options": True})(main)
    app()
