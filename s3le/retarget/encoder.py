"""A trained network, one row at a time, without torch: what a robot's computer needs of a model.

The products are numpy's, which for one row are twice as fast as torch's, as torch's overhead a
call is longer than the product (docs/tried.md).
"""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from safetensors import SafetensorError, safe_open

from s3le.errors import ModelError


class Encoder:
    """Layers of tanh units and a linear one at the end: a vector in, a vector out."""

    def __init__(self, layers: list[tuple[np.ndarray, np.ndarray]], take: int) -> None:
        """Take the layers.

        Args:
            layers: (weight (out, in), bias (out,)) of each, in order.
            take: outputs that count: the first so many.
        """
        self._layers = [
            (np.ascontiguousarray(w, np.float32), np.ascontiguousarray(b, np.float32))
            for w, b in layers
        ]
        w, b = self._layers[-1]
        self.width = take
        self._layers[-1] = np.ascontiguousarray(w[:take]), np.ascontiguousarray(b[:take])

    def then(self, after: "Encoder") -> "Encoder":
        """One network that applies this one, then another; no unit lies between the two."""
        (w, b), (v, c) = self._layers[-1], after._layers[0]
        joined = v.astype(float) @ w, v.astype(float) @ b + c
        return Encoder([*self._layers[:-1], joined, *after._layers[1:]], after.width)

    def rows(self, x: np.ndarray) -> np.ndarray:
        """Map many vectors, (n, in) -> float32 (n, out)."""
        h = np.asarray(x, np.float32)
        for w, b in self._layers[:-1]:
            h = np.tanh(h @ w.T + b)
        w, b = self._layers[-1]
        return h @ w.T + b

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Map one vector, (in,) -> float32 (out,)."""
        h = x.astype(np.float32)
        for w, b in self._layers[:-1]:
            h = w @ h
            h += b
            np.tanh(h, h)
        w, b = self._layers[-1]
        return w @ h + b


class _Scaled:
    """A decoder of joint angles, from units of the robot's range to rad."""

    def __init__(self, net: Encoder, centre: np.ndarray, half_width: np.ndarray) -> None:
        self._net, self._centre, self._half_width = net, centre, half_width

    def __call__(self, z: np.ndarray) -> np.ndarray:
        return self._net(z) * self._half_width + self._centre


def linear(onto: np.ndarray) -> Encoder:
    """The network z -> z @ onto, (in, out)."""
    onto = np.asarray(onto)
    return Encoder([(onto.T, np.zeros(onto.shape[1]))], onto.shape[1])


class Networks(NamedTuple):
    """What a retargeter needs of a model."""

    encoder: Encoder  # of skeletons
    decoder_x: Encoder  # latents to skeletons
    decoder_q: _Scaled  # latents to poses [rad]
    note: dict  # the model's configuration


def read(path: Path, robot: str | None = None) -> Networks:
    """The networks of a model file that retargeting uses, and its note.

    Args:
        path: file written by s3le.learn.artifact.
        robot: tag of the robot that it must be of; None accepts all.

    Raises:
        ModelError: missing, damaged, or of another robot.
    """
    if not Path(path).is_file():
        raise ModelError(f"{path} is missing; write it with: dvc repro train")
    try:
        with safe_open(path, framework="numpy") as file:
            note = json.loads((file.metadata() or {})["note"])
            weights = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        latent = note["sizes"]["latent"]
        q_net = _layers(weights, "decoder_y")
        joints = weights["joints.centre"], weights["joints.half_width"]
        found = (
            Encoder(_layers(weights, "encoder_x"), latent),
            Encoder(_layers(weights, "decoder_x"), note["sizes"]["dim_x"]),
            _Scaled(Encoder(q_net, len(joints[0])), *joints),
        )
    except (SafetensorError, OSError, KeyError, IndexError, TypeError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ModelError(f"{path} cannot be read ({reason}); train again") from None
    if robot is not None and note.get("robot_hash") != robot:
        raise ModelError(
            f"{path} has robot_hash {note.get('robot_hash')!r}, {robot!r} is wanted; train again"
        )
    for name, value in weights.items():
        if not np.isfinite(value).all():
            raise ModelError(f"{path}: weight {name} is not finite; train again")
    return Networks(*found, note)


def _layers(weights: dict[str, np.ndarray], net: str) -> list[tuple[np.ndarray, np.ndarray]]:
    own = [name.split(".") for name in weights if name.startswith(f"{net}.")]
    numbers = sorted(int(number) for _, number, kind in own if kind == "weight")
    return [(weights[f"{net}.{i}.weight"], weights[f"{net}.{i}.bias"]) for i in numbers]
