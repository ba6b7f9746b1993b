"""Stage `export`: an index, its model and its robot -> data/retargeter, which stands by itself."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import bar, knob, launch, read
from s3le.learn.table import index
from s3le.retarget import exported
from s3le.retarget.settings import RANGES, Settings
from s3le.robot.robot import Robot
from s3le.store import tables

ROBOT = Path("data/robot")
DATA = Path("data")
OUT = Path("data/retargeter")
INDEX = {"s3le": "s3le", "lwl2": "lwl2", "skeleton": "skeleton_all"}  # method -> entry of index


def _number(name: str, doc: str) -> object:
    return knob(doc, at_least=RANGES[name][0], at_most=RANGES[name][1])


@dataclass(frozen=True, kw_only=True)
class Params:
    """How the exported retargeter works (s3le/retarget/settings.py)."""

    section: ClassVar[str] = "export"
    method: str = knob("what proposes poses", one_of=exported.METHODS)
    k: int = _number("k", "poses that the look-up proposes")
    iterations: int = _number("iterations", "most iterations of each solve")
    target: float = _number("target", "clearance that refinement aims at [m]")
    between: float = _number("between", "clearance kept between poses [m]")
    ridge: float = _number("ridge", "pull towards the pose that a solve starts at [-]")
    pull: float = _number("pull", "pull towards the pose wanted where it is out of reach [-]")
    toll: float = _number("toll", "what a pose farther off must gain [1/rad]")
    speed_factor: float = _number("speed_factor", "share of the joints' speeds that is used")
    brake: float = _number("brake", "most change of a joint's speed [rad/s^2]")
    cutoff: float = _number("cutoff", "of the filter of a human who stands still [Hz]")
    quickness: float = _number("quickness", "what the cutoff gains with speed [Hz per 1/s]")
    delay: bool = knob("answer one frame late")
    check: bool = knob("check every pose of a stream independently")


def main() -> None:
    """Write the folder."""
    chosen = asdict(read(Params))
    method = chosen.pop("method")
    it = Robot.read(ROBOT)
    rows, metric = None, "l2"
    if method in INDEX:
        name = INDEX[method]
        path = DATA / f"index-{name}.parquet"
        metric = tables.read_note(path, "metric", f"index@{name}")
        latent = int(tables.read_note(path, "latent", f"index@{name}"))
        rows = tables.read(index(it.n_dof, it.margin, latent), path, it.tag)
    model = None if method == "skeleton" else DATA / f"model-{method}.safetensors"
    with bar(len(rows["row"]) if rows else 0, "neighbours") as progress:
        exported.save(OUT, it, method, metric, Settings(**chosen), rows, model, progress)


if __name__ == "__main__":
    launch(main, "export")
