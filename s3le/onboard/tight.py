"""Finer bodies where limbs pass: as many as pay in motion, for the pairs of links that need them.

Room is what capsules forbid and the pieces themselves do not, over poses as people move, the stand,
zero, and the T-pose. A pair of links whose usual bodies take some is watched by finer ones
(s3le.robot.pairs). There every piece begins as it is, and the piece that gains the most room for
each pair of bodies that another capsule adds gets one more, until none gains enough.
"""

import copy
import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from s3le.onboard import motion
from s3le.onboard.bodies import DIGITS, Made, element, rebuilt
from s3le.onboard.capsules import Capsule, hull_volume, reach_beyond, to_segment
from s3le.onboard.covering import bodies_of
from s3le.onboard.source import Shape, Source
from s3le.onboard.splitting import WAYS, Part, Splitter
from s3le.robot.model import Geometry
from s3le.robot.urdf import FINE

WORTH = 8e-4  # of room that each further pair must give
_INSISTS = 40  # cuts at most, gain or not, where pieces keep the robot from a named pose
_INSISTED = 3  # ways to cut a part there whose capsules are searched well
MOST = 20  # capsules of one piece
FINER = 2e-3  # of room that the usual bodies of two links may take
_TRIED = 2  # parts that are cut on trial: those that take most room
_FITTED = 1  # cuts of each count whose capsules are searched well
_FORBIDS = 0.2  # of room that a pair counts more while it forbids a named pose
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

    def tighten(
        self, named: Sequence[np.ndarray], every: bool
    ) -> tuple[set[frozenset[str]], list[str]]:
        """Put finer bodies into the URDF's elements, and say for which pairs of links.

        Args:
            named: poses that matter most [rad], (n_dof,): the stand, arms held out, zero.
            every: for all pairs of links that come near; False: for those whose usual bodies forbid
                the stand, or overlap although the links are apart where arms are held out.

        Returns:
            Pairs of links that are to be watched by their finer bodies, and a line for a person.
        """
        shown = motion.poses(self.robot, named, _NAMED)
        off = frozenset(self.robot.disabled)
        self.standing: set[frozenset[str]] = set()
        if not every:
            off |= self._beside(shown, off)
        coarse = [piece.capsules for piece in self.pieces]
        self.room = room = motion.Room(self.robot, self.pieces, shown, self.margin, off)
        for k, one in enumerate(self.pieces):
            if not one.exact:
                self.splits[k] = Splitter(self.shape[k].triangles.reshape(-1, 3))
                self._settle(k, self._begin(k))
        room.measure()
        single = [piece.capsules for piece in self.pieces]
        self._hold(coarse)
        taken = {self._links(pair): 0.0 for pair in room.near}
        for pair in room.near:
            taken[self._links(pair)] += room.cost(pair) + room.forbids(pair)
        least = FINER if every else 0.0
        room.near = {
            pair: near for pair, near in room.near.items() if taken[self._links(pair)] > least
        }
        before = sum(room.cost(pair) for pair in room.near)
        self._hold(single)
        self.cost = {pair: room.cost(pair) for pair in room.near}
        asked = {k for pair in room.near for k in pair} & set(self.splits)
        for k in asked:
            turn = self.pieces[k].at.rotation
            ways, weights = room.sides(k, WAYS @ turn.T)
            self.splits[k].look(ways @ turn, weights)
        self.grow(WORTH, asked)
        for k in sorted({k for pair in room.near if self._forbids(pair) for k in pair} & asked):
            self._regrid(k, coarse[k])
        for _ in range(_INSISTS):
            held = [pair for pair in room.near if self._forbids(pair)]
            worst = sorted(held, key=lambda pair: -self.cost[pair])
            if not any(self._insist(pair) for pair in worst):
                break
        after = sum(self.cost.values())
        finer = {self._links(pair) for pair in room.near}
        count = self._written({link for pair in finer for link in pair})
        if not finer:
            return finer, []
        return finer, [
            f"bodies: {count} finer ones for {len(finer)} pairs of links that come near; what they "
            f"take of the room that people use fell from {before:.2f} to {after:.2f}"
        ]

    def _beside(self, shown: motion.Shown, off: frozenset[frozenset[str]]) -> set[frozenset[str]]:
        """Pairs of links whose usual bodies are left as they are."""
        named = shown._replace(q=shown.q[: shown.named], weight=shown.weight[: shown.named])
        room = motion.Room(self.robot, self.pieces, named, self.margin, off)
        room.measure()
        self.standing = {self._links(pair) for pair in room.near if room.forbids(pair, 1)}
        overlap = {self._links(pair) for pair in room.near if room.overlap(pair)}
        self.standing -= overlap
        two = combinations((piece.link for piece in self.pieces), 2)
        return {frozenset(links) for links in two} - self.standing - overlap

    def _forbids(self, pair: tuple[int, int]) -> bool:
        """Do bodies forbid a named pose? Of some pairs the stand alone is asked."""
        return self.room.forbids(pair, 1 if self._links(pair) in self.standing else None)

    def _begin(self, k: int) -> list[Part]:
        """A piece as its usual bodies hold it, or in the one capsule that reaches less far."""
        splitter, own = self.splits[k], self.made[self.slot[k]]
        usual = [Part(p, c) for p, c in zip(own.points, own.capsules, strict=True)]
        ways = [way for way in (usual, [splitter.whole()]) if way]
        return min(ways, key=lambda way: splitter.furthest([part.capsule for part in way]))

    def _hold(self, capsules: Sequence[list[Capsule]]) -> None:
        for piece, held in zip(self.pieces, capsules, strict=True):
            piece.capsules = held

    def _links(self, pair: tuple[int, int]) -> frozenset[str]:
        return frozenset(self.pieces[k].link for k in pair)

    def _settle(self, k: int, parts: list[Part]) -> None:
        self.parts[k] = parts
        self._put(k, parts)
        self.ahead.pop(k, None)

    def _put(self, k: int, parts: Sequence[Part]) -> None:
        piece = self.pieces[k]
        piece.capsules = motion.moved([part.capsule for part in parts], piece.at)

    def _regrid(self, k: int, usual: Sequence[Capsule]) -> None:
        """Cut a whole piece anew, into the grid that is worth most, if one is worth more.

        None that reaches farther than the usual bodies (in the frame of the piece's joint) do.
        """

        def worth(parts: list[Part]) -> float:
            self._put(k, parts)
            held = sum(_FORBIDS * self._forbids(pair) for pair in pairs)
            return sum(map(self.room.cost, pairs)) + held + WORTH * len(parts) * self.price(k)

        pairs = self.room.partners(k)
        limit = self.splits[k].furthest(motion.moved(usual, self.pieces[k].at.inverse()))
        best = min([self.parts[k], *self.splits[k].grids(self.most, limit)], key=worth)
        self._settle(k, best)
        for pair in pairs:
            self.cost[pair] = self.room.cost(pair)

    def _insist(self, pair: tuple[int, int]) -> bool:
        """Cut what of a pair takes most room, whether that gains at once or not; was there any?"""
        best: tuple[tuple[float, float], int, list[Part]] | None = None
        for k in (k for k in pair if k in self.splits and len(self.parts[k]) < self.most):
            splitter, parts = self.splits[k], self.parts[k]
            own, other = self.pieces[k], self.pieces[pair[0] if pair[1] == k else pair[1]]
            rows = self.room.near[pair].rows
            each = [self.room.apart(replace(own, capsules=[c]), other, rows) for c in own.capsules]
            n = int(np.argmin(np.min(each, axis=1)))
            ways = sorted(
                splitter.cuts(parts[n]),
                key=lambda cells: splitter.excess([cell.capsule for cell in cells]),
            )
            for cells in ways[:_INSISTED]:
                cells = [cell._replace(capsule=splitter.fit(cell.points)) for cell in cells]
                made = [*parts[:n], *cells, *parts[n + 1 :]]
                finite = np.isfinite([cell.capsule.radius for cell in cells]).all()
                if len(made) <= self.most and finite:
                    score = (
                        self._score(k, made, [pair]),
                        splitter.excess([c.capsule for c in cells]),
                    )
                    if best is None or score < best[0]:
                        best = score, k, made
            self._put(k, self.parts[k])
        if best is None:
            return False
        self._settle(best[1], best[2])
        for near in self.room.partners(best[1]):
            self.cost[near] = self.room.cost(near)
        return True

    def price(self, k: int) -> int:
        """Pairs that a further capsule of a piece makes."""
        partners = {j for pair in self.room.partners(k) for j in pair} - {k}
        return sum(len(self.pieces[j].capsules) for j in partners)

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

    def _score(self, k: int, parts: Sequence[Part], pairs: Sequence[tuple[int, int]]) -> float:
        self._put(k, parts)
        return sum(self.room.cost(pair) for pair in pairs)

    def _written(self, links: set[str]) -> int:
        """Add the finer bodies of some links to the URDF's elements; how many."""
        found = {link.get("name"): link for link in self.source.root.findall("link")}
        count = 0
        for k, piece in enumerate(self.pieces):
            if piece.link not in links:
                continue
            own = self.made[self.slot[k]]
            made = own if k not in self.parts else remade(own, self.shape[k], self.parts[k])
            for item in made.elements:
                item = copy.deepcopy(item)
                item.set("name", FINE)
                found[piece.link].append(item)
                count += 1
        return count


def thicken(source: Source, link: str, by: float) -> None:
    """Add to the radii of a link's finer bodies [m], so that they hold more of what is drawn."""
    (found,) = (one for one in source.root.findall("link") if one.get("name") == link)
    for item in found.findall("collision"):
        shape = item.find("geometry/*")
        if item.get("name") == FINE and shape is not None and shape.tag in ("capsule", "sphere"):
            radius = float(shape.get("radius", "0")) + by
            shape.set("radius", f"{math.ceil(radius * 10**DIGITS) / 10**DIGITS:.{DIGITS}f}")


def drop(source: Source) -> None:
    """Take all finer bodies out of the URDF's elements."""
    for link in source.root.findall("link"):
        for item in link.findall("collision"):
            if item.get("name") == FINE:
                link.remove(item)


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
