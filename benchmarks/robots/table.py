"""One table of all robots that come with the package: what each costs, how near, who else says so.

    python benchmarks/robots/table.py SOURCES [--only g1,h1] [--samples 3] [--jobs 2]

Six dances of CMU (--clips) are followed at 30 Hz within each robot's limits in time, as a stream
and planned as a whole, with poses made for it (nothing is trained). Then the convex hulls of what
its maker drew, taken from SOURCES (see make.py), are measured by coal and by MuJoCo at every row
and at --samples poses between any two, over every pair of links but neighbours, watched or not;
neither knows of capsules (hulls.py). The table is Markdown; nothing is asserted. What is done
stands below --state and is not done again while the robot, the code and the settings are the same.
Times are taken first and one after another; judged is in --jobs processes.
"""

import hashlib
import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Annotated, Any

import hulls
import numpy as np
import sources
import typer

from s3le.errors import S3leError
from s3le.human.skeletons import read_frames
from s3le.kernels import threads
from s3le.retarget import follow, stored
from s3le.robot.known import READY
from s3le.robot.robot import Robot
from s3le.store import documents

RATE = 30.0  # [Hz]
CLIPS = ("49_09", "49_10", "131_04", "05_02", "05_09", "05_18")
WAYS = ("stream", "file")
HEAD = (
    "| robot | joints, vectors | bodies, pairs | frame, median and p99 [us] | to the human, wanted "
    "| stream | file | hulls, pairs, poses | overlap as drawn | deeper or met, coal | by MuJoCo "
    "| of them certified |",
    "|---|---|---|---|---:|---:|---:|---|---|---|---|---|",
)


def main(
    folder: Annotated[Path, typer.Argument(metavar="SOURCES", help="folder of sources")],
    only: Annotated[str, typer.Option(help="these robots alone, with commas")] = "",
    clips: Annotated[Path, typer.Option(help="folder of CMU")] = Path("../shared/mocap/cmu"),
    names: Annotated[str, typer.Option(help="clips, with commas")] = ",".join(CLIPS),
    samples: Annotated[int, typer.Option(min=0, help="poses between two rows")] = 3,
    jobs: Annotated[int, typer.Option(min=1, help="processes that judge")] = 2,
    state: Annotated[Path, typer.Option(help="folder of what is done")] = Path("data/robots_table"),
) -> None:
    """Measure, judge, print."""
    wanted = [word for word in only.split(",") if word]
    robots = [name for name in wanted or ready() if wanted or name != "coman_authors"]
    files = [clips / name.split("_")[0] / f"{name}.amc.gz" for name in names.split(",")]
    state.mkdir(parents=True, exist_ok=True)
    for name in robots:
        move(name, files, state)
    with ProcessPoolExecutor(jobs) as pool:
        rows = pool.map(judged, robots, [folder] * len(robots), [samples] * len(robots),
                        [state] * len(robots))  # fmt: skip
        print("\n".join([*HEAD, *(line(row) for row in rows)]))


def ready() -> list[str]:
    """Names of the robots that come with the package."""
    return sorted(file.stem for file in READY.glob("*.yaml"))


def move(name: str, files: list[Path], state: Path) -> None:
    """Let a robot follow the clips, and keep the motions and what they cost."""
    robot = Robot.load(name)
    key = _key(stored.key(robot), *(str(file.name) for file in files))
    held = _held(state / f"{name}.json")
    if held.get("key") == key:
        return
    it = stored.retargeter_for(robot, streams=True)
    threads.use_threads(1)
    found = [read_frames(file, robot.neck, rate=RATE) for file in files]
    row: dict[str, Any] = {
        "key": key, "name": name, "joints": robot.n_dof, "vectors": len(robot.vectors),
        "bodies": len(robot.bodies), "pairs": len(robot.watched),
    }  # fmt: skip
    arrays = {}
    follow.follow(it, found[0].x[:30], found[0].time[:30], fps=RATE, look_ahead=False)
    for way in WAYS:
        made = [
            follow.follow(it, one.x, one.time, fps=RATE, look_ahead=way == "file") for one in found
        ]
        for i, one in enumerate(made):
            arrays |= {f"{way}/{i}/{k}": getattr(one, k) for k in ("time", "q", "v")}
        far, before, took = (
            np.concatenate([getattr(one, part) for one in made])
            for part in ("distance", "wanted", "seconds")
        )
        row |= {f"{way}_far": float(np.nanmean(far)), f"{way}_wanted": float(np.nanmean(before)),
                f"{way}_us": [float(1e6 * np.nanquantile(took, at)) for at in (0.5, 0.99)],
                "frames": len(far)}  # fmt: skip
    threads.use_threads(0)
    np.savez_compressed(state / f"{name}.npz", **arrays)
    documents.write_json(row, state / f"{name}.json")
    print(f"{name}: {row['frames']} frames, {row['stream_us'][0]:.0f} us", flush=True)


def judged(name: str, folder: Path, samples: int, state: Path) -> dict[str, Any]:
    """What both engines say of a robot's motions; the row with it."""
    file = state / f"{name}.json"
    row = _held(file)
    try:
        corners = _corners(name, folder)
    except S3leError as refusal:
        return row | {"unjudged": str(refusal)}
    robot = Robot.load(name)
    key = _key(row["key"], str(samples), Path(hulls.__file__).read_text(),
               *(f"{k} {v.tobytes().hex()}" for k, v in corners.items()))  # fmt: skip
    if row.get("judged") == key:
        return row
    made = hulls.Hulls(robot, corners)
    with np.load(state / f"{name}.npz") as arrays:
        q = np.concatenate([
            hulls.between(*(arrays[f"{at}/{k}"] for k in ("q", "v")),
                          np.diff(arrays[f"{at}/time"]), samples)
            for at in sorted({word.rpartition("/")[0] for word in arrays})
        ])  # fmt: skip
    row |= {"judged": key, "hulls": len(made.names), "hull_pairs": len(made.pairs),
            "poses": len(q)}  # fmt: skip
    found = {}
    for engine in (hulls.Coal(made), hulls.Mujoco(made)):
        found[engine.name] = verdict = hulls.judge(engine, q)
        bare = hulls.baseline(engine)
        row[engine.name] = {
            "drawn": _worst(made, bare, bare < 0.0),
            "deeper": _worst(made, verdict.least, verdict.deeper > 0),
            "poses": int(verdict.deeper.sum()),
            "least": float(verdict.least[bare >= 0.0].min(initial=hulls.FAR)),
        }
    apart = np.abs(found["coal"].least - found["mujoco"].least)
    row["differ"] = float(np.where(np.minimum(*(v.least for v in found.values())) > -SHALLOW,
                                   apart, 0.0).max(initial=0.0))  # fmt: skip
    met = np.flatnonzero(sum(verdict.deeper for verdict in found.values()))
    row["claimed"] = hulls.claimed(made, met)
    documents.write_json(row, file)
    return row


SHALLOW = 5e-3  # [m], where both engines' depths are good; deeper they are upper bounds


def _worst(made: hulls.Hulls, depth: np.ndarray, which: np.ndarray) -> dict[str, float]:
    """Pairs of links -> signed distance [m], the deepest of their pieces, deepest first."""
    rows = sorted(np.flatnonzero(which), key=lambda row: depth[row])
    found: dict[str, float] = {}
    for row in rows:
        found.setdefault(" and ".join(made.links(row)), float(depth[row]))
    return found


def line(row: dict[str, Any]) -> str:
    """A robot in the table."""
    words = [
        row["name"], f"{row['joints']}, {row['vectors']}", f"{row['bodies']}, {row['pairs']:,}",
        "{:.0f}, {:,.0f}".format(*row["stream_us"]), f"{row['stream_wanted']:.4f}",
        f"{row['stream_far']:.4f}", f"{row['file_far']:.4f}",
    ]  # fmt: skip
    if "unjudged" in row:
        words += [f"not judged: {row['unjudged']}", "", "", "", ""]
    else:
        words += [f"{row['hulls']}, {row['hull_pairs']:,}, {row['poses']:,}"]
        words += [_told(row["coal"]["drawn"])]
        words += [_told(row[name]["deeper"]) for name in ("coal", "mujoco")]
        words += [", ".join(row["claimed"]) or "none"]
    return "| " + " | ".join(words) + " |"


def _told(pairs: dict[str, float]) -> str:
    if not pairs:
        return "none"
    name, depth = next(iter(pairs.items()))
    return f"{len(pairs)}, at most {-1e3 * depth:.0f} mm ({name})"


def _corners(name: str, folder: Path) -> dict[str, np.ndarray]:
    if name not in [recipe.name for recipe in sources.recipes()]:
        raise S3leError("no recipe")
    return sources.drawn(sources.recipes([name])[0], folder)


def _held(file: Path) -> dict[str, Any]:
    return json.loads(file.read_text()) if file.is_file() else {}


def _key(*words: str) -> str:
    return hashlib.sha256("\0".join(words).encode()).hexdigest()[:16]


if __name__ == "__main__":
    typer.run(main)
