"""Proj_Q the slow way, one pose at a time: what the batched projection is measured against.

Blending towards the anchor is what the paper's authors do. The sequential quadratic program is
what one writes with the usual libraries: pinocchio's Jacobians, coal's witness points, daqp. Both
share no arithmetic with the kernels. Their distances are those that the certificate takes.

The search over many starts does use the kernels' solver: it asks where to start, not how to go on.
"""

from typing import NamedTuple

import daqp
import numpy as np
import pinocchio as pin

from s3le.kernels.distance import reach
from s3le.kernels.solver import clearance_of, minimise, restore
from s3le.robot.certificate import PER_METRE
from s3le.robot.chain import Chain
from s3le.robot.robot import Robot

BAND = 0.1  # [m], pairs farther than this over the margin do not enter a quadratic program
SLACK = 1e-6  # [m], aimed for beyond the margin
BIG = 1e30  # daqp's infinity
_TAILS = ("hip", "neck", "r_shoulder", "r_elbow", "neck", "l_shoulder", "l_elbow")
_HEADS = ("neck", "r_shoulder", "r_elbow", "r_hand", "l_shoulder", "l_elbow", "l_hand")


class Nearest(NamedTuple):
    """What one search found."""

    q: np.ndarray  # [rad], (n_dof,)
    solved: bool  # within limits and margin apart
    steps: int  # iterations


class OneByOne:
    """Both projections for one robot; holds pinocchio's scratch space, so one per thread."""

    def __init__(self, robot: Robot, margin: float) -> None:
        """Take the collision model of the robot's certificate.

        Args:
            robot: whose poses are projected.
            margin: clearance to keep [m].
        """
        self.margin, self.anchor = margin, robot.anchor
        self.lower, self.upper = robot.lower, robot.upper
        own = robot.certifier()
        self._model, self._geometry = own._model, own._geometry
        self._data = self._model.createData()
        self._scratch = pin.GeometryData(self._geometry)
        self._joint = np.array([body.joint + 1 for body in robot.bodies])[
            robot.watched
        ]  # (n_pairs, 2)
        self._points, self._base = robot.points, robot.base_rotation
        self._moves = np.zeros((robot.n_dof + 1, robot.n_dof), bool)
        for joint in range(robot.n_dof):
            self._moves[joint + 1, robot.path_to(joint)] = True

    def blend(self, q: np.ndarray) -> Nearest:
        """Clip q (n_dof,) [rad]; while bodies collide, move all joints that carry them.

        Each time a twentieth of the way to the anchor, and into the limits again.

        Source: the authors' projection; the paper refers to [LWL2] for it.
        """
        q = np.clip(q, self.lower, self.upper)
        for step in range(1000):
            close = self._closer_than(q, self.margin)
            if not len(close):
                return Nearest(q, True, step)
            moved = self._moves[self._joint[close].ravel()].any(axis=0)
            q[moved] = 0.95 * q[moved] + 0.05 * self.anchor[moved]
            q = np.clip(q, self.lower, self.upper)
        return Nearest(self.anchor.copy(), False, step)

    def nearest(self, want: np.ndarray, start: np.ndarray, most: int = 60) -> Nearest:
        """Feasible pose near to want (n_dof,) [rad]: a sequential quadratic program from start.

        Each step minimises |q + s - want|^2 over the limits, a trust region, and the distances
        linearised at the witness points. It is kept if it lowers the objective plus a weight
        times the missing distance (l1 merit), and is asked for less where all is too much.

        Source: Nocedal and Wright, Numerical Optimization, 2nd ed., Sec. 18.5.
        """
        q = np.clip(start, self.lower, self.upper)
        goal, weight, radius = self.margin + SLACK, 1.0, 0.5
        d, G = self.gradients(q, self.margin + BAND)
        step = 0
        while step < most and radius > 1e-7:
            step += 1
            low, high = np.maximum(self.lower - q, -radius), np.minimum(self.upper - q, radius)
            for share in (1.0, 0.5, 0.25, 0.125, 0.0):
                h = np.where(d < goal, share, 1.0) * (goal - d)
                s, force = _program(q - want, low, high, G, h)
                if s is not None:
                    break
            if s is None or np.abs(s).max() < 1e-7:
                break
            weight = max(weight, 2.0 * force)
            trial = np.clip(q + s, self.lower, self.upper)
            d_new, G_new = self.gradients(trial, self.margin + BAND)
            before, after = (np.sum((p - want) ** 2) / 2 for p in (q, trial))
            short, short_new, left = (np.maximum(goal - v, 0).sum() for v in (d, d_new, d + G @ s))
            hoped = before - np.sum((q + s - want) ** 2) / 2 + weight * (short - left)
            got = before - after + weight * (short - short_new)
            if got > 0.1 * hoped and got > 0.0:
                q, d, G = trial, d_new, G_new
                radius = min(2.0 * radius, 1.0) if got > 0.7 * hoped else radius
                if got < 1e-12 * (1.0 + after) and short_new <= 0.0:
                    break
            else:
                radius = 0.3 * min(radius, np.abs(s).max())
        return self._restored(q, step)

    def follow(self, x: np.ndarray, start: np.ndarray, most: int = 60) -> Nearest:
        """Feasible pose whose skeleton is near x (21,): Gauss-Newton programs from start [rad].

        Minimises |x(q) - x|^2; otherwise as nearest.
        """
        q = np.clip(start, self.lower, self.upper)
        goal, weight, radius = self.margin + SLACK, 1.0, 0.5
        d, G = self.gradients(q, self.margin + BAND)
        found, J = self.skeleton(q)
        step = 0
        while step < most and radius > 1e-6:
            step += 1
            low, high = np.maximum(self.lower - q, -radius), np.minimum(self.upper - q, radius)
            H = J.T @ J + 1e-7 * np.eye(len(q))
            g = J.T @ (found - x)
            for share in (1.0, 0.5, 0.25, 0.125, 0.0):
                h = np.where(d < goal, share, 1.0) * (goal - d)
                s, force = _program(g, low, high, G, h, H)
                if s is not None:
                    break
            if s is None or np.abs(s).max() < 1e-7:
                break
            weight = max(weight, 2.0 * force)
            trial = np.clip(q + s, self.lower, self.upper)
            d_new, G_new = self.gradients(trial, self.margin + BAND)
            found_new, J_new = self.skeleton(trial)
            before, after = (np.sum((v - x) ** 2) / 2 for v in (found, found_new))
            short, short_new, left = (np.maximum(goal - v, 0).sum() for v in (d, d_new, d + G @ s))
            hoped = -(g @ s + s @ H @ s / 2) + weight * (short - left)
            got = before - after + weight * (short - short_new)
            if got > 0.1 * hoped and got > 0.0:
                q, d, G, found, J = trial, d_new, G_new, found_new, J_new
                radius = min(2.0 * radius, 1.0) if got > 0.7 * hoped else radius
                if got < 1e-10 and short_new <= 0.0:
                    break
            else:
                radius = 0.3 * min(radius, np.abs(s).max())
        return self._restored(q, step)

    def skeleton(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The seven unit vectors, neck between the shoulders, (21,), and dx/dq, by pinocchio."""
        pin.computeJointJacobians(self._model, self._data, q)
        at, J = {}, {}
        for role, point in self._points.items():
            joint, offset = point.joint + 1, point.offset * PER_METRE
            placed = self._data.oMi[joint]
            whole = np.zeros((6, len(q)))
            if joint:
                frame = pin.LOCAL_WORLD_ALIGNED
                whole = pin.getJointJacobian(self._model, self._data, joint, frame)
            arm = placed.rotation @ offset
            at[role] = placed.translation + arm
            J[role] = whole[:3] - pin.skew(arm) @ whole[3:]
        for map_ in (at, J):
            map_["neck"] = (map_["r_shoulder"] + map_["l_shoulder"]) / 2
        x, dx = [], []
        for tail, head in zip(_TAILS, _HEADS, strict=True):
            along = at[head] - at[tail]
            size = np.linalg.norm(along)
            u = along / size
            x.append(self._base @ u)
            dx.append(self._base @ (np.eye(3) - np.outer(u, u)) @ (J[head] - J[tail]) / size)
        return np.concatenate(x), np.concatenate(dx)

    def optimum(self, x: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """The pose nearest to x of all that are reached from starts (k, n_dof), [rad]."""
        found = [self.follow(x, start) for start in starts]
        feasible = [one.q for one in found if one.solved]
        return min(feasible, key=lambda q: float(np.sum((self.skeleton(q)[0] - x) ** 2)))

    def gradients(self, q: np.ndarray, band: float) -> tuple[np.ndarray, np.ndarray]:
        """Distances [m] closer than band, (k,), and their gradients [m/rad], (k, n_dof)."""
        close = self._closer_than(q, band)
        found = [self._scratch.distanceResults[int(k)] for k in close]
        d = np.array([result.min_distance for result in found])
        normal = np.array([result.normal for result in found]).reshape(-1, 3)
        # Axes that cross have no normal; any direction leads on from there.
        normal = np.where(np.isfinite(normal), normal, [0.0, 0.0, 1.0])
        pin.computeJointJacobians(self._model, self._data, q)
        frame = pin.LOCAL_WORLD_ALIGNED
        J = [np.zeros((6, len(q)))]
        for j in range(1, self._model.njoints):
            J.append(pin.getJointJacobian(self._model, self._data, j, frame))
        J = np.array(J)  # (n_dof + 1, 6, n_dof)
        origin = np.array([at.translation for at in self._data.oMi])
        G = np.zeros((len(close), len(q)))
        for side, sign in ((0, -1.0), (1, 1.0)):
            joint = self._joint[close, side]
            point = ("getNearestPoint1", "getNearestPoint2")[side]
            at = np.array([getattr(result, point)() for result in found]).reshape(-1, 3)
            arm = np.cross(at - origin[joint], normal)
            G += sign * np.einsum("ki,kij->kj", np.hstack([normal, arm]), J[joint])
        return d / PER_METRE, G / PER_METRE

    def _closer_than(self, q: np.ndarray, bound: float) -> np.ndarray:
        """Rows of the watched pairs that are closer than bound [m] at q."""
        results = self._scratch.distanceResults
        least = pin.computeDistances(self._model, self._data, self._geometry, self._scratch, q)
        if not results[least].min_distance < bound * PER_METRE:
            return np.empty(0, int)  # looking at every result takes far longer than they took
        return np.flatnonzero([result.min_distance < bound * PER_METRE for result in results])

    def _restored(self, q: np.ndarray, step: int) -> Nearest:
        """The pose q pushed to the margin by least-change steps where it is just short of it."""
        extra = SLACK
        for _ in range(8):
            d, G = self.gradients(q, self.margin + 0.02)
            if not (d < self.margin).any():
                return Nearest(q, True, step)
            h = self.margin + extra - d
            s, _ = _program(np.zeros(len(q)), self.lower - q, self.upper - q, G, h)
            if s is None:
                break
            q = np.clip(q + s, self.lower, self.upper)
            extra *= 2.0
        return Nearest(q, False, step)


def search(
    chain: Chain, want: np.ndarray, starts: np.ndarray, margin: float, best: np.ndarray
) -> np.ndarray:
    """The feasible pose nearest to want among best and what is reached from every start [rad].

    Args:
        chain: the robot.
        want: relaxed pose [rad], (n_dof,).
        starts: poses to start from [rad], (k, n_dof).
        margin: clearance to keep [m].
        best: a feasible pose to beat [rad], (n_dof,).
    """
    balls, out, none = reach(chain), np.empty(3), np.empty(0)
    for start in starts:
        trial = start.copy()
        minimise(chain, balls, False, none, want, 0.0, margin, True, 100, trial, out)
        if np.linalg.norm(trial - want) < np.linalg.norm(best - want) and (
            clearance_of(chain, balls, trial) >= margin or restore(chain, balls, margin, trial)
        ):
            # Restoring may have moved it away again.
            best = min(best, trial, key=lambda q: float(np.linalg.norm(q - want)))
    return best


def around(
    q: np.ndarray, count: int, lower: np.ndarray, upper: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Poses within limits at all scales from 0.03 to 1 rad around q (n_dof,), (count, n_dof)."""
    scale = 10.0 ** rng.uniform(-1.5, 0.0, (count, 1))
    return np.clip(q + scale * rng.normal(size=(count, len(q))), lower, upper)


def _program(g, lower, upper, G, h, H=None) -> tuple[np.ndarray | None, float]:
    """Least 1/2 s'Hs + g's with lower <= s <= upper, G s >= h; the largest multiplier of G.

    H is the identity where it is not given.
    """
    s, _, flag, about = daqp.solve(
        np.eye(len(g)) if H is None else H, g, np.ascontiguousarray(G),
        np.concatenate([upper, np.full(len(h), BIG)]), np.concatenate([lower, h]),
        primal_tol=1e-11,
    )  # fmt: skip
    if flag != 1:
        return None, 0.0
    return np.array(s), float(np.abs(about["lam"][len(g) :]).max(initial=0.0))
