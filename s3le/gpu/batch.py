"""Whole batches of poses through the torch kernels: the door of this room, numpy in, numpy out.

The same questions and refusals as s3le.kernels.batch, with the device named. Poses travel in
chunks, so the memory taken on the device does not grow with their number: about 200 kB a row
of the chunk for coman's 378 pairs (measured on a CPU), 12 GiB for 65,536 rows.

Results are deterministic for one machine, device and chunking. A row's answer does not use the
other rows, but the libraries of linear algebra may round a matrix differently in another batch:
between chunk sizes projections differ by rounding that the iterations carry on (measured on a
CPU: at most 5e-9 rad), more only where two decisions stand within rounding of each other. Whether
an answer keeps the margin is decided by its own distances.
"""

from collections.abc import Callable, Iterator

import numpy as np
import torch
from torch import Tensor

from s3le.errors import ParameterError
from s3le.gpu import distance, kinematics
from s3le.gpu.chain import Solid, put
from s3le.gpu.fuse import fusing
from s3le.gpu.project import project as project_rows
from s3le.kernels.batch import PROJECTIONS, Progress, Projection
from s3le.kernels.chain import Chain

# Rows of a chunk: enough to fill a large GPU while the last hard rows of a projection are few
# beside the rest; on a CPU what stays near the cache.
ROWS = {"cuda": 65_536, "cpu": 1024}


def skeletons(
    chain: Chain,
    q: np.ndarray,
    device: str,
    progress: Progress | None = None,
    *,
    rows: int | None = None,
    fuse: bool = False,
) -> np.ndarray:
    """Skeleton features x = FK(q): q (n, n_dof) [rad] -> (n, 21).

    Args:
        chain: the robot.
        q: poses [rad], (n, n_dof).
        device: "cpu", "cuda" or "cuda:1" and so on.
        progress: called with numbers of rows done.
        rows: rows of a chunk; the device's own number if not given.
        fuse: compile for the device at first use, a minute or so, then faster (s3le.gpu.fuse).

    Raises:
        ParameterError: q has another shape, rows is not positive, or there is no such device.
    """
    solid, q = put(chain, device), _poses(chain, q)
    x = np.empty((len(q), 21))

    def work(part: Tensor, at: slice) -> None:
        R, p, _ = kinematics.place(solid, part)
        x[at] = kinematics.bones(solid, R, p).T.cpu().numpy()

    _spread(work, solid, q, rows, fuse, progress)
    return x


def clearances(
    chain: Chain,
    q: np.ndarray,
    device: str,
    progress: Progress | None = None,
    *,
    rows: int | None = None,
    fuse: bool = False,
) -> np.ndarray:
    """Least signed distance over the watched pairs [m], (n,); NaN where q is not finite.

    Args, Raises: as skeletons.
    """
    solid, q = put(chain, device), _poses(chain, q)
    out = np.empty(len(q))

    def work(part: Tensor, at: slice) -> None:
        out[at] = distance.clearances(solid, part).cpu().numpy()

    _spread(work, solid, q, rows, fuse, progress)
    return out


def project(
    chain: Chain,
    anchor: np.ndarray,
    q: np.ndarray,
    margin: float,
    device: str,
    progress: Progress | None = None,
    kind: str = "nearest",
    *,
    rows: int | None = None,
    fuse: bool = False,
) -> Projection:
    """Proj_Q: for each relaxed pose the nearest feasible one found, least change in q (Sec. IV-B).

    A feasible pose is returned as it is, to the bit. Feasible means at least the margin by the
    kernels of this room, in float64; s3le.robot.certificate decides what is kept.

    Args:
        chain: the robot.
        anchor: a feasible pose [rad], (n_dof,), from which the fallback always succeeds.
        q: relaxed poses [rad], (n, n_dof), finite.
        margin: clearance wanted [m].
        device, progress, rows, fuse: as skeletons.
        kind: one of kernels.batch.PROJECTIONS.

    Raises:
        ParameterError: q or the anchor has another shape, a row of q is not finite, rows is not
            positive, or there is no such device or kind.
    """
    if kind not in PROJECTIONS:
        raise ParameterError(f"projection must be one of {', '.join(PROJECTIONS)}, got {kind!r}")
    solid, q = put(chain, device), _poses(chain, q)
    if not np.isfinite(q).all():
        row = int(np.argmin(np.isfinite(q).all(axis=1)))
        raise ParameterError(f"poses to project must be finite, row {row} is not")
    anchor = np.asarray(anchor, float)
    if anchor.shape != q.shape[1:]:
        raise ParameterError(f"the anchor must have shape {q.shape[1:]}, got {anchor.shape}")
    goal = torch.tensor(anchor[:, None], device=solid.device)
    out, how = np.empty_like(q), np.empty(len(q), np.uint8)

    def work(part: Tensor, at: slice) -> None:
        found, code = project_rows(solid, goal, margin, part, kind == "nearest")
        out[at] = found.T.cpu().numpy()
        how[at] = code.cpu().numpy()

    _spread(work, solid, q, rows, fuse, progress)
    return Projection(out, how)


def _poses(chain: Chain, q: np.ndarray) -> np.ndarray:
    """The poses as float64, one a row."""
    q = np.ascontiguousarray(q, float)
    if q.ndim != 2 or q.shape[1] != len(chain.parent):
        raise ParameterError(f"poses must have shape (n, {len(chain.parent)}), got {q.shape}")
    return q


def _spread(
    work: Callable[[Tensor, slice], None],
    solid: Solid,
    q: np.ndarray,
    rows: int | None,
    fuse: bool,
    progress: Progress | None,
) -> None:
    """Run work over chunks of poses, each put on the device with its rows last."""
    if rows is not None and rows < 1:
        raise ParameterError(f"a chunk must have at least one row, got {rows}")
    with torch.inference_mode(), fusing(fuse):
        for at in _slices(len(q), rows or ROWS[solid.device.type]):
            work(torch.tensor(q[at], device=solid.device).T.contiguous(), at)
            if progress:
                progress(at.stop - at.start)


def _slices(n: int, rows: int) -> Iterator[slice]:
    return (slice(i, min(i + rows, n)) for i in range(0, n, rows))
