"""Training data on the device, and one step's batch from it.

Tilde marks relaxed, bar marks feasible: x_relaxed is x~, q_feasible is q-bar, x_mixed is
x' = mix x~ + (1 - mix) x-bar (Sec. IV-C). Rows are drawn with replacement from one generator;
nothing here knows a loss.
"""

import hashlib
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from s3le.errors import ParameterError, TrainingError

PRIORS = ("ball", "normal")


class Tuples(NamedTuple):
    """Corresponding rows of both domains; row k of every array is the same pose."""

    x_relaxed: np.ndarray  # (n, 21) human skeleton, or FK of q_relaxed
    x_feasible: np.ndarray  # (n, 21) FK of q_feasible
    q_relaxed: np.ndarray  # (n, n_dof) [rad] may break limits and self-collide
    q_feasible: np.ndarray  # (n, n_dof) [rad] its projection
    x_mixed: np.ndarray | None = None  # (n, 21) between the two; None: drawn anew at each step


class TrainingData(NamedTuple):
    """Everything a training sees; None stands for 'trained without', an empty array is refused."""

    pairs: Tuples | None  # from motion capture (Sec. IV-B)
    sampled: Tuples | None  # from the robot's kinematics (Sec. IV-C); S3LE alone uses them
    robot_q: np.ndarray  # (n, n_dof) [rad] robot-domain poses
    mocap_x: np.ndarray  # (n, 21) mocap-domain skeletons
    lower: np.ndarray  # (n_dof,) [rad]
    upper: np.ndarray  # (n_dof,) [rad]


class Batch(NamedTuple):
    """Rows of one step, on the device."""

    x_relaxed: Tensor  # (b, 21)
    x_feasible: Tensor  # (b, 21)
    x_mixed: Tensor  # (b, 21)
    q_feasible: Tensor  # (b, n_dof)
    mocap_x: Tensor  # (m, 21)
    robot_q: Tensor  # (m, n_dof)


class _Rows(NamedTuple):
    """Tuples on the device, as far as a step reads them."""

    x_relaxed: Tensor
    x_feasible: Tensor
    q_feasible: Tensor
    x_mixed: Tensor | None


def _check(name: str, rows: np.ndarray, width: int) -> np.ndarray:
    rows = np.asarray(rows)
    if rows.ndim != 2 or rows.shape[1] != width:
        raise TrainingError(f"{name} must have shape (n, {width}), got {rows.shape}")
    if len(rows) == 0:
        raise TrainingError(f"{name} has no rows; nothing to train on")
    bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
    if len(bad):
        raise TrainingError(
            f"{name}: {len(bad)} of {len(rows)} rows are not finite, first at row {bad[0]}"
        )
    return rows


def check(data: TrainingData, dim_x: int = 21) -> None:
    """Refuse data that no training can use.

    Raises:
        TrainingError: an array has no rows, another width, rows that do not correspond or are
            not finite; or there are no tuples at all. Names the array.
    """
    dim_q = len(np.asarray(data.lower))
    if data.pairs is None and data.sampled is None:
        raise TrainingError("no tuples: both pairs and sampled are None")
    for group, tuples in (("pairs", data.pairs), ("sampled", data.sampled)):
        if tuples is None:
            continue
        counts = set()
        for field, rows in tuples._asdict().items():
            if rows is not None:
                rows = _check(f"{group}.{field}", rows, dim_x if field[0] == "x" else dim_q)
                counts.add(len(rows))
        if len(counts) > 1:
            raise TrainingError(f"{group}: arrays have {sorted(counts)} rows, one count is wanted")
    _check("robot_q", data.robot_q, dim_q)
    _check("mocap_x", data.mocap_x, dim_x)


def fingerprint(data: TrainingData) -> str:
    """Hash of every number in the data, to tell one training's checkpoint from another's."""
    digest = hashlib.sha256()
    flat = [*(data.pairs or [None]), *(data.sampled or [None]), *data[2:]]
    for rows in flat:
        if rows is None:
            digest.update(b"none")
        else:
            rows = np.ascontiguousarray(rows)
            digest.update(f"{rows.dtype}{rows.shape}".encode())
            digest.update(rows.tobytes())
    return digest.hexdigest()


class Batches:
    """The data as float32 on a device, and the draw of one step's rows."""

    def __init__(
        self,
        data: TrainingData,
        *,
        n_pairs: int,
        n_sampled: int,
        n_domain: int,
        device: torch.device,
    ) -> None:
        """Move the data to the device, once.

        Args:
            data: checked data.
            n_pairs, n_sampled: tuples per step from each source, where there is one.
            n_domain: rows per step from each domain's own data.
            device: where the rows live.
        """

        def put(rows: np.ndarray) -> Tensor:
            return torch.from_numpy(np.array(rows, np.float32)).to(device)

        def put_all(own: Tuples) -> _Rows:
            mixed = None if own.x_mixed is None else put(own.x_mixed)
            return _Rows(put(own.x_relaxed), put(own.x_feasible), put(own.q_feasible), mixed)

        self._sources = [
            (count, put_all(tuples))
            for count, tuples in ((n_pairs, data.pairs), (n_sampled, data.sampled))
            if tuples is not None and count > 0
        ]
        if not self._sources:
            raise TrainingError("a step draws no tuples; batch or batch_pairs must be above 0")
        self._robot_q, self._mocap_x = put(data.robot_q), put(data.mocap_x)
        self._n_domain = n_domain
        self._device = device

    def draw(self, generator: torch.Generator) -> Batch:
        """Rows of one step, each source's own share, mocap pairs first."""

        def some(n: int, count: int) -> Tensor:
            return torch.randint(n, (count,), generator=generator, device=self._device)

        parts = []
        for count, tuples in self._sources:
            rows = some(len(tuples.x_relaxed), count)
            relaxed = tuples.x_relaxed.index_select(0, rows)
            feasible = tuples.x_feasible.index_select(0, rows)
            if tuples.x_mixed is None:
                mix = torch.rand(count, 1, generator=generator, device=self._device)
                mixed = mix * relaxed + (1.0 - mix) * feasible
            else:
                mixed = tuples.x_mixed.index_select(0, rows)
            parts.append((relaxed, feasible, mixed, tuples.q_feasible.index_select(0, rows)))
        relaxed, feasible, mixed, q = (torch.cat(column) for column in zip(*parts, strict=True))
        return Batch(
            relaxed, feasible, mixed, q,
            self._mocap_x.index_select(0, some(len(self._mocap_x), self._n_domain)),
            self._robot_q.index_select(0, some(len(self._robot_q), self._n_domain)),
        )  # fmt: skip


def draw_prior(kind: str, n: int, latent: int, generator: torch.Generator) -> Tensor:
    """Draws from the latent prior, shape (n, latent), on the generator's device.

    "ball": uniform in the unit ball (the authors' code); "normal": standard normal. The paper
    names none.

    Raises:
        ParameterError: kind is not one of PRIORS.
    """
    if kind not in PRIORS:
        raise ParameterError(f"prior must be one of {', '.join(PRIORS)}, got {kind!r}")
    z = torch.randn(n, latent, generator=generator, device=generator.device)
    if kind == "normal":
        return z
    radius = torch.rand(n, 1, generator=generator, device=generator.device) ** (1.0 / latent)
    return torch.nn.functional.normalize(z, dim=1) * radius


def prior_spread(kind: str, latent: int) -> float:
    """Mean squared distance of two prior draws: 2 d for "normal", 2 d / (d + 2) for "ball"."""
    return 2.0 * latent if kind == "normal" else 2.0 * latent / (latent + 2.0)
