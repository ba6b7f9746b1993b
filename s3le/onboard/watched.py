"""What is watched of a robot whose joints are known: finer bodies, pairs taken off, the anchor.

All pairs but neighbours are, against how deep they overlap where the robot stands. Where usual
bodies would forbid what the robot is built for, links get finer ones; where those do not do, their
pair is taken off, and said.
"""

import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from s3le.errors import RobotError
from s3le.onboard import anchor, bodies, covering, motion, source, stand, tight, touching
from s3le.onboard.plan import Plan
from s3le.robot import model, pairs, srdf
from s3le.robot.robot import Robot
from s3le.safety import covered

_FREE = 0.006  # [m] beyond the margin that parts keep where arms hang: capsules are no hulls
_APART = (
    "bodies overlap, but hulls of all that is drawn are proven apart at any angles, so these are "
    "taken off in the SRDF: "
)


@dataclass
class Asked:
    """What `robot new` was asked for."""

    urdf: Path  # that was read
    margin: float  # clearance that poses keep [m]
    neck: str  # skeleton.NECKS
    allowance: float  # how far a link's drawing may reach beyond its bodies [m]
    finer: bool  # finer bodies wherever links come near


@dataclass
class Settling:
    """A plan on its way; what is found goes into it, and into its files."""

    plan: Plan
    folder: Path  # of its own, for the files so far
    origin: source.Source
    made: Sequence[bodies.Made]
    record: covered.Record  # how far links are drawn beyond their bodies
    asked: Asked
    sure: list[str]
    look: list[str]
    _cut: bool = False  # finer bodies were made, even if they were taken back

    def settle(self, poses: Mapping[str, Mapping[str, float]]) -> anchor.Found:
        """Settle stand, finer bodies, pairs and anchor.

        Args:
            poses: that its maker named: joint -> angle [rad].

        Raises:
            RobotError: no pose is feasible.
        """
        plan, robot = self.plan, self.plan.load(self.folder)
        plan.baselines = True
        work, named = self._standing(robot, poses)
        if never := touching.never(
            robot, self.origin, work.pieces, motion.poses(robot, named[:2], 1.0), self.asked.margin
        ):
            self._off(robot, never)
            self.sure.append(_APART + _listed(never))
        best, work = self._once(named)
        locked = self._locked(work, named)
        vain = [one for one in locked if one.off and sorted(one.links) in plan.finer]
        if vain:  # finer bodies that do not do are taken back
            tight.drop(self.origin)
            self._off(plan.load(self.folder), {one.links: one.why() for one in vain})
            best, work = self._once(named)
            locked = vain + self._locked(work, named)
        self._off(plan.load(self.folder), {one.links: one.why() for one in locked if one.off})
        self._farther(plan.load(self.folder))
        self.sure += [*self._said, f"stand: {self._how}"]
        for one in locked:
            off = " are taken off in the SRDF" if one.off else ""
            if one.off or one.lost > touching.LOCKED:
                self.look.append(f"{' and '.join(sorted(one.links))}{off}: {one.why()}")
        return best

    def _standing(
        self, robot: model.Geometry, poses: Mapping[str, Mapping[str, float]]
    ) -> tuple[tight.Work, list[np.ndarray]]:
        """How it stands; and that pose, one with its arms held out, zero."""
        work = tight.Work(self.origin, robot, self.made, self.asked.margin, tight.MOST)
        found, out, self._clear = standing(robot, self.asked.neck, work, poses, self.asked.margin)
        self._stands(robot, found)
        return work, [found.q, out, anchor.zero(robot)]

    def _stands(self, robot: model.Geometry, found: stand.Stand) -> None:
        self.plan.stand = dict(zip(robot.joint_names, found.q.tolist(), strict=True))
        self._how, self._hangs = found.how, found.hangs

    def _farther(self, robot: model.Geometry) -> None:
        """Where bodies still forbid a stand that no file names, its arms hang farther outwards."""
        margin, neck = self.asked.margin, self.asked.neck
        certifier = Robot.from_file(
            self.folder / f"{self.plan.name}.yaml", margin, neck
        ).certifier()
        assert robot.stand is not None
        if self._hangs and not certifier.one(robot.stand)[0] >= margin:
            found = stand.propose(
                robot, {}, lambda q: min(self._clear(q), certifier.one(q)[0] + _FREE),
                margin + _FREE,
            )  # fmt: skip
            if certifier.one(found.q)[0] >= margin:
                self._stands(robot, found)

    def _once(self, named: Sequence[np.ndarray]) -> tuple[anchor.Found, tight.Work]:
        """Finer bodies where they are wanted, and the anchor with them."""
        plan, origin, margin = self.plan, self.origin, self.asked.margin
        work = tight.Work(origin, plan.load(self.folder), self.made, margin, tight.MOST)
        finer, self._said = work.tighten(named, self.asked.finer)
        plan.finer = sorted(map(sorted, finer))
        if finer or self._cut:
            self._cut = True
            self._measure({link for pair in finer for link in pair})
        plan.files[f"urdf/{plan.name}.urdf"] = source.text(origin.root).encode()
        return self._anchor(plan.load(self.folder)), work

    def _measure(self, cut: set[str]) -> None:
        """Hold all bodies against what is drawn anew, those of links that have finer ones too.

        Usual bodies may hold of a drawing what its collision shapes do not, and finer ones less.
        """
        origin, allowance = self.origin, self.asked.allowance
        for again in (True, False):
            drawn = covering.measure(origin.model, origin.root, origin.drawn, list(origin.unread))
            for link in sorted(cut & set(drawn)) if again else ():
                if (over := drawn[link].reach - allowance) > 0.0:
                    tight.thicken(origin, link, over)
        self.record = covered.Record(allowance, tuple(drawn.values()))
        covered.mark(origin.root, self.record)

    def _anchor(self, robot: model.Geometry) -> anchor.Found:
        plan, neck = self.plan, self.asked.neck
        best = anchor.search(robot, neck)
        if best is None and (always := anchor.always(robot, neck)):
            self.look.append(
                "these overlap in every pose that was asked, although what lies between them "
                "does not, and are taken off in the SRDF: " + _listed(always)
            )
            self._off(robot, dict.fromkeys(always, "Always, by sampling"))
            robot = plan.load(self.folder)
            best = anchor.search(robot, neck)
        if best is None or best.clearance < self.asked.margin:
            raise RobotError(
                f"{self.asked.urdf}: of {anchor.ASKED} poses none is feasible, so there is no "
                "anchor; its bodies overlap everywhere: more capsules (--capsules 8), spheres "
                "(--spheres) or an SRDF may free them"
            )
        plan.anchor = {
            joint: float(angle)
            for joint, angle in zip(robot.joint_names, best.q, strict=True) if angle != 0.0
        }  # fmt: skip
        return best

    def _locked(self, work: tight.Work, named: Sequence[np.ndarray]) -> list[touching.Locked]:
        usual = dataclasses.replace(self.plan, finer=(), baselines=False).load(self.folder)
        overlap = {
            frozenset(usual.bodies[k].link for k in (pair.a, pair.b))
            for pair in pairs.all_pairs(usual, proven=False) if pair.reason == pairs.OVERLAP
        }  # fmt: skip
        robot = self.plan.load(self.folder)
        shown = motion.poses(robot, [robot.anchor, *named[:2]], 1.0)
        return touching.locked(robot, work.pieces, shown, work.margin, overlap)

    def _off(self, robot: model.Geometry, taken: dict[frozenset[str], str]) -> None:
        """Take pairs of links off, by the plan's SRDF, beside those of a robot."""
        if taken:
            text = srdf.text(self.plan.name, robot.disabled | taken)
            self.plan.files[f"urdf/{self.plan.name}.srdf"] = text.encode()


def standing(
    robot: model.Geometry,
    neck: str,
    work: tight.Work,
    poses: Mapping[str, Mapping[str, float]],
    margin: float,
) -> tuple[stand.Stand, np.ndarray, Callable[[np.ndarray], float]]:
    """How a robot may stand by its parts as they are drawn.

    Args:
        robot: its anchor may be anything.
        neck: skeleton.NECKS.
        work: its parts.
        poses: that its files hold, by name: joint -> angle [rad].
        margin: clearance that poses keep [m].

    Returns:
        The stand; a pose with its arms held out, zero where there is none [rad], (n_dof,); and what
        measures how far parts are apart [m], see motion.clearance.
    """
    out = next((q for _, q in anchor.candidates(robot, neck)), anchor.zero(robot))
    clear = motion.clearance(robot, work.pieces, out, frozenset(robot.disabled))
    return stand.propose(robot, poses, clear, margin + _FREE), out, clear


def _listed(links: Collection[frozenset[str]]) -> str:
    return ", ".join(" and ".join(sorted(pair)) for pair in links)
