"""More capsules where limbs pass, fewer where nothing comes: bodies by what they cost in motion.

Every piece begins with one capsule. The piece that gains the most room for each pair of bodies
that another capsule adds gets one more, until none gains enough. Room is what capsules forbid and
the pieces themselves do not, over poses as people move, the stand, zero, and the T-pose.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from s3le.onboard import motion
from s3le.onboard.bodies import Made, element, rebuilt
from s3le.onboard.capsules import Capsule, hull_volume, reach_beyond, to_segment
from s3le.onboard.covering import bodies_of
from s3le.onboard.source import Shape, Source
from s3le.onboard.splitting import WAYS, Part, Splitter
from s3le.robot.model import Geometry

WORTH = 8e-4  # of room that each further pair must give
_INSISTS = 0.1  # of WORTH, where a piece keeps the robot from standing
_SPARE = 0.2  # of the pairs, so many more for the sake of reach
_SLIM = 4  # capsules that a piece may have for its reach alone
MOST = 16  # capsules of one piece
REACH = 0.015  # [m] that capsules are to reach at most beyond a piece that an arm carries
_TRIED = 2  # parts that are cut on trial: those that take most room
_FITTED = 1  # cuts of each count whose capsules are searched well
_NAMED = 0.2  # that a named pose counts, beside 1 for all others together


class Work:
    """Pieces of a robot and how each is cut so far."""

    def __init__(
        self, source: Source, robot: Geometry, made: Sequence[Made], margin: float, most: int
    ) -> None:
        """Look at the pieces.

        Args:
            source: its elements hold the bodies of `made`, and will be changed.
            robot: the robot that they describe; its anchor may be anything.
            made: bodies, link by link in the order of the source's shapes.
            margin: clearance that poses keep [m].
            most: capsules at most for a piece.
        """
        self.source, self.robot, self.made = source, robot, list(made)
        self.margin, self.most = margin, most
        self.slot: list[int] = []  # of each piece: its row in made
        self.shape: list[Shape] = []
        self.pieces: list[motion.Piece] = []
        for row, body, shape in _shapes(source, made):
            held = [Capsule(*c) for c in bodies_of(rebuilt(body))] if len(shape.triangles) else []
            if (one := motion.piece(robot, body.link, shape, held)) is not None:
                self.slot.append(row)
                self.shape.append(shape)
                self.pieces.append(one)
        self.splits: dict[int, Splitter] = {}
        self.parts: dict[int, list[Part]] = {}  # as they are now
        self.ahead: dict[int, list[list[Part]]] = {}  # ways to go on from there

    def tighten(self, named: Sequence[np.ndarray]) -> tuple[list[Made], list[str]]:
        """Choose how many capsules each piece has, and put them into the URDF's elements.

        Args:
            named: poses that matter most [rad], (n_dof,): the stand, arms held out, zero.

        Returns:
            The bodies, in the order of those given, and a line for a person.
        """
        shown = motion.poses(self.robot, named, _NAMED)
        off = frozenset(self.robot.disabled)
        self.room = motion.Room(self.robot, self.pieces, shown, self.margin, off)
        for k, one in enumerate(self.pieces):
            if not one.exact:
                self.splits[k] = Splitter(self.shape[k].triangles.reshape(-1, 3))
                self._settle(k, [self.splits[k].whole()])
        self.room.measure()
        self.cost = {pair: self.room.cost(pair) for pair in self.room.near}
        for k, splitter in self.splits.items():
            splitter.weights = self.room.sides(k, WAYS @ self.pieces[k].at.rotation.T)
        before = self.total()
        self.grow(WORTH, set(self.splits))
        self.slim()
        while held := [pair for pair in self.room.near if self.room.forbids(pair)]:
            if not self.grow(WORTH * _INSISTS, {k for pair in held for k in pair}, 1):
                break
        more = sum(len(parts) - 1 for parts in self.parts.values())
        made = self._written()
        if not more:
            return made, []
        return made, [
            f"bodies: {more} capsules more than one a piece, where limbs pass; what they take of "
            f"the room that people use fell from {before:.2f} to {self.total():.2f}"
        ]

    def _settle(self, k: int, parts: list[Part]) -> None:
        self.parts[k] = parts
        self._put(k, parts)
        self.ahead.pop(k, None)

    def _put(self, k: int, parts: Sequence[Part]) -> None:
        piece = self.pieces[k]
        piece.capsules = motion.moved([part.capsule for part in parts], piece.at)

    def total(self) -> float:
        """Room that all capsules take."""
        return sum(self.cost.values())

    def price(self, k: int) -> int:
        """Bodies that a further capsule of a piece makes pairs with."""
        own = self.pieces[k]
        return sum(len(p.capsules) for p in self.pieces if p.joint != own.joint)

    def grow(self, worth: float, among: set[int], most: int | None = None) -> int:
        """Give capsules to those pieces who gain most by them; returns how often.

        Args:
            worth: room that each further pair must give.
            among: pieces that may get some.
            most: how often at most.
        """
        known: dict[int, tuple[float, list[Part]]] = {}
        done = 0
        while most is None or done < most:
            for k in self.splits:
                if k in among and k not in known:
                    known[k] = self._gain(k, worth)
            best = max(known, key=lambda k: known[k][0], default=None)
            if best is None or known[best][0] < worth:
                return done
            done += 1
            self._settle(best, known[best][1])
            for pair in self.room.partners(best):
                self.cost[pair] = self.room.cost(pair)
                for k in pair:
                    known.pop(k, None)
        return done

    def _gain(self, k: int, worth: float) -> tuple[float, list[Part]]:
        """Room for each further pair of the best way to cut one of a piece's parts."""
        pairs = [pair for pair in self.room.partners(k) if self.cost[pair] > 0.0]
        now, price = sum(self.cost[pair] for pair in pairs), self.price(k)
        best: tuple[float, list[Part]] = (0.0, [])
        if now > worth * price and k not in self.ahead:
            self.ahead[k] = self._cut(k, pairs)
        for parts in self.ahead.get(k, []):
            more = len(parts) - len(self.parts[k])
            gain = (now - self._score(k, parts, pairs)) / (price * more)
            best = max(best, (gain, parts), key=lambda one: one[0])
        self._put(k, self.parts[k])
        return best

    def _cut(self, k: int, pairs: Sequence[tuple[int, int]]) -> list[list[Part]]:
        """Ways to cut one of the parts that take most room, well fitted, a few of each count."""
        splitter, parts = self.splits[k], self.parts[k]
        found: dict[int, list[tuple[float, list[Part], list[Part]]]] = {}
        for n in np.argsort(-self.room.blame(k), kind="stable")[:_TRIED]:
            for cells in splitter.cuts(parts[n]):
                made = [*parts[:n], *cells, *parts[n + 1 :]]
                if len(made) <= self.most:
                    score = self._score(k, made, pairs)
                    found.setdefault(len(cells), []).append((score, made, cells))
        out = []
        for rows in found.values():
            for _, made, cells in sorted(rows, key=lambda row: row[0])[:_FITTED]:
                held = {id(cell) for cell in cells}
                out.append([
                    one._replace(capsule=splitter.fit(one.points)) if id(one) in held else one
                    for one in made
                ])  # fmt: skip
                out.append(made)
        return out

    def slim(self) -> None:
        """Cut what arms carry until it reaches no farther than it should, while pairs stay few."""
        trunk = {-1, *self.robot.path_to(self.robot.points["neck"].joint)}
        arms = [k for k in self.splits if self.pieces[k].joint not in trunk]
        left = _SPARE * self._pairs()
        tried = [(k, self._slimmer(k)) for k in arms]
        for k, parts in sorted(tried, key=lambda one: len(one[1]) - len(self.parts[one[0]])):
            pairs = self.room.partners(k)
            now = sum(self.room.cost(pair) for pair in pairs)
            price = (len(parts) - len(self.parts[k])) * self.price(k)
            if 0 < price <= left and self._score(k, parts, pairs) <= now + WORTH:
                left -= price
                self._settle(k, parts)
            self._put(k, self.parts[k])
        self.cost = {pair: self.room.cost(pair) for pair in self.room.near}

    def _slimmer(self, k: int) -> list[Part]:
        """A piece in more capsules, none of which reaches too far; as it is where few do not do."""
        splitter, parts = self.splits[k], self.parts[k]
        splitter.weights = np.ones(len(WAYS))
        while self._reach(k, parts) > REACH:
            n = int(np.argmax([splitter.excess([part.capsule]) for part in parts]))
            cells = min(
                (cut for cut in splitter.cuts(parts[n]) if len(cut) == 2),
                key=lambda cut: splitter.excess([cell.capsule for cell in cut]), default=None,
            )  # fmt: skip
            if cells is None or len(parts) >= min(self.most, _SLIM):
                return self.parts[k]
            cells = [cell._replace(capsule=splitter.fit(cell.points)) for cell in cells]
            parts = [*parts[:n], *cells, *parts[n + 1 :]]
        return parts

    def _pairs(self) -> int:
        """Pairs of bodies that can move against each other."""
        count = Counter[int]()
        for piece in self.pieces:
            count[piece.joint] += len(piece.capsules)
        return (count.total() ** 2 - sum(n * n for n in count.values())) // 2

    def _reach(self, k: int, parts: Sequence[Part]) -> float:
        return reach_beyond([part.capsule for part in parts], self.splits[k].corners)

    def _score(self, k: int, parts: Sequence[Part], pairs: Sequence[tuple[int, int]]) -> float:
        self._put(k, parts)
        return sum(self.room.cost(pair) for pair in pairs)

    def _written(self) -> list[Made]:
        """The bodies as the URDF has them now."""
        links = {link.get("name"): link for link in self.source.root.findall("link")}
        for k, parts in self.parts.items():
            old = self.made[self.slot[k]]
            new = remade(old, self.shape[k], parts)
            self.made[self.slot[k]] = new
            link = links[old.link]
            at = list(link).index(old.elements[0])
            for item in old.elements:
                link.remove(item)
            for n, item in enumerate(new.elements):
                link.insert(at + n, item)
        return self.made


def remade(old: Made, shape: Shape, parts: Sequence[Part]) -> Made:
    """A piece with the capsules of its parts; a box or cylinder with one stays itself."""
    if len(parts) == 1 and not old.capsules:
        return old
    corners = shape.triangles.reshape(-1, 3)
    # Every corner is held by name, not only as a point of the hull that was cut.
    far = [to_segment(corners, p.capsule.a, p.capsule.b) - p.capsule.radius for p in parts]
    nearest = np.argmin(far, axis=0)
    held = [np.concatenate([p.points, corners[nearest == k]]) for k, p in enumerate(parts)]
    written = [element(part.capsule, points) for part, points in zip(parts, held, strict=True)]
    solid = [capsule for _, capsule in written]
    return old._replace(
        elements=[item for item, _ in written], capsules=solid, points=held,
        hull=hull_volume(corners), adds=reach_beyond(solid, corners),
    )  # fmt: skip


def _shapes(source: Source, made: Sequence[Made]) -> list[tuple[int, Made, Shape]]:
    """The shapes that each of `made` stands for: one, or a list of spheres."""
    found: list[tuple[int, Made, Shape]] = []
    used: dict[str, int] = {}
    for row, body in enumerate(made):
        if body.kind == "spheres":
            none = np.empty((0, 3, 3))
            found += [(row, body, Shape("sphere", np.eye(3), at, (radius,), none))
                      for at, _, radius in bodies_of(rebuilt(body))]  # fmt: skip
            continue
        k = used.setdefault(body.link, 0)
        used[body.link] += 1
        found.append((row, body, source.shapes[body.link][k]))
    return found
