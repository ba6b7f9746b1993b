"""What a robot file will say, while it is being settled, and its text."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin

from s3le.onboard import limbs, strength
from s3le.robot import model
from s3le.robot.description import MAPPED


@dataclass
class Plan:
    """The parts of a robot file."""

    name: str
    points: Mapping[str, limbs.Point]
    base: np.ndarray
    joints: list[str]
    hold: dict[str, float]
    anchor: dict[str, float]
    velocity: dict[str, float]
    files: dict[str, bytes]
    notes: list[str] | None = None
    stand: dict[str, float] | None = None
    finer: Sequence[Sequence[str]] = ()
    baselines: bool = False
    acceleration: Mapping[str, float] = field(default_factory=dict)

    def load(self, folder: Path) -> model.Geometry:
        """The robot that the files so far describe, from a folder of their own."""
        (folder / "urdf").mkdir(exist_ok=True)
        for name, data in (self.files | {f"{self.name}.yaml": self.text().encode()}).items():
            (folder / name).write_bytes(data)
        return model.load(folder / f"{self.name}.yaml")

    def text(self) -> str:
        """The robot file."""
        rpy = ", ".join(repr(round(float(v), 9) + 0.0) for v in pin.rpy.matrixToRpy(self.base))
        lines = [
            *(f"# {note}" for note in self.notes or []),
            f"name: {self.name}",
            f"urdf: urdf/{self.name}.urdf",
        ]
        for key, suffix in (("srdf", "srdf"), ("hulls", "hulls.npz")):
            if f"urdf/{self.name}.{suffix}" in self.files:
                lines.append(f"{key}: urdf/{self.name}.{suffix}")
        lines += [
            "",
            "# Rotation (roll, pitch, yaw [rad]) from the base's frame to x forward, y left, z up.",
            f"base_rpy: [{rpy}]",
            "",
            "# What the skeleton is read from: joints, links or frames, with an offset [m] where",
            "# none is at the right place. `neck` is used with `neck: joint`, or with one arm.",
            "points:",
            *(f"  {role}: {_flow(self.points[role])}" for role in _roles(self.points)),
            "",
            "# Joints that move; every other one stands still at `hold` [rad], zero if not named.",
            f"joints: [{', '.join(map(_word, self.joints))}]",
            f"hold: {_flow(self.hold)}",
            "",
            "# A feasible pose, from which projection can always start [rad].",
            f"anchor: {_flow(self.anchor)}",
            "",
            *self._stands(),
            "# Limits [rad/s] that stand for the URDF's.",
            f"velocity: {_flow(self.velocity)}",
            "",
            *strength.lines({name: _flow(limit) for name, limit in self.acceleration.items()}),
            "# Bodies that overlap at the anchor, grown by this, are neighbours or do by design.",
            "pair_inflation: 1.1",
        ]
        if self.baselines:
            lines += ["", "# Pairs that overlap by design come nowhere deeper than it stands.",
                      "baselines: true"]  # fmt: skip
        if self.finer:
            lines += ["", "# Pairs of links that are watched by their finer bodies.",
                      f"finer: {_flow([list(pair) for pair in self.finer])}"]  # fmt: skip
        return "\n".join(lines) + "\n"

    def _stands(self) -> list[str]:
        if self.stand is None:
            return []
        named = {joint: angle for joint, angle in self.stand.items() if angle != 0.0}
        return ["# How it stands, arms hanging [rad].", f"stand: {_flow(named)}", ""]


def _roles(points: Mapping[str, object]) -> list[str]:
    """Roles in the order of description.MAPPED."""
    return [role for role in MAPPED if role in points]


def _flow(value: object) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_word(k)}: {_flow(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    return repr(value) if isinstance(value, float) else _word(str(value))


def _word(text: str) -> str:
    """A YAML scalar that is read as text."""
    plain = re.fullmatch(r"[A-Za-z_][A-Za-z0-9_./-]*", text)
    if plain and text.lower() not in ("y", "n", "yes", "no", "on", "off", "true", "false", "null"):
        return text
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
