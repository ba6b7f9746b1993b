"""What a training adds to the product: the exported retargeter beside one without a training.

    python benchmarks/untrained.py [--folder data/retargeter] [--clips FOLDER]

Both plan the same motions as files, within the same limits. *Look-up*: the nearest of the poses
proposed; *wanted*: that pose refined, before limits in time and proofs; *certified*: where the
robot gets. Distances are to the human; times are a whole frame's, one thread, of this machine.
Without --clips the frames are the test frames of data/skeletons.parquet.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from tuple_cost import one_core

from s3le.human import splits
from s3le.human.chosen import chosen
from s3le.human.skeletons import read_frames
from s3le.human.tables import SKELETONS
from s3le.kernels import batch
from s3le.retarget.follow import follow
from s3le.retarget.stored import retargeter_for
from s3le.retarget.stream import Retargeter
from s3le.skeleton import cosine_distance
from s3le.store import tables


def main(
    folder: Annotated[Path, typer.Option(help="exported retargeter")] = Path("data/retargeter"),
    clips: Annotated[Path | None, typer.Option(help="folder of motion files")] = None,
    skeletons: Annotated[Path, typer.Option(help="frames")] = Path("data/skeletons.parquet"),
) -> None:
    """Print the table."""
    trained = Retargeter.load(folder)
    motions = _motions(trained.robot.neck, clips, skeletons)
    frames = sum(len(x) for x, _ in motions)
    print(
        f"{trained.robot.name}, {len(motions)} motions, {frames} frames; distance to the human\n"
        f"{'':34}{'poses':>9}{'look-up':>9}{'wanted':>9}{'certified':>11}{'p99':>8}"
        f"{'us, median':>12}{'us, p99':>9}"
    )
    with one_core():
        _say("trained, the exported retargeter", trained, motions)
        _say("no training, skeletons searched", retargeter_for(trained.robot), motions)


def _motions(neck: str, clips: Path | None, skeletons: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Skeletons (n, 21) and times [s] of each motion, 30 rows a second."""
    if clips is not None:
        found = [read_frames(path, neck, rate=30.0) for path in chosen([clips])]
        return [(one.x, one.time) for one in found]
    table = tables.read(SKELETONS, skeletons)
    rows = splits.test_rows(table)
    cuts = 1 + np.flatnonzero(table["clip"][rows][1:] != table["clip"][rows][:-1])
    return [(table["x"][own], table["time"][own]) for own in np.split(rows, cuts)]


def _say(name: str, it: Retargeter, motions: list[tuple[np.ndarray, np.ndarray]]) -> None:
    chain, look_up, wanted, far, seconds = it.robot.chain, [], [], [], []
    stored = getattr(it._proposer, "_poses", None)
    for x, times in motions:
        seen = it.robot.seen(x)
        for row in seen:
            shown = batch.skeletons(chain, it.propose(row))
            look_up.append(cosine_distance(shown, row[None], it.robot.followed).min())
        made = follow(it, seen, times)
        wanted.append(made.wanted)
        far.append(cosine_distance(batch.skeletons(chain, made.q), seen, it.robot.followed))
        seconds.append(made.seconds[1:])
    each, distance = np.concatenate(seconds) * 1e6, np.concatenate(far)
    print(
        f"{name:34}{'-' if stored is None else len(stored):>9}{np.mean(look_up):9.4f}"
        f"{np.nanmean(np.concatenate(wanted)):9.4f}{distance.mean():11.4f}"
        f"{np.quantile(distance, 0.99):8.3f}{np.median(each):12.0f}{np.quantile(each, 0.99):9.0f}",
        flush=True,
    )


if __name__ == "__main__":
    typer.run(main)
