"""Bytes that packages and all they require take when installed: python size.py NAME...

Runs in whatever environment is asked about, so it reads the standard library alone.
"""

import re
import sys
from importlib.metadata import PackageNotFoundError, distribution


def closure(names: list[str]) -> list:
    """Distributions of packages and of what they require, extras left out."""
    seen, todo = {}, list(names)
    while todo:
        name = re.sub(r"[-_.]+", "-", todo.pop()).lower()
        if name in seen:
            continue
        try:
            seen[name] = distribution(name)
        except PackageNotFoundError:  # required on other systems, or already part of another
            continue
        for line in seen[name].requires or ():
            if "extra ==" not in line:
                todo.append(re.match(r"[A-Za-z0-9._-]+", line).group())
    return list(seen.values())


def main() -> None:
    """Print the sum."""
    total = 0
    for one in closure(sys.argv[1:]):
        for file in one.files or ():
            path = file.locate()
            total += path.stat().st_size if path.is_file() else 0
    print(total)


if __name__ == "__main__":
    main()
