"""What was measured or drawn outside a run and lies in the repository: read, and held to account.

Wall times are no part of a result, so a run does not measure them; `reports/latency.json` is
written on purpose (benchmarks/online.py --record) and says on which machine and robot.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from s3le.errors import TableError
from s3le.report import cells

FORMAT = 1
_LARGEST = 2**20  # [bytes]
_WORDS = ("machine", "date", "robot", "robot_tag", "method")
_COUNTS = ("threads", "joints", "pairs", "frames")
_TIMES = ("us_p50", "us_p99", "us_worst")


class Figure(NamedTuple):
    """What is said about a picture that was made elsewhere."""

    title: str
    caption: str
    numbers: list[tuple[str, str]]


def latency(path: Path) -> dict[str, Any]:
    """Read a record of times.

    Args:
        path: JSON with "format" 1, the words "machine", "date", "robot", "robot_tag", "method",
            the counts "threads", "joints", "pairs", "frames", "check" (does coal check every
            pose), "settings" (name to value), "modes" (name to share of frames) and "rows": each a
            "part" with its "calls" and the times "us_p50", "us_p99", "us_worst" [us].

    Raises:
        TableError: missing, not JSON, or not such a record; says how to write it.
    """
    again = "write it with: python benchmarks/online.py --record"
    tree = _object(path, again)
    checked(tree, f"{path}: ", f"; {again}")
    return tree


def checked(tree: Mapping[str, Any], where: str = "", again: str = "") -> None:
    """Refuse what is no record of times (latency).

    Raises:
        TableError: names what is missing or wrong.
    """

    def wrong(what: str) -> TableError:
        return TableError(f"{where}{what}{again}")

    if tree.get("format") != FORMAT:
        raise wrong(f"format must be {FORMAT}, got {tree.get('format')!r}")
    for name in _WORDS:
        if not isinstance(tree.get(name), str):
            raise wrong(f"'{name}' must be text, got {tree.get(name)!r}")
    for name in _COUNTS:
        if type(tree.get(name)) is not int or tree[name] < 0:
            raise wrong(f"'{name}' must be a count, got {tree.get(name)!r}")
    if type(tree.get("check")) is not bool:
        raise wrong(f"'check' must be true or false, got {tree.get('check')!r}")
    for name in ("settings", "modes"):
        if not isinstance(tree.get(name), dict):
            raise wrong(f"'{name}' must be an object, got {tree.get(name)!r}")
    rows = tree.get("rows")
    if not isinstance(rows, list) or not rows:
        raise wrong("'rows' must be a list of parts, each with its times")
    for row in rows:
        if not isinstance(row, dict) or not isinstance(row.get("part"), str):
            raise wrong(f"a row must name its 'part', got {row!r}")
        given = [row.get(name) for name in _TIMES]
        times = [time for time in given if cells.is_number(time)]
        if len(times) < len(given) or not 0 <= times[0] <= times[1]:
            raise wrong(f"times of '{row['part']}' must be numbers that rise, got {given!r}")
        if not times[1] <= times[2] or type(row.get("calls")) is not int:
            raise wrong(f"'{row['part']}' must have rising times and a count of 'calls'")


def figure(path: Path) -> Figure:
    """Read what is said about a picture.

    Args:
        path: JSON with "title" and "caption", texts; any further numbers, words or lists of them,
            also in objects, are shown beside the picture by their names.

    Raises:
        TableError: missing, not JSON, or without title or caption.
    """
    again = "write it together with its picture"
    tree = _object(path, again)
    for name in ("title", "caption"):
        if not isinstance(tree.get(name), str) or not tree[name].strip():
            raise TableError(f"{path}: '{name}' must be text, got {tree.get(name)!r}; {again}")
    rest = {key: value for key, value in tree.items() if key not in ("title", "caption")}
    return Figure(tree["title"], tree["caption"], _flat(rest))


def _flat(tree: Mapping[str, Any], above: str = "") -> list[tuple[str, str]]:
    found = []
    for key, value in tree.items():
        name = key if key == "numbers" and not above else f"{above}{key}".replace("_", " ")
        if isinstance(value, dict):
            found += _flat(value, "" if name == "numbers" else f"{name}: ")
        elif isinstance(value, list):
            found.append((name, ", ".join(_plain(one) for one in value)))
        else:
            found.append((name, _plain(value)))
    return found


def _plain(value: object) -> str:
    if isinstance(value, float):
        return cells.plain(value)
    return cells.count(value) if type(value) is int else cells.text(value)


def _object(path: Path, again: str) -> dict[str, Any]:
    try:
        with Path(path).open("rb") as stream:
            data = stream.read(_LARGEST + 1)
    except FileNotFoundError:
        raise TableError(f"{path} is missing; {again}") from None
    except OSError as error:
        raise TableError(f"{path} cannot be read ({error.strerror}); {again}") from None
    if len(data) > _LARGEST:
        raise TableError(f"{path} is larger than {_LARGEST >> 10} KiB; {again}")
    try:
        tree = json.loads(data.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise TableError(f"{path} is not JSON ({error}); {again}") from None
    if not isinstance(tree, dict):
        raise TableError(f"{path} holds no JSON object; {again}")
    return tree
