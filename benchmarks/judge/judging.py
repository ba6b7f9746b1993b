"""The independent judge: does what was done keep what is promised of it? By dense samples.

A step is the joint path from one pose to the next: straight, or, where speeds are told, parabolas
between rows of position and speed, which must meet. It is sampled so densely that no point
of any body moves more than 1 mm between two samples, and an engine that shares nothing with the
retargeter's kernels measures every watched pair that can come near. Left out are pairs that cannot:
in the middle of each PART of the samples the engine measures all of them, and a pair that is then
farther apart than both bodies can travel from there (link lengths by pinocchio,
s3le/safety/judge.py), and FAR more, is as good as measured.

It proves nothing. It looks, at other places and with other arithmetic than the proof that it
judges; so it would see a proof that is wrong.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from engines import KERNELS_AGREE, Engine

from s3le.robot.robot import Robot
from s3le.safety.judge import reaches

STEP = 0.001  # [m], most that a point of a body moves between two samples
FAR = 0.005  # [m], pairs that stay farther apart than this are not sampled
PART = 64  # samples for which it is settled at once which pairs are near
SHORTEST, LONGEST = 1e-6, 1.0  # [s], as promised: below, nothing moves; above, no more than in this
KINDS = ("collision", "between", "margin", "limits", "speed", "acceleration", "held")
_MEETS = 1e-9  # [rad], [rad/s], by which rows of a curve may miss each other: of floats
_FLOATS = 4.0 * np.finfo(float).eps  # of a second difference of angles, of the largest angle


class Promise(NamedTuple):
    """What is said of every step."""

    margin: float  # [m], clearance at both ends
    between: float  # [m], and on the path between
    speed: np.ndarray  # [rad/s], (n_dof,), most that each joint does
    lower: np.ndarray  # [rad], (n_dof,)
    upper: np.ndarray  # [rad], (n_dof,)
    acceleration: np.ndarray  # [rad/s^2], (n_dof,), from step to step
    rounding: float = 0.0  # share by which a speed may exceed its limit; of accelerations 1e-9 more


class Came(NamedTuple):
    """How the robot came to where a step begins."""

    v: np.ndarray  # [rad/s], (n_dof,), its speed in the step before
    dt: float  # [s], duration of that step; NaN: nothing is promised of the change


class Row(NamedTuple):
    """A moment of a step whose speed is continuous."""

    t: float  # [s], since the step began
    q: np.ndarray  # [rad], (n_dof,)
    v: np.ndarray  # [rad/s], (n_dof,)
    cubic: bool = False  # from the row before on the cubic that meets both; else evenly accelerated


class Verdict(NamedTuple):
    """What was seen of one step."""

    broken: tuple[str, ...]  # which of KINDS; empty: it keeps what was promised
    clearance: float  # [m], least that was seen on the path, ends included; FAR: nothing was near
    end: float  # [m], the same where the step ends
    t: float  # share of the path where it was least
    pair: int  # row of the watched pair; -1: nothing was near
    speed: float  # highest share of a joint's speed limit
    hardest: float  # and of its acceleration limit; 0: not looked at
    poses: int  # samples
    checks: int  # distances measured


class Judge:
    """Judges steps of one robot with one engine."""

    def __init__(self, robot: Robot, promise: Promise, engine: Engine) -> None:
        """Measure the robot.

        Args:
            robot: of it are used the URDF, what is watched, and sizes of bodies.
            promise: what its steps are held to.
            engine: measures distances.
        """
        self._promise, self.engine = promise, engine
        self._reach = reaches(robot)  # (b, n_dof)
        a, b = self._reach[robot.watched.T]  # (p, n_dof) each
        # A joint that moves both bodies of a pair moves neither as seen from the other.
        # Rows keep more than paths do: the margin, and less depth where bodies overlap by design.
        self._more = robot.slack() - robot.slack(promise.between)
        self._apart = np.where((a > 0) != (b > 0), np.maximum(a, b), 0.0)  # (p, n_dof)

    def step(self, q0: np.ndarray, q1: np.ndarray, dt: float, came: Came | None = None) -> Verdict:
        """Judge the step from q0 to q1 [rad], each (n_dof,), that took dt [s].

        Args:
            q0, q1, dt: the step.
            came: what went before; None: its acceleration is not looked at.
        """
        promise, moved = self._promise, np.abs(q1 - q0)
        broken = []
        if not (np.isfinite([q0, q1]).all() and np.abs([q0, q1]).max() < 1e3):
            return Verdict(KINDS, np.nan, np.nan, np.nan, -1, np.nan, np.nan, 0, 0)
        if not ((promise.lower <= q1) & (q1 <= promise.upper)).all():
            broken.append("limits")
        ratio = 0.0
        if dt >= SHORTEST:  # NaN: no time passed
            most = promise.speed * min(dt, LONGEST)
            ratio = float((moved / most).max())
            if not (moved <= most * (1.0 + promise.rounding)).all():
                broken.append("speed")
        elif moved.any():
            broken.append("held")
        hardest = 0.0
        if came is not None and dt >= SHORTEST and came.dt >= SHORTEST:
            before, now = min(came.dt, LONGEST), min(dt, LONGEST)
            mean = 0.5 * (before + now)
            hard = np.abs((q1 - q0) / now - came.v) / mean
            # Angles are floats: at 1 MHz their last digit is an acceleration.
            fine = _FLOATS * np.abs([q0, q1]).max() / (min(before, now) * mean)
            hardest = float((np.maximum(hard - fine, 0.0) / promise.acceleration).max())
            if not hardest <= 1.0 + promise.rounding + 1e-9:
                broken.append("acceleration")
        seen = self.path(q0, q1)
        broken += self._apart_enough(seen)
        return seen._replace(broken=tuple(broken), speed=ratio, hardest=hardest)

    def curve(self, rows: Sequence[Row], came: Came | None = None) -> Verdict:
        """Judge a step whose speed is continuous, from its first row to its last.

        Args:
            rows: two at least; see Row.
            came: what went before; None: its speed is not looked at.
        """
        promise, broken = self._promise, []
        t = np.array([row.t for row in rows])
        q, v = np.array([row.q for row in rows]), np.array([row.v for row in rows])
        dt = np.diff(t)[:, None]
        if not (np.isfinite(q).all() and np.isfinite(v).all() and np.abs(q).max() < 1e3):
            return Verdict(KINDS, np.nan, np.nan, np.nan, -1, np.nan, np.nan, 0, 0)
        if not (dt > 0.0).all():
            return Verdict(("held",), np.nan, np.nan, np.nan, -1, np.nan, np.nan, 0, 0)
        cubic = np.array([row.cubic for row in rows[1:]])[:, None]
        chord = (q[1:] - q[:-1]) / dt
        begin = np.where(cubic, 6.0 * chord - 4.0 * v[:-1] - 2.0 * v[1:], v[1:] - v[:-1]) / dt
        end = np.where(cubic, -6.0 * chord + 2.0 * v[:-1] + 4.0 * v[1:], v[1:] - v[:-1]) / dt
        bent = np.maximum(np.abs(begin), np.abs(end))
        # Where the acceleration of a cubic turns, its speed is greatest.
        bend = np.where(begin == end, np.inf, end - begin)
        share = np.clip(-begin / bend, 0.0, 1.0)
        turning = v[:-1] + dt * (share * begin + 0.5 * share**2 * np.where(cubic, end - begin, 0.0))
        # That a parabola leads from each row to the next is promised too; angles are floats.
        fine = _FLOATS * np.abs(q).max()
        off = np.where(cubic, 0.0, np.abs(q[:-1] + 0.5 * dt * (v[1:] + v[:-1]) - q[1:]))
        fast = np.concatenate([v, turning])
        ratio, hardest = float((np.abs(fast) / promise.speed).max()), 0.0
        if not (off <= _MEETS + fine).all() or (
            came is not None and not np.abs(v[0] - came.v).max() <= _MEETS
        ):
            broken.append("acceleration")
        if not ratio <= 1.0 + promise.rounding + 1e-9:
            broken.append("speed")
        hard = np.maximum(bent - np.where(cubic, 12.0, 2.0) * fine / dt**2, 0.0)
        hardest = float((hard / promise.acceleration).max())
        if not hardest <= 1.0 + promise.rounding + 1e-9:
            broken.append("acceleration")
        path = self.sampled(rows)
        inside = (promise.lower - _MEETS <= path) & (path <= promise.upper + _MEETS)
        ends = (promise.lower <= q[-1]) & (q[-1] <= promise.upper)
        if not (inside.all() and ends.all()):
            broken.append("limits")
        seen = self._along(path)
        broken += self._apart_enough(seen)
        return seen._replace(broken=tuple(dict.fromkeys(broken)), speed=ratio, hardest=hardest)

    def sampled(self, rows: Sequence[Row]) -> np.ndarray:
        """Poses of a curve [rad], (m, n_dof): between two no point moves more than STEP."""
        return self._cut(rows, lambda v, bent, dt: (self._reach @ v).max() * dt / STEP)

    def chords(self, rows: Sequence[Row], sag: float) -> np.ndarray:
        """Poses of a curve [rad], (m, n_dof), from whose chords no point strays by more [m]."""
        return self._cut(
            rows, lambda v, bent, dt: np.sqrt((self._reach @ bent).max() * dt**2 / (8.0 * sag))
        )

    def _cut(self, rows: Sequence[Row], pieces: Callable) -> np.ndarray:
        poses = [rows[0].q[None]]
        for one, other in zip(rows, rows[1:], strict=False):
            dt = other.t - one.t
            bent, jerk = (other.v - one.v) / dt, 0.0
            most = np.maximum(np.abs(one.v), np.abs(other.v))
            if other.cubic:
                chord = (other.q - one.q) / dt
                bent = (6.0 * chord - 4.0 * one.v - 2.0 * other.v) / dt
                jerk = (6.0 * (one.v + other.v) - 12.0 * chord) / dt**2
                most = np.maximum(most, np.abs(3.0 * chord - one.v - other.v))
            hardest = np.maximum(np.abs(bent), np.abs(bent + jerk * dt))
            count = max(1, int(np.ceil(pieces(most, hardest, dt))))
            s = np.linspace(0.0, dt, count + 1)[1:, None]
            poses.append(one.q + s * (one.v + s * (0.5 * bent + s * jerk / 6.0)))
            poses[-1][-1] = other.q
        return np.concatenate(poses)

    def _apart_enough(self, seen: Verdict) -> list[str]:
        broken = []
        if not seen.clearance > 0.0:
            broken.append("collision")
        if not seen.clearance >= self._promise.between - KERNELS_AGREE:
            broken.append("between")
        if not seen.end >= self._promise.margin - self.engine.agrees:
            broken.append("margin")
        return broken

    def path(self, q0: np.ndarray, q1: np.ndarray) -> Verdict:
        """Look at the straight path from q0 to q1 [rad], finite, both ends included."""
        return self._along(self.samples(q0, q1))

    def _along(self, q: np.ndarray) -> Verdict:
        """Look at samples of a path [rad], (m, n_dof)."""
        least, pair = np.full(len(q), FAR), np.full(len(q), -1, np.int64)
        poses = checks = 0
        for first in range(0, len(q), PART):
            part = slice(first, min(first + PART, len(q)))
            count = part.stop - part.start
            middle = self.engine.pairs(q[part.start + count // 2])
            travel = self._apart @ np.abs(q[part] - q[part.start + count // 2]).max(axis=0)
            near = np.flatnonzero(~(middle - travel > FAR))  # catches NaN
            poses, checks = poses + 1, checks + len(middle)
            if len(near):
                least[part], pair[part] = self.engine.nearest(q[part], near)
                poses, checks = poses + count, checks + count * len(near)
        end = float(least[-1])
        if self._more.any():
            end = float((self.engine.pairs(q[-1]) + self._more).min())
            poses, checks = poses + 1, checks + len(self._more)
        at = int(np.argmin(least))  # the first NaN, if any
        return Verdict(
            (), min(float(least[at]), FAR), min(end, FAR), at / max(len(q) - 1, 1),
            int(pair[at]), np.nan, 0.0, poses, checks,
        )  # fmt: skip

    def samples(self, q0: np.ndarray, q1: np.ndarray) -> np.ndarray:
        """Poses of the path [rad], (m, n_dof), evenly spread, both ends included.

        A point of a body moves by no more than the sum of |dq_j| times its distance from joint j.
        """
        farthest = (self._reach @ np.abs(q1 - q0)).max()
        if farthest == 0.0:
            return q1[None]
        share = np.linspace(0.0, 1.0, max(1, int(np.ceil(farthest / STEP))) + 1)[:, None]
        return (1.0 - share) * q0 + share * q1


def promise_of(retargeter) -> Promise:
    """What a s3le.retarget.Retargeter says of itself."""
    robot = retargeter.robot
    return Promise(
        robot.margin, float(retargeter.settings.between), np.array(retargeter.speed),
        robot.lower, robot.upper, np.array(retargeter.most.acceleration),
    )  # fmt: skip
