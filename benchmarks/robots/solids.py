"""A robot as its maker has it, in convex pieces: how far they are apart, and the best poses.

The pieces are those that `s3le robot new` makes bodies around: convex hulls of collision shapes,
or of what is drawn where that reaches beyond them; spheres and capsules are themselves. Asked are
pairs of links that the robot file watches (some pair of their bodies is), but not neighbours, and
not pieces that lie within the margin at anchor, zero or stand: these are built into each other,
and to leave them out makes the hulls freer, never less free.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import sources
from scipy.spatial import ConvexHull

from s3le.kernels import qp
from s3le.kernels.kinematics import bones, place
from s3le.onboard import bodies, covering, motion, reading, tight
from s3le.onboard.capsules import directions
from s3le.robot import pairs
from s3le.robot.robot import Robot
from s3le.safety import covered

BAND = 0.05  # [m] beyond the margin in which a pair enters a step
SLACK = 2e-5  # [m] beyond the margin that a step aims at
STEPS = 80  # of a solution at most
STILL = 1e-6  # [rad], a step as small is the last


def original(robot: Robot, word: str, folder: Path) -> "Solids":
    """The robot as its maker has it.

    Args:
        robot: whose pieces are wanted.
        word: its name in recipes.yaml, a robot file called so, or FILE.yaml=ORIGINAL.
        folder: of sources.

    Raises:
        RobotError: there is no recipe of this name, or its source is missing.
    """
    name, _, given = word.partition("=")
    if given:
        file = Path(given)
        return Solids(robot, file, [folder, *file.resolve().parents[:6]])
    recipe = sources.recipes([Path(name).stem])[0]
    return Solids(robot, sources.located(recipe, folder), [folder / at for at in recipe.packages])


def reach(robot: Robot, hulls: Mapping[str, Sequence[np.ndarray]]) -> dict[str, float]:
    """How far the bodies of each link reach beyond its hulls [m]; finer ones where it has them.

    Over 400 points of each body, each against the faces of the hull that it is least beyond.

    Args:
        robot: whose bodies are asked.
        hulls: of each link the corners of its pieces [m], (n, 3), in the frame of its joint.
    """
    faces = {link: [ConvexHull(c).equations for c in pieces] for link, pieces in hulls.items()}
    fine = {body.link for body in robot.bodies if body.fine}
    found: dict[str, float] = {}
    ways = directions(400)
    for body in robot.bodies:
        if body.link in faces and body.fine == (body.link in fine):
            ends = np.where((ways @ (body.b - body.a) > 0.0)[:, None], body.b, body.a)
            points = ends + body.radius * ways
            beyond = [(points @ f[:, :3].T + f[:, 3]).max(axis=1) for f in faces[body.link]]
            far = float(np.min(beyond, axis=0).max())
            found[body.link] = max(found.get(body.link, 0.0), far)
    return found


class Solids:
    """Pieces of a robot and the pairs of them that are asked."""

    def __init__(self, robot: Robot, file: Path, packages: Sequence[Path] = ()) -> None:
        """Read them.

        Args:
            robot: whose pieces these are.
            file: URDF or MJCF as its maker has it.
            packages: folders of packages.

        Raises:
            RobotError: it cannot be read.
        """
        origin = reading.read(file, packages)
        made = covering.cover(origin, bodies.MOST, {}, covered.ALLOWANCE, False).made
        self.robot, self.origin = robot, origin
        self.work = work = tight.Work(origin, robot, made, robot.margin, tight.MOST)
        self.pieces = work.pieces
        self._corners = [shape.triangles.reshape(-1, 3) for shape in work.shape]
        self._model, _ = robot.reduced()
        self._data = self._model.createData()
        self._ask, self._found = coal.DistanceRequest(), coal.DistanceResult()
        for piece in self.pieces:
            piece.solid.computeLocalAABB()
        self._middle = np.array([piece.solid.aabb_center for piece in self.pieces])
        self._radius = np.array([piece.solid.aabb_radius for piece in self.pieces])
        # Joints that carry each piece.
        self._moves = np.zeros((len(self.pieces), robot.n_dof))
        for k, piece in enumerate(self.pieces):
            self._moves[k, robot.path_to(piece.joint)] = 1.0
        listed = {
            frozenset(robot.bodies[k].link for k in (pair.a, pair.b))
            for pair in robot.pairs if pair.reason in pairs.KEPT
        }  # fmt: skip
        near = motion.joined(robot, self.pieces)
        self.pairs = np.array(
            [(i, j) for i, one in enumerate(self.pieces) for j, two in enumerate(self.pieces)
             if i < j and one.joint != two.joint
             and frozenset((one.joint, two.joint)) not in near
             and frozenset((one.link, two.link)) in listed]
        ).reshape(-1, 2)  # fmt: skip
        built = set()
        zero = np.clip(np.zeros(robot.n_dof), robot.lower, robot.upper)
        for q in (robot.anchor, zero, *([] if robot.stand is None else [robot.stand])):
            rows, apart = self.measure(q)
            built |= set(rows[~(apart >= robot.margin)].tolist())
        self.built = [self.links(row) for row in sorted(built)]
        self.pairs = np.delete(self.pairs, sorted(built), axis=0)

    def links(self, row: int) -> str:
        """The two links of a pair."""
        return " and ".join(sorted(self.pieces[k].link for k in self.pairs[row]))

    def measure(self, q: np.ndarray, within: float = BAND) -> tuple[np.ndarray, np.ndarray]:
        """Rows of pairs that may be within a distance [m] at q (n_dof,) [rad]; how far they are."""
        pin.forwardKinematics(self._model, self._data, q)
        return self._near(within)[:2]

    def clear(self, q: np.ndarray) -> float:
        """Least signed distance of all pairs at q (n_dof,) [rad]; at most BAND [m]."""
        return float(self.measure(q)[1].min(initial=BAND))

    def reach(self) -> dict[str, float]:
        """How far the bodies of each link reach beyond its hulls [m]."""
        held: dict[str, list[np.ndarray]] = {}
        for piece, corners in zip(self.pieces, self._corners, strict=True):
            if len(corners):
                at = piece.stands
                held.setdefault(piece.link, []).append(corners @ at.rotation.T + at.translation)
        return reach(self.robot, held)

    def placed(self, q: np.ndarray) -> list[np.ndarray]:
        """Corners of all hulls at q (n_dof,) [rad]: (n, 3) [m], x forward, y left, z up."""
        pin.forwardKinematics(self._model, self._data, q)
        placed = [self._data.oMi[piece.joint + 1] * piece.stands for piece in self.pieces]
        return [
            (corners @ at.rotation.T + at.translation) @ self.robot.base_rotation.T
            for at, corners in zip(placed, self._corners, strict=True) if len(corners)
        ]  # fmt: skip

    def gradients(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows of near pairs at q, their distances [m] and d distance / d q, (k, n_dof)."""
        spun = pin.computeJointJacobians(self._model, self._data, q)
        rows, apart, normal, at = self._near(self.robot.margin + BAND)
        linear, turning = spun[:3].T, spun[3:].T  # (n_dof, 3), of what is at the origin
        # d distance = normal . (movement of the second point - that of the first)
        push = linear @ normal.T  # (n_dof, k)
        parts = []
        for side in (0, 1):
            turned = turning @ np.cross(at[:, side], normal).T
            parts.append((push + turned).T * self._moves[self.pairs[rows, side]])
        return rows, apart, parts[1] - parts[0]

    def _near(self, within: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Rows, distances, normals and nearest points, at what the model's data hold."""
        placed = [self._data.oMi[piece.joint + 1] * piece.stands for piece in self.pieces]
        centre = np.array([at.act(m) for at, m in zip(placed, self._middle, strict=True)])
        a, b = self.pairs.T
        gap = np.linalg.norm(centre[a] - centre[b], axis=1) - self._radius[a] - self._radius[b]
        rows = np.flatnonzero(~(gap > within))
        put = [coal.Transform3s(at.rotation, at.translation) for at in placed]
        n = len(rows)
        apart, normal, at = np.empty(n), np.empty((n, 3)), np.empty((n, 2, 3))
        for i, (a, b) in enumerate(self.pairs[rows]):
            self._found.clear()
            apart[i] = coal.distance(
                self.pieces[a].solid, put[a], self.pieces[b].solid, put[b], self._ask, self._found
            )
            normal[i] = self._found.normal
            at[i] = self._found.getNearestPoint1(), self._found.getNearestPoint2()
        return rows, apart, normal, at

    def best(self, x: np.ndarray, start: np.ndarray, ridge: float) -> np.ndarray | None:
        """The pose near `start` whose skeleton is nearest to x and whose pieces keep the margin.

        Sequential quadratic programs on witness points, as the kernels do it on capsules
        (s3le/kernels/solver.py). Verified by coal at the end.

        Args:
            x: wanted, (21,), as the robot sees it.
            start: [rad], (n_dof,).
            ridge: pull towards the middle of the limits.

        Returns:
            The pose; None: none was found that keeps them apart.
        """
        robot = self.robot
        middle, goal = (robot.lower + robot.upper) / 2, robot.margin + SLACK
        q = np.clip(start, robot.lower, robot.upper)
        cost, g, H = self._cost(q, x, middle, ridge)
        _, d, G = self.gradients(q)
        radius, weight = 0.3, 1.0
        for _ in range(STEPS):
            s, most = self._step(q, g, H, d, G, goal, radius)
            if s is None or np.abs(s).max() < STILL:
                break
            weight = max(weight, 2.0 * most)
            new = np.clip(q + s, robot.lower, robot.upper)
            short = np.maximum(goal - d, 0.0).sum()
            hoped = -(g @ s + 0.5 * s @ H @ s)
            hoped += weight * (short - np.maximum(goal - d - G @ s, 0.0).sum())
            cost_new, g_new, H_new = self._cost(new, x, middle, ridge)
            _, d_new, G_new = self.gradients(new)
            got = cost - cost_new + weight * (short - np.maximum(goal - d_new, 0.0).sum())
            if got > 0.1 * hoped and got > 0.0:
                q, cost, g, H, d, G = new, cost_new, g_new, H_new, d_new, G_new
                radius = min(2.0 * radius, 0.6) if got > 0.7 * hoped else radius
                if got < 1e-9 and d.min(initial=BAND) >= robot.margin:
                    break
            else:
                radius = 0.3 * min(radius, float(np.abs(s).max()))
        return q if self.clear(q) >= robot.margin else None

    def _cost(
        self, q: np.ndarray, x: np.ndarray, middle: np.ndarray, ridge: float
    ) -> tuple[float, np.ndarray, np.ndarray]:
        """Half the squares, their gradient, and Gauss and Newton's Hessian."""
        n, chain = len(q), self.robot.chain
        R, p, z, at, J = (np.empty(shape) for shape in
                          ((n + 1, 3, 3), (n + 1, 3), (n, 3), 21, (21, n)))  # fmt: skip
        place(chain, q, R, p, z)
        bones(chain, R, p, z, at, J)
        off, away = at - x, q - middle
        return (
            0.5 * float(off @ off) + 0.5 * ridge * float(away @ away),
            J.T @ off + ridge * away,
            J.T @ J + ridge * np.eye(n),
        )

    def _step(
        self, q: np.ndarray, g: np.ndarray, H: np.ndarray, d: np.ndarray, G: np.ndarray,
        goal: float, radius: float,
    ) -> tuple[np.ndarray | None, float]:  # fmt: skip
        """A step within the box and its largest multiplier; None: there is none."""
        factor, s, most = np.empty_like(H), np.empty(len(q)), np.zeros(1)
        if not qp.inverse_factor(H, factor):
            return None, 0.0
        low = np.maximum(self.robot.lower - q, -radius)
        high = np.minimum(self.robot.upper - q, radius)
        share = 1.0
        while True:
            h = np.where(goal - d > 0.0, (goal - d) * share, goal - d)
            if qp.solve(factor, g, low, high, G, h, len(h), s, most) == qp.SOLVED:
                return s, float(most[0])
            if share == 0.0:
                return None, 0.0
            share = share * 0.5 if share > 0.2 else 0.0
