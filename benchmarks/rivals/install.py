"""Makes the environments of the rivals from requirements-rivals.lock.

One below .venv-rivals for each heading of the file. An environment that stands and was made of the
same lines is left as it is; PIP_ARGS in the environment is passed to pip.
"""

import os
import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LOCK, FOLDER = ROOT / "requirements-rivals.lock", ROOT / ".venv-rivals"


def sections(text: str) -> dict[str, str]:
    """Lines of a lock file by heading.

    Raises:
        SystemExit: a requirement stands before the first heading.
    """
    found: dict[str, str] = {}
    name = ""
    for line in text.splitlines():
        line = line.partition("#")[0].strip()
        if line.startswith("["):
            name = line.strip("[]")
            found[name] = ""
        elif line and not name:
            raise SystemExit(f"{LOCK.name}: '{line}' stands under no heading")
        elif line:
            found[name] += line + "\n"
    return found


def python(name: str) -> Path:
    """The interpreter of an environment."""
    return FOLDER / name / "bin/python"


def main() -> None:
    """Make what is missing.

    Raises:
        SystemExit: an environment could not be set up; the others were.
    """
    wrong = []
    for name, lines in sections(LOCK.read_text(encoding="utf-8")).items():
        made = FOLDER / name / "made-of.txt"
        if made.is_file() and made.read_text(encoding="utf-8") == lines:
            continue
        print(f"setting up {FOLDER.name}/{name}", flush=True)
        subprocess.run([sys.executable, "-m", "venv", "--clear", FOLDER / name], check=True)
        listed = FOLDER / name / "requirements.txt"
        listed.write_text(lines, encoding="utf-8")
        more = shlex.split(os.environ.get("PIP_ARGS", ""))
        pip = [python(name), "-m", "pip", "install", "-q", *more]
        # What torch needs beside it differs from machine to machine.
        torch = [line for line in lines.split() if line.startswith("torch==")]
        commands = [[*pip, *torch]] if torch else []
        commands.append([*pip, "--no-deps", "-r", listed])
        if any(subprocess.run(command, check=False).returncode for command in commands):
            python(name).unlink()  # so that nobody takes it for whole
            wrong.append(f"{FOLDER.name}/{name}")
        else:
            made.write_text(lines, encoding="utf-8")
    if wrong:
        raise SystemExit(f"not set up: {', '.join(wrong)}; their entrants count as not installed")


if __name__ == "__main__":
    main()
