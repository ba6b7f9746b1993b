"""The exported retargeter on the test motions: each planned as a whole, or a stream; certified.

Refined, it does what `s3le retarget` does. The look-up alone is followed under the same guard: of
the poses that are proposed for a frame, the one whose skeleton is nearest to the human, and then
the retargeter is shown that pose's own skeleton, as if the human stood exactly so. There is then
nothing to refine, and speeds, clearances and proofs are those of the refined row.
"""

from dataclasses import replace

import numpy as np

from s3le.errors import BundleError, CertificateError
from s3le.kernels import batch
from s3le.retarget.follow import follow as loop
from s3le.retarget.stream import Retargeter
from s3le.robot.robot import Robot
from s3le.safety import audit
from s3le.skeleton import cosine_distance
from s3le.types import Progress


class _Recorder:
    """A proposer that remembers what it was asked, after the filter, and its answers."""

    def __init__(self, proposer: Retargeter) -> None:
        self._proposer = proposer
        self.asked: list[np.ndarray] = []
        self.found: list[np.ndarray] = []

    def propose(self, x: np.ndarray) -> np.ndarray:
        self.asked.append(x.copy())
        self.found.append(self._proposer.propose(x))
        return self.found[-1]


class _Given:
    """A proposer of the pose whose skeleton is asked for."""

    def __init__(self, x: np.ndarray, q: np.ndarray) -> None:
        self.x, self.q = x, q

    def propose(self, x: np.ndarray) -> np.ndarray:
        return self.q[np.argmax(self.x @ x)][None]


def follow(
    robot: Robot,
    retargeter: Retargeter,
    clips: np.ndarray,
    times: np.ndarray,
    x: np.ndarray,
    refine: bool,
    progress: Progress | None = None,
    *,
    look_ahead: bool = True,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Follow every motion from its own first pose on; refuse what does not hold.

    Args:
        robot: the robot that the motions are for.
        retargeter: the one to follow them.
        clips: name of each frame's motion, (n,); the frames of one stand together.
        times: of the frames in their motion [s], (n,).
        x: human skeletons, (n, 21).
        refine: False: go for the poses looked up, as they are stored.
        progress: called with numbers of frames done.
        look_ahead: plan each motion as a whole, as `s3le retarget` does; False: frame by frame.

    Returns:
        (q, v, mode): poses [rad] and speeds [rad/s], (n, n_dof), and how each was obtained, words,
        (n,).

    Raises:
        BundleError: the retargeter is one of another robot.
        CertificateError: a pose, path or speed does not hold by audit's independent check.
    """
    if retargeter.robot.tag != robot.tag:
        raise BundleError(
            f"the retargeter is for robot '{retargeter.robot.tag}', the motions are for "
            f"'{robot.tag}'; write it with: dvc repro export"
        )
    cuts = 1 + np.flatnonzero(clips[1:] != clips[:-1])
    wanted = audit.demands(
        robot,
        margin_between=retargeter.settings.between,
        velocity=dict(zip(robot.joint_names, retargeter.speed.tolist(), strict=True)),
    )
    made = []
    for rows in np.split(np.arange(len(x)), cuts):
        walk = _refined if refine else _looked_up
        q, v, mode = walk(retargeter, x[rows], times[rows], look_ahead)
        report = audit.audit(robot, times[rows], q, wanted, v=v)
        if not report.holds:
            raise CertificateError(f"{clips[rows[0]]}: {report.complaint}")
        made.append((q, v, mode))
        if progress:
            progress(len(rows))
    poses, speeds, modes = (np.concatenate(part) for part in zip(*made, strict=True))
    return poses, speeds, modes


def _refined(
    retargeter: Retargeter, x: np.ndarray, times: np.ndarray, look_ahead: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    made = loop(retargeter, x, times, look_ahead=look_ahead)
    return made.q, made.v, made.mode


def _looked_up(
    retargeter: Retargeter, x: np.ndarray, times: np.ndarray, look_ahead: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    # A first time through for what the look-up is asked and finds: one call a frame.
    recorder = _Recorder(retargeter)
    robot = retargeter.robot
    loop(Retargeter(robot, recorder, retargeter.settings), x, times)
    shown = [batch.skeletons(robot.chain, found) for found in recorder.found]  # (k, 21) each
    nearest = [
        int(np.argmin(cosine_distance(rows, asked[None], robot.followed)))
        for rows, asked in zip(shown, recorder.asked, strict=True)
    ]
    # What was asked has been through the filter, so that there is none the second time.
    settings = replace(retargeter.settings, cutoff=0.0, delay=False)
    given = _Given(
        np.array([rows[k] for rows, k in zip(shown, nearest, strict=True)]),
        np.array([found[k] for found, k in zip(recorder.found, nearest, strict=True)]),
    )
    made = loop(Retargeter(robot, given, settings), given.x, times, look_ahead=look_ahead)
    return made.q, made.v, made.mode
