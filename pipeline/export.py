"""Stage `export`: an index, its model and its robot -> data/retargeter, which stands by itself."""

from dataclasses import Field, asdict, fields, make_dataclass
from pathlib import Path
from typing import Any

from pipeline.stage import bar, knob, launch, read
from s3le.learn.table import index
from s3le.retarget import exported
from s3le.retarget.settings import Settings
from s3le.robot.robot import Robot
from s3le.store import tables

ROBOT = Path("data/robot")
DATA = Path("data")
OUT = Path("data/retargeter")
INDEX = {"s3le": "s3le", "lwl2": "lwl2", "skeleton": "skeleton_all"}  # method -> entry of index


def _knob(setting: Field) -> Any:
    """A setting as a parameter; its range stands in s3le/retarget/settings.py."""
    least, most = setting.metadata.get("range", (0.0, 0.0))
    return knob(setting.metadata["doc"], at_least=least, at_most=most)


Params = make_dataclass(
    "Params",
    [
        ("method", str, knob("what proposes poses", one_of=exported.METHODS)),
        *((s.name, s.type, _knob(s)) for s in fields(Settings) if s.metadata),
    ],
    frozen=True,
    kw_only=True,
    namespace={"section": "export", "__doc__": "How the exported retargeter works."},
)


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
