"""A robot as tensors on one device, with what every pose shares worked out once.

Tensors of poses have their rows last, so that one operation reads and writes whole runs of rows:
q is (n, rows), a frame's rotation (3, 3, n + 1, rows), a pair's distance (pairs, rows).
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from s3le.errors import ParameterError
from s3le.robot.chain import Chain


class Level(NamedTuple):
    """Joints at one depth of the tree: their parents are all placed before them."""

    joint: Tensor  # int64 (k,)
    parent: Tensor  # int64 (k,), frames


class Solid(NamedTuple):
    """A kernels.chain.Chain on a device; float64 unless said otherwise."""

    device: torch.device
    levels: tuple[Level, ...]
    turn: Tensor  # (3, 3, 3, n, 1): constant, cosine and sine part of a joint's rotation
    translation: Tensor  # [m], (3, n, 1)
    axis: Tensor  # (3, n, 1), unit, in the parent's frame
    moves: Tensor  # (n + 1, n): 1 where joint j moves frame f
    lower: Tensor  # [rad], (n, 1)
    upper: Tensor  # [rad], (n, 1)
    base: Tensor  # (3, 3)
    bone: Tensor  # (7, 10): bone b = sum of bone[b, k] * point k
    point_frame: Tensor  # int64 (10,)
    point: Tensor  # [m], (3, 10, 1)
    body_frame: Tensor  # int64 (b,)
    body_a: Tensor  # [m], (3, b, 1)
    body_b: Tensor  # [m], (3, b, 1)
    pair_a: Tensor  # int64 (p,), bodies
    pair_b: Tensor  # int64 (p,)
    radii: Tensor  # [m], (p, 1), sum over the two
    side: Tensor  # (p, n): +1 joint moves the second body only, -1 the first only, 0 both or none
    touched: Tensor  # (p, n): 1 where the joint moves either body


def device_of(name: str) -> torch.device:
    """The device of that name.

    Raises:
        ParameterError: torch knows no such device, or sees none here.
    """
    try:
        device = torch.device(name)
    except RuntimeError:
        raise ParameterError(f"device must be cpu or cuda, got {name!r}") from None
    if device.type not in ("cpu", "cuda"):
        raise ParameterError(f"device must be cpu or cuda, got {name!r}")
    if device.type == "cuda":
        seen = torch.cuda.device_count() if torch.cuda.is_available() else 0
        if not seen or (device.index or 0) >= seen:
            raise ParameterError(
                f"device {name!r} is asked for and torch {torch.__version__} sees {seen} CUDA "
                "devices; use device 'cpu', or a torch built for CUDA on a machine with a GPU"
            )
    return device


def name_of(name: str) -> str:
    """What a device is called, with what drives it: rows of another one may differ in rounding.

    Raises:
        ParameterError: as device_of.
    """
    device = device_of(name)
    if device.type == "cpu":
        return f"cpu, torch {torch.__version__}"
    called = torch.cuda.get_device_name(device)
    return f"{called}, torch {torch.__version__}, CUDA {torch.version.cuda}"


def put(chain: Chain, device: str) -> Solid:
    """The robot's arrays on a device.

    Raises:
        ParameterError: there is no such device here.
    """
    where = device_of(device)

    def real(array: np.ndarray) -> Tensor:
        return torch.tensor(np.asarray(array, float), dtype=torch.float64, device=where)

    def whole(array: np.ndarray) -> Tensor:
        return torch.tensor(np.asarray(array, np.int64), device=where)

    n = len(chain.parent)
    depth = np.zeros(n + 1, int)
    for joint, parent in enumerate(chain.parent):  # a parent stands before its children
        depth[joint + 1] = depth[parent] + 1
    levels = [np.flatnonzero(depth[1:] == d) for d in range(1, depth.max() + 1)]

    # Rodrigues: turn = a a' + cos (I - a a') + sin [a], each part behind the joint's own rotation.
    parts = np.empty((3, 3, 3, n, 1))
    for joint, (x, y, z) in enumerate(chain.axis):
        along = np.outer((x, y, z), (x, y, z))
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        for i, part in enumerate((along, np.eye(3) - along, cross)):
            parts[i, :, :, joint, 0] = chain.rotation[joint] @ part

    bone = np.zeros((7, len(chain.point)))
    for b in range(7):
        for end in range(2):
            bone[b, chain.head[b, end]] += 0.5
            bone[b, chain.tail[b, end]] -= 0.5

    first, second = chain.body_frame[chain.pair].T
    moves = chain.moves.astype(float)
    return Solid(
        device=where,
        levels=tuple(Level(whole(at), whole(chain.parent[at])) for at in levels),
        turn=real(parts),
        translation=real(chain.translation.T[:, :, None]),
        axis=real(np.einsum("jik,jk->ij", chain.rotation, chain.axis)[:, :, None]),
        moves=real(moves),
        lower=real(chain.lower[:, None]),
        upper=real(chain.upper[:, None]),
        base=real(chain.base),
        bone=real(bone),
        point_frame=whole(chain.point_frame),
        point=real(chain.point.T[:, :, None]),
        body_frame=whole(chain.body_frame),
        body_a=real(chain.body_a.T[:, :, None]),
        body_b=real(chain.body_b.T[:, :, None]),
        pair_a=whole(chain.pair[:, 0]),
        pair_b=whole(chain.pair[:, 1]),
        radii=real(chain.body_radius[chain.pair].sum(axis=1)[:, None]),
        side=real(moves[second] - moves[first]),
        touched=real(np.maximum(moves[first], moves[second])),
    )
