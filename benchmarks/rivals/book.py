"""The page, the table and the printed lines that a record of rivals becomes."""

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import changes
from jinja2 import Environment, FileSystemLoader, StrictUndefined

import s3le.report
from s3le.report import embed
from s3le.show import style, svg

HERE = Path(__file__).resolve().parent
NONE = "–"
OURS = style.colour("certified_refined")
Row = Mapping[str, Any]


def figure(key: str, digits: int = 1, scale: float = 1.0, unit: str = "") -> Callable[[Row], str]:
    """Writes a number of a row, with its interval where it has one."""

    def write(row: Row) -> str:
        value = row.get(key)
        if not isinstance(value, Mapping):
            return NONE if value is None else f"{scale * value:,.{digits}f}{unit}"
        if value["value"] is None:
            return NONE
        shown = f"{scale * value['value']:,.{digits}f}{unit}"
        if value["low"] is None:
            return shown
        return f"{shown} [{scale * value['low']:,.{digits}f}, {scale * value['high']:,.{digits}f}]"

    return write


def _share(key: str) -> Callable[[Row], str]:
    return figure(key, 1, 100.0, " %")


def _degrees(row: Row) -> str:
    if row.get("repair_refused"):
        return f"{row['repair_refused']} of {row['motions']} refused: {row['repair_why']}"
    if row.get("repair_deg") is None:
        return "nothing"
    return ", ".join(f"{v:.1f}" for v in row["repair_deg"])


def _same(row: Row) -> str:
    return {True: "yes", False: "no"}.get(row.get("same"), NONE)


def _times(row: Row) -> str:
    if row.get("us_p50") is None:
        return NONE
    return ", ".join(f"{row[k] / 1e3:,.2f}" for k in ("us_p50", "us_p99", "us_p999"))


TABLES: dict[str, tuple[tuple[str, Callable[[Row], str]], ...]] = {
    "How near to the human": (
        ("frames", figure("frames", 0)),
        ("mean angle of a bone [°]", figure("angle")), ("p95 [°]", figure("angle_p95")),
        ("trunk", figure("trunk")), ("shoulders", figure("shoulders")),
        ("upper arms", figure("upper arms")), ("forearms", figure("forearms")),
        ("trunk over 10° off", _share("trunk_off")), ("cosine distance", figure("far", 4)),
        ("lag [ms]", figure("lag_ms", 0)),
        ("its base leans by [°]", figure("lean")), ("angle with that [°]", figure("angle_beside")),
    ),
    "What is broken": (
        ("poses broken", _share("poses_broken")), ("paths broken", _share("paths_broken")),
        ("paths unproven", _share("paths_unproven")), ("deepest [mm]", figure("depth_mm")),
        ("poses under the margin", _share("poses_near")),
        ("poses in which hulls of meshes overlap", _share("hull_poses")),
        ("paths on which they do", _share("hull_paths")),
        ("deepest of these [mm]", figure("hull_depth_mm")),
    ),
    "How it moves": (
        ("rows outside joint limits", _share("outside")), ("steps too fast", _share("fast")),
        ("fastest, of the limit", figure("fastest", 2, unit=" x")),
        ("too hard", _share("hard")), ("acceleration p99 [rad/s²]", figure("acceleration_p99", 0)),
        ("jerk p99 [rad/s³]", figure("jerk_p99", 0)),
        ("frames held", _share("held")), ("frames without a solution", _share("failed")),
    ),
    "What it costs": (
        ("ms a frame: p50, p99, p99.9", _times), ("first motion [s]", figure("first_s")),
        ("installed [MB]", figure("size_mb", 0)), ("motions never made", lambda r: str(
            r["clips"] - r["motions"])), ("the same to the bit", _same),
    ),
    "Repaired by s3le guard": (
        ("frames moved", _share("repair_moved")),
        ("of these: median, p95, most [°]", _degrees),
        ("left broken", figure("repair_left", 0)),
    ),
}  # fmt: skip


def rows(record: Row) -> list[dict[str, Any]]:
    """Flat rows for CSV: intervals as columns of their own."""
    keys: dict[str, None] = {}
    flat = []
    for row in record["rows"]:
        one: dict[str, Any] = {}
        for key, value in row.items():
            if isinstance(value, Mapping):
                one[key] = value["value"]
                one[f"{key}_low"], one[f"{key}_high"] = value["low"], value["high"]
            elif key == "repair_deg":
                names = ("repair_deg_p50", "repair_deg_p95", "repair_deg_most")
                one |= dict(zip(names, value or (None,) * 3, strict=True))
            else:
                one[key] = value
        keys |= dict.fromkeys(one)
        flat.append(one)
    return [{key: one.get(key) for key in keys} for one in flat]


def text(record: Row) -> str:
    """What is printed: one line a row."""
    lines = [
        f"{'':12}{'':9}{'':26}{'angle':>7}{'poses':>9}{'paths':>9}{'unproven':>9}{'fast':>8}"
        f"{'ms':>8}{'p99':>8}{'repair':>22}"
    ]
    for row in record["rows"]:
        where = f"{row['robot']:12}{'hard' if row['adversarial'] else 'clips':6}{row['protocol']}  "
        if not row["motions"]:
            lines.append(f"{where}{row['label']:26} no motion was made")
            continue
        share = "".join(
            f"{100 * (row[k]['value'] or 0.0):8.1f}%"
            for k in ("poses_broken", "paths_broken", "paths_unproven")
        )
        lines.append(
            f"{where}{row['label']:26}{row['angle']['value']:7.1f}{share}"
            f"{100 * (row['fast']['value'] or 0.0):7.1f}%{row['us_p50'] / 1e3:8.2f}"
            f"{row['us_p99'] / 1e3:8.2f}{_degrees(row):>22}"
        )
    return "\n".join(lines)


def page(record: Row) -> str:
    """The page: one file, no network, no program."""
    places = dict.fromkeys((r["robot"], r["protocol"], r["adversarial"]) for r in record["rows"])
    parts = []
    for robot, protocol, hard in places:
        mine = [
            r
            for r in record["rows"]
            if (r["robot"], r["protocol"], r["adversarial"]) == (robot, protocol, hard)
        ]
        made = [r for r in mine if r["motions"]]
        if not made:
            continue
        tables = []
        for title, columns in TABLES.items():
            kept = [c for c in columns if any(c[1](r) != NONE for r in made)]
            tables.append({
                "title": title, "heads": [name for name, _ in kept],
                "rows": [(r["label"], r["key"] in ("file", "stream"), [w(r) for _, w in kept])
                         for r in made],
            })  # fmt: skip
        parts.append({
            "id": f"{robot}-{protocol}{'-hard' if hard else ''}", "robot": robot,
            "protocol": protocol, "hard": hard, "tables": tables,
            "clips": made[0]["clips"], "frames": max(r["frames"] for r in made),
            "lost": [r["label"] for r in mine if not r["motions"]],
            "drawing": _drawing(made, f"{robot}-{protocol}-{'hard' if hard else 'clips'}"),
        })  # fmt: skip
    environment = Environment(
        loader=FileSystemLoader([HERE, Path(s3le.report.__file__).parent]), autoescape=True,
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    twins = {svg.variable(old): new for old, new in svg.DARK.items()}
    return environment.get_template("page.html.j2").render(
        parts=parts, about=record["about"], data_set=record.get("data_set"), twins=twins,
        changes=changes.paragraph(record), losses=changes.losses(record), checks=_checks(record),
        costs=_costs(record),
    )  # fmt: skip


def _costs(record: Row) -> list[str]:
    """What limits of acceleration do to rivals that can be asked for them."""
    words = (("angle", "°", "angle"), ("hard", " %", "too hard"), ("broken", " %", "broken"),
             ("unsolved", " %", "without a solution"))  # fmt: skip
    return [
        f"{label} on {robot}: "
        + ", ".join(f"{name} {a[key]:.1f} to {b[key]:.1f}{unit}" for key, unit, name in words)
        for label, robots in record["about"].get("accelerations", {}).items()
        for robot, (a, b) in robots.items()
    ]


def _checks(record: Row) -> dict[str, int]:
    """What the judges said of each other, in all rows."""
    names = ("poses_denied", "proven_probed", "proven_broken", "hpp_heard", "hpp_refused")
    return {name: sum(row.get(name, 0) for row in record["rows"]) for name in names}


def _drawing(made: list[Row], name: str) -> Any:
    """Angle to the human against the share of paths broken, one point an entrant."""
    with tempfile.TemporaryDirectory() as folder, style.sheet():
        drawn = style.figure(7.6, 0.34 * len(made) + 1.1)
        left, right = drawn.subplots(1, 2, sharey=True)
        for axes, key, scale in ((left, "angle", 1.0), (right, "paths_broken", 100.0)):
            for i, row in enumerate(made):
                value = row[key]
                colour = OURS if row["key"] in ("file", "stream") else style.INK
                if value["value"] is None:
                    continue
                if value["low"] is not None:
                    ends = [scale * value["low"], scale * value["high"]]
                    axes.plot(ends, [i, i], color=colour, linewidth=1.2)
                axes.plot(scale * value["value"], i, "o", color=colour, markersize=4.5)
            axes.set_xlim(left=0.0)
            axes.grid(axis="x")
        left.set_yticks(range(len(made)), [row["label"] for row in made])
        left.set_ylim(len(made) - 0.5, -0.5)
        left.set_xlabel("mean angle of a bone to the human's [°]")
        right.set_xlabel("paths broken [%]")
        drawn.subplots_adjust(
            left=0.27, right=0.98, top=0.97, bottom=0.55 / (0.34 * len(made) + 1.1)
        )
        path = Path(folder) / "drawn.svg"
        style.save(drawn, path)
        return embed.read(path).element(name)
