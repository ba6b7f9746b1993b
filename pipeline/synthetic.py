"""Stage `synthetic`: the paper's example without a robot -> data/synthetic.parquet, errors."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import knob, launch, read, say, steps_bar
from s3le.store import documents, tables
from s3le.study import synthetic
from s3le.study.tables import SYNTHETIC

OUT = Path("data/synthetic.parquet")
COUNTS = Path("data/counts/synthetic.json")


@dataclass(frozen=True, kw_only=True)
class Params:
    """Numbers of the experiment."""

    section: ClassVar[str] = "synthetic"
    seed: int = knob("of the first training", at_least=0)
    seeds: int = knob("trainings of each variant", at_least=1, at_most=1000)
    points: int = knob("of Relaxed X, and of Feasible Y", at_least=1, at_most=10_000_000)
    glue: int = knob("pairs", at_least=1, at_most=1_000_000)
    glue_side: float = knob("side of the square they lie in", at_least=1e-9, at_most=2)
    steps: int = knob("optimiser steps", at_least=1)
    batch: int = knob("points a step", at_least=1)
    latent: int = knob("dimension of Z", at_least=1, at_most=4096)
    hidden: int = knob("units of a hidden layer", at_least=1, at_most=8192)
    layers: int = knob("hidden layers", at_least=1, at_most=16)
    first_gain: float = knob("of the first layers' weights", at_least=1e-3, at_most=100)
    learning_rate: float = knob("of encoders and decoders", at_least=1e-9, at_most=1)
    adversary_rate: float = knob("of the discriminators", at_least=1e-9, at_most=1)
    beta: float = knob("weight of latent prior fitting [-]", at_least=0)
    tau: float = knob("temperature of NT-Xent [-]", at_least=1e-6)
    weight_consensus: float = knob("weight of the latent consensus", at_least=0)
    weight_nt_xent: float = knob("weight of NT-Xent", at_least=0)
    grid: int = knob("test points along each side of Relaxed X", at_least=3, at_most=1001)


def main() -> None:
    """Learn the map with and without NT-Xent, several seeds each, and measure both."""
    settings = synthetic.Settings(**asdict(read(Params)))
    with steps_bar(settings.steps, "synthetic example") as on_step:
        outcomes = synthetic.run(settings, on_step)
    figures = synthetic.figures(outcomes)
    tables.write(synthetic.columns(outcomes, figures["shown"]), SYNTHETIC, OUT)
    documents.write_json(figures, COUNTS)
    for words in ("without", "with"):
        found = figures[f"{words}_nt_xent"]["error_invariant"]
        say(f"{words} NT-Xent: {found['mean']:.3f} off where the projection is many-to-one")


if __name__ == "__main__":
    launch(main, "synthetic")
