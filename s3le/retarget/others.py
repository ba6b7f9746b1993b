"""The motion of joints that others move, out of another tool's file: legs, hands, the root.

Whatever `s3le guard` reads is read here, and the file need not have the robot's own joints: they
are decided here. Which of the others are given, and which are held, is as in `s3le guard`.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from s3le.errors import TrajectoryError
from s3le.guard import sense
from s3le.guard.layouts import roots
from s3le.guard.layouts.matched import few
from s3le.guard.places import fingerprint
from s3le.guard.task import Reading
from s3le.motion import trajectory
from s3le.motion.fit import MOVING, Others, fit, urdf_joints
from s3le.motion.trajectory import METRES, WHOLE, Placed
from s3le.robot.description import ALL
from s3le.robot.robot import Robot
from s3le.robot.wholebody import WholeBody, whole_body

_KEPT = "stay as they are"  # what a note says of numbers that only a guard writes back


class Other(NamedTuple):
    """Which file, and how it is read: plain data."""

    path: str
    shown: str  # the same, from the folder of results
    sha256: str  # places.fingerprint
    offset: float = 0.0  # [s], when the clip begins, after the file's first row
    fps: float | None = None  # rows per second [Hz], instead of the file's own times
    joints: tuple[str, ...] | None = None  # names of its columns, where it has none
    degrees: bool = False
    given: tuple[str, ...] = (MOVING,)  # see motion.fit
    rooted: bool = False  # where the base link is, is asked for too

    def about(self) -> dict[str, Any]:
        """What can change a result, as JSON."""
        return {key: value for key, value in self._asdict().items() if key != "path"}


class Read(NamedTuple):
    """What a file says."""

    name: str
    time: np.ndarray  # [s], (m,), rising
    joints: tuple[str, ...]  # all that it has and the robot does not decide, as it orders them
    q: np.ndarray  # [rad], [m] of a prismatic joint, (m, len(joints))
    others: Others | None  # those of them that are given; None: all stand where they are held
    root: Placed | None  # None: it was not asked for
    rate: float | None  # rows per second [Hz]; None: steps in time differ
    metres: tuple[str, ...]  # of joints: the prismatic ones
    notes: list[str]

    def body(self, robot: Robot) -> WholeBody | None:
        """The robot among the given joints; None: none is given.

        Raises:
            RobotError: such a joint cannot move in the model.
        """
        return None if self.others is None else whole_body(robot, self.others.joints)

    def about(self) -> dict[str, Any]:
        """What a motion file must say to be read with this one's joints in it."""
        return {WHOLE: {METRES: list(self.metres)}} if self.metres else {}


def read(other: Other, robot: Robot) -> Read:
    """Read the motion of the joints that a robot does not decide.

    Raises:
        TrajectoryError: the file cannot be read, is another than it was, holds several motions or
            none of further joints, or no root where one is wanted; a joint that is not given
            moves; or what `s3le guard` refuses.
        RobotError: a given joint cannot move in the model.
    """
    path = Path(other.path)
    nobody = _deciding_nothing(robot)
    reading = Reading(other.fps, other.joints, other.degrees, None, (ALL,))
    try:
        layout = reading.open(path, nobody)
        if len(layout.episodes) != 1:
            raise TrajectoryError(
                f"{path}: holds {len(layout.episodes)} motions; give a file of one"
            )
        if fingerprint(path) != other.sha256:
            raise TrajectoryError(f"{path}: changed while it was read; run again")
        root = layout.root() if other.rooted else None
    except TrajectoryError as refusal:  # --fps is the clip's here
        raise TrajectoryError(str(refusal).replace("--fps", "--others-fps")) from None
    except OSError as error:
        raise TrajectoryError(f"{path}: {error.strerror or error}") from None
    one = layout.episodes[0]
    found = one.others
    assert found is not None  # all of its joints are, and it has some
    rest = [joint for joint in found.joints if joint not in robot.joint_names]
    if not rest:
        raise TrajectoryError(
            f"{path}: has no joint that {robot.name} does not decide itself; missing are "
            f"{few(_beyond(robot))}"
        )
    q = np.ascontiguousarray(found.q[:, [found.joints.index(joint) for joint in rest]])
    standing = np.repeat(robot.anchor[None], len(q), axis=0)
    whole = trajectory.make(
        one.name, [*robot.joint_names, *rest], one.time, np.hstack([standing, q])
    )
    others = fit(whole, robot, given=other.given).others
    kinds = urdf_joints(robot)
    made = Read(
        one.name, whole.time, tuple(rest), q, others, root, _rate(whole.rate),
        tuple(joint for joint in rest if kinds[joint] == "prismatic"),
        [note for note in one.notes if _KEPT not in note],
    )  # fmt: skip
    if (body := made.body(robot)) is not None and others is not None:
        poses = body.poses(standing, others.q)
        made.notes.extend(sense.refuse_foreign(one.name, body.robot, poses, other.degrees))
    if other.rooted:
        _check_root(made)
    return made


def _deciding_nothing(robot: Robot) -> Robot:
    """The same robot without a joint of its own, so that a file need not have any."""
    stands = dict(zip(robot.joint_names, robot.anchor.tolist(), strict=True))
    text = replace(robot.description, hold=robot.description.hold | stands)
    return replace(robot, joints=(), description=text)


def _beyond(robot: Robot) -> Sequence[str]:
    """Joints of the URDF that the robot does not decide; those that the file of the robot gives."""
    given = robot.description.given
    if given and tuple(given) != (ALL,):
        return given
    return [joint for joint in urdf_joints(robot) if joint not in robot.joint_names]


def _rate(rate: float | None) -> float | None:
    """A rate as people write it: 30 rather than what times of 1/30 s give back."""
    return None if rate is None else float(f"{rate:.9g}")


def _check_root(made: Read) -> None:
    """Refuse a motion from which no tool's file can be written.

    Raises:
        TrajectoryError: no root, one that is not finite or no rotation, or no one rate.
    """
    if made.root is None:
        raise TrajectoryError(
            f"{made.name}: does not say where its root is, which files --for a tool need; known "
            f"are {roots.KNOWN}"
        )
    for part, what in zip(made.root, ("places", "turns"), strict=True):
        if len(part) != len(made.time):
            raise TrajectoryError(
                f"{made.name}: {len(part)} {what} of its root for {len(made.time)} rows"
            )
    seven = np.hstack(made.root)
    for row in np.flatnonzero(~np.isfinite(seven).all(axis=1))[:1]:
        raise TrajectoryError(f"{made.name}: row {row}: the root is not finite")
    for row in np.flatnonzero(~(np.linalg.norm(made.root.turn, axis=1) > 0.5))[:1]:
        raise TrajectoryError(f"{made.name}: row {row}: the root's quaternion is none")
    if made.rate is None and len(made.time) > 1:
        raise TrajectoryError(
            f"{made.name}: its rows are not at one rate, as files --for a tool are; resample it, "
            "or leave --for away"
        )
