"""What `s3le robot list` prints: a table, and what no certificate of these robots speaks of.

To settle which pairs of a robot are watched takes up to a second, so what there is to say of the
robots of the package was written down when they were made (robots/listed.json) and is taken where
their files are those that it was written for.
"""

import hashlib
import json
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

from s3le.errors import S3leError
from s3le.robot import known

if TYPE_CHECKING:
    from s3le.robot.robot import Robot

RECORD = "listed.json"
_WIDTH = 100
_HEADS = ("robot", "joints", "bones", "bodies", "watched", "not covered", "made by", "licence")


def rows() -> list[dict[str, Any]]:
    """What is known of every robot; `unusable` with the reason of one that cannot be used."""
    held = json.loads((known.READY / RECORD).read_text(encoding="utf-8"))
    told = []
    for name, file in known.listed().items():
        row = {"name": name, "file": str(file), "made_by": known.origin(file) or None}
        try:
            told.append(row | _recorded(file, held.get(name)))
        except S3leError as refusal:
            told.append(row | {"unusable": str(refusal)})
    return told


def about(robot: "Robot") -> dict[str, Any]:
    """What there is to say of a robot, as JSON can hold it."""
    from s3le.safety import covered

    return {
        "digest": robot.digest,
        "joints": robot.joint_names,
        "bones": list(robot.vectors),
        "bodies": len(robot.bodies),
        "pairs_watched": len(robot.watched),
        "by_design": [f"{a} and {b}: {why}" for a, b, _, why in robot.by_design()],
        "not_covered": [f"{a} and {b}: {why}" for a, b, _, why in robot.unwatched()],
        "not_covered_links": covered.tree(robot),
    }


def fingerprint(file: Path) -> str:
    """SHA-256 of a robot file of the package and of the files that can belong to it."""
    whole = hashlib.sha256()
    beside = (file.parent / "urdf" / f"{file.stem}.{kind}" for kind in ("urdf", "srdf"))
    for path in (file, *beside):
        whole.update(path.name.encode() + (path.read_bytes() if path.is_file() else b""))
    return whole.hexdigest()


def _recorded(file: Path, held: dict[str, Any] | None) -> dict[str, Any]:
    """The record of a robot of the package whose files are as they were; else looked up."""
    if file.parent == known.READY and held and held["files"] == fingerprint(file):
        return {key: value for key, value in held.items() if key != "files"}
    from s3le.cli import shell

    return about(shell.robot(str(file)))


def lines(told: list[dict[str, Any]], by_name: bool) -> list[str]:
    """A table, with by_name what is not covered of each robot, then those that cannot be used."""
    good = [row for row in told if "unusable" not in row]
    cells = [_HEADS, *(_cells(row) for row in good)]
    wide = [max(len(row[k]) for row in cells) for k in range(len(_HEADS))]
    right = range(1, 6)  # numbers
    out = [
        "  ".join(word.rjust(n) if k in right else word.ljust(n)
                  for k, (word, n) in enumerate(zip(row, wide, strict=True))).rstrip()
        for row in cells
    ]  # fmt: skip
    out += [
        "", "not covered, so no certificate speaks of them: pairs of bodies that could meet and",
        "are not watched, and links that are drawn beyond their bodies",
    ]  # fmt: skip
    for row in good if by_name else ():
        parts = _bare(row) or ["nothing"]
        out += textwrap.wrap(
            f"{row['name']}: {'; '.join(parts)}", _WIDTH, initial_indent="  ",
            subsequent_indent="    ", break_on_hyphens=False, break_long_words=False,
        )  # fmt: skip
    out += [f"{row['name']}: cannot be used: {row['unusable']}"
            for row in told if "unusable" in row]  # fmt: skip
    more = "" if by_name else "s3le robot list --pairs names them; "
    return [*out, f"{more}s3le robot check NAME says all there is to know of one"]


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    made = row["made_by"]
    counts = (row["joints"], row["bones"])
    return (
        row["name"], *(str(len(each)) for each in counts), str(row["bodies"]),
        str(row["pairs_watched"]), _count(row),
        made["maker"] if made else "you", made["licence"] if made else "",
    )  # fmt: skip


def _count(row: dict[str, Any]) -> str:
    links = row["not_covered_links"]
    beyond = "links unknown" if links is None else f"{len(links)} links" if links else ""
    return f"{len(row['not_covered'])} pairs" + (f", {beyond}" if beyond else "")


def _bare(row: dict[str, Any]) -> list[str]:
    """What is not covered of a robot, in words: link by link, not body by body."""
    pairs = [tuple(end.rpartition("_")[0] for end in said.partition(": ")[0].split(" and "))
             for said in row["not_covered"]]  # fmt: skip
    found = [" and ".join(pair) for pair in dict.fromkeys(pairs)]
    drawn = row["not_covered_links"]
    if drawn is None:
        return [*found, "its drawing was never held against its bodies"]
    for link in drawn:
        reach = link["reach_m"]
        far = "not measured" if reach is None else f"{reach * 1e3:.0f} mm"
        found.append(f"{link['link']} drawn beyond its bodies ({far})")
    return found
