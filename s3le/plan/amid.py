"""Streams among joints that others move: certified steps of ours, whatever those do.

    walker = Amid(body, q=ours, given=theirs)
    walker.others(now, then=there)          # known: on straight paths to `there`
    walker.others(now, within=0.02)         # or bounded: anywhere within 0.02 rad of where they are
    step = walker.step(wanted, dt)

A step is looked for and proven as any (s3le/plan/steps.py) among bodies that stand where the others
will be, or that contain all places where they may be. Where their way is known, what comes of it is
proven once more with all joints moving. That the robot can brake is proven with the others where
they will be: they may move on, so a braking motion that held may not hold any more. Then ours give
way along what is proven (s3le/plan/giveway.py); if nothing is, the step is forced, and not
certified.
"""

from dataclasses import replace

import numpy as np

from s3le.errors import CertificateError, ParameterError
from s3le.kernels.solver import clearance_of
from s3le.plan import causal
from s3le.plan.giveway import GiveWay, Terms
from s3le.plan.limits import ROUNDING, SHORTEST, Limits
from s3le.plan.settings import Settings
from s3le.plan.state import State, checked, pose
from s3le.plan.steps import HOW, Step, Walker
from s3le.robot.chain import Chain
from s3le.robot.robot import Robot
from s3le.robot.wholebody import WholeBody
from s3le.safety import segment
from s3le.safety.folded import Folded
from s3le.safety.segment import CERTIFIED, COLLIDES, prove
from s3le.safety.swept import Swept, swept

GAVE_WAY, FORCED = 6, 7  # how a step came about, beside those of steps.HOW
WAYS = HOW | {GAVE_WAY: "gave way", FORCED: "forced"}
_ON = 0.3  # [s], for which the others are thought on when ours give way
_DRIFT = 0.1  # [s], for which they are thought to go on as fast as they came


class Amid(Walker):
    """One robot among given joints, from rest; holds scratch, so one per thread."""

    _words = WAYS

    def __init__(
        self,
        body: WholeBody,
        most: Limits | None = None,
        settings: Settings | None = None,
        *,
        q: np.ndarray,
        given: np.ndarray,
        skeleton: bool = False,
    ) -> None:
        """Put the robot where it is; it need not be clear there, but then steps may be forced.

        Args:
            body: the robot, and which joints others move.
            most, settings, skeleton: see Walker.
            q: where ours are [rad], (n,).
            given: where the given joints are [rad], (k,).

        Raises:
            ParameterError: an argument has another shape or is not finite.
        """
        # Where others move, nobody says for how long a way to rest stays free: rows are straight.
        settings = replace(settings or Settings(), curved=False)
        k = len(body.given)
        self.body, self._fold = body, Folded(body)
        self._now = pose(given, k, "given joints")
        self._then: np.ndarray | None = self._now
        self._within = np.zeros(k)
        self._all, self._ours = _proofs(body.every), _proofs(body.robot)
        self._coal_all, self._coal = body.every.certifier(), body.robot.certifier()
        self._pose = body.robot.anchor.copy()
        # Corners of their bounds at which a pose is measured by coal: every other joint at one end.
        self._signs = np.where(np.arange(k)[None] % 2 == np.arange(2)[:, None], 1.0, -1.0)
        self._near = -1  # row of the pair that was nearest at the pose measured last
        self._bound = np.nan
        self._wanted: np.ndarray | None = None
        self._rest = None if body.rest is None else (_proofs(body.rest), body.rest.certifier())
        self._whole = False  # the step found holds for pairs of given joints alone as well
        self.apart = ""  # two bodies that others alone moved too near to each other
        super().__init__(body.base, most, settings, q=q, skeleton=skeleton)

    def _bodies(self) -> tuple[Chain, Swept]:
        return self._fold.chain, self._fold.swept

    def _found(self) -> float:
        return self.measure(self._q, self._now)

    @property
    def given(self) -> np.ndarray:
        """Where the given joints are [rad], (k,), by what was said last."""
        return (self._now if self._then is None else self._then).copy()

    def others(
        self,
        now: np.ndarray,
        then: np.ndarray | None = None,
        within: np.ndarray | float | None = None,
    ) -> None:
        """Say what the given joints do in the steps to come, until it is said anew.

        Args:
            now: where they are [rad], (k,).
            then: where they will be when the step is over, straight from now on [rad], (k,).
            within: how far from now they may get until then, any way [rad], (k,) or one for all.
                One of the two is asked for.

        Raises:
            ParameterError: an argument has another shape, is not finite, or both or none are given.
        """
        k = len(self.body.given)
        now = pose(now, k, "given joints")
        if (then is None) == (within is None):
            raise ParameterError("of given joints, say where they will be or how fast they may be")
        if then is not None:
            then = pose(then, k, "given joints to come")
        far = np.zeros(k)
        if within is not None:
            far = pose(
                np.broadcast_to(np.asarray(within, float), (k,)), k, "bounds of given joints"
            )
            if not (far >= 0.0).all():
                raise ParameterError("bounds of given joints must be at least 0 rad")
        self._now, self._then, self._within = now, then, far

    def see(self) -> None:
        """Write into `bodies` where the others will be, or may be, as they were said."""
        self._fold.stand(self._now if self._then is None else self._then, self._within)

    def step(self, wanted: np.ndarray | None, dt: float, starts: np.ndarray | None = None) -> Step:
        """Where ours are to be dt later; as Walker.step, among the others."""
        if not dt >= SHORTEST:  # no time, nothing moves; catches NaN
            return super().step(wanted, dt, starts)
        self.see()
        clear = float(clearance_of(self._chain, self._swept.balls, self._q))
        self._clearance = max(clear, self._care.margin)  # of the reserve: what there is of it
        self._wanted = wanted
        made = super().step(wanted, dt, starts)
        self.apart = ""
        if self._then is not None:
            if not self._whole:
                self.apart = self._apart(self._now, self._then)
            self._now = self._then
        return made

    def restore(self, state: State) -> None:
        """Go on from a state of a walker of the same robot and given joints.

        Raises:
            ParameterError: it has other shapes, or holds what is no number.
            CertificateError: it is beyond limits or too fast. Nothing has changed.
        """
        state, most = checked(state, len(self._q)), self.most
        within = (most.lower <= state.q) & (state.q <= most.upper)
        if not (within & (np.abs(state.v) <= most.speed * (1.0 + ROUNDING))).all():
            raise CertificateError("a state's pose or speed is beyond the robot's limits")
        self.put(state._replace(clearance=self.measure(state.q, self.given)))

    def warm_up(self) -> None:
        """Compile what a step needs, or read it from the store, so that no step waits for it."""
        kept, now = self.state(), self._now
        self.others(now, within=0.01)
        super().step(self.robot.anchor, 0.02)
        self.others(now, now)
        super().warm_up()
        self._way(0.02, 0.02)
        self.put(kept)

    def _apart(self, now: np.ndarray, then: np.ndarray) -> str:
        """Two bodies that given joints alone brought too near to each other; empty: none."""
        if self._rest is None or self.body.rest is None:
            return ""
        proofs, coal = self._rest
        care, first = self._care, self._with(self._q, now).copy()
        last = self._with(self._q, then)
        least, _ = coal.one(last)
        found = prove(*proofs, first, last, care.between, care.budget)
        if least >= self.robot.margin and found[0] == CERTIFIED:
            return ""
        row = found[4] if found[0] == COLLIDES else coal.nearest
        return self.body.rest.pair_name(int(row))

    def _settled(
        self, how: int, before: float, dt: float, to: np.ndarray, out: np.ndarray
    ) -> tuple[int, bool]:
        mean = 0.5 * (before + dt)
        good = self._holds(to, mean, dt)
        if not good and how != causal.BRAKED:
            how = self._brake(before, dt, to, out)
            good = self._holds(to, mean, dt)
        if not good:
            to[:] = self._way(before, dt)
            good = self._holds(to, mean, dt)
            how = GAVE_WAY if good else FORCED
        if self._then is not None and good:
            out[0] = self._bound
        if not good:
            out[0] = np.nan
            self._clearance = self.measure(to, self.given)
        return how, good

    def _holds(self, to: np.ndarray, mean: float, dt: float) -> bool:
        return self._clear_path(self._q, to) and super()._holds(to, mean, dt)

    def _clear_path(self, start: np.ndarray, to: np.ndarray) -> bool:
        """Is the path of ours proven, others moving as was said?"""
        care = self._care
        if self._then is None:
            found = prove(
                self._chain, self._swept, self._scratch, start, to, care.between, care.budget
            )
        else:
            first, last = self._with(start, self._now).copy(), self._with(to, self._then)
            found = prove(*self._all, first, last, care.between, care.budget)
            self._whole = found[0] == CERTIFIED
            if not self._whole:  # it may be pairs that are not ours to part
                found = prove(*self._ours, first, last, care.between, care.budget)
        self._bound = float(found[1])
        return bool(found[0] == CERTIFIED)

    def _measured(self, to: np.ndarray) -> bool:
        """Does a pose hold by the independent check, others wherever they may be then?"""
        margin = self.robot.margin
        least = float(clearance_of(self._chain, self._swept.balls, to))
        if not least >= margin:
            return False
        if self.settings.check:
            places = [self.given]
            if self._then is None and self._within.any():
                places += [places[0] + one * self._within for one in self._signs]
            for at in places:
                # All pairs at once; only where one is too near it is asked whose.
                good = self._coal_all.one(self._with(to, at))[0] >= margin
                self._whole = self._whole and good
                if not (good or self.measure(to, at) >= margin):  # catches NaN
                    return False
        self._clearance = least
        return True

    def measure(self, q: np.ndarray, given: np.ndarray) -> float:
        """Clearance by coal [m], ours at q and the others where they are; notes the pair."""
        found = self._coal.one(self._with(q, given))[0]
        self._near = self._coal.nearest
        return found

    @property
    def nearest(self) -> str:
        """The two bodies that are nearest of those that ours can part."""
        self.measure(self._q, self.given)
        return self.body.robot.pair_name(self._near) if self._near >= 0 else ""

    def _with(self, q: np.ndarray, given: np.ndarray) -> np.ndarray:
        self._pose[self.body.own], self._pose[self.body.others] = q, given
        return self._pose

    def _stand(self, to: np.ndarray, out: np.ndarray) -> int:
        # Left to _settled: standing still at once may be no more proven than anything else.
        to[:] = self._q
        out[0] = np.nan
        return causal.HELD

    def _way(self, before: float, dt: float) -> np.ndarray:
        """Where ours give way to in one step [rad], (n,)."""
        rows = 3 + int(np.ceil(_ON / dt))
        times = np.concatenate([[-before], dt * np.arange(rows - 1)])
        want = self._brakes(before, dt) if self._wanted is None else self._wanted
        planned = np.tile(want, (rows, 1))
        planned[0], planned[1] = self._q - before * self._v, self._q
        own, chain, moved, scratch = (
            np.arange(len(self._q)),
            self._chain,
            self._swept,
            self._scratch,
        )
        whole = planned.copy()
        if self._then is not None:
            chain, moved, scratch = self._ours
            own = self.body.own
            later = np.minimum(np.maximum(times, 0.0), _DRIFT + dt)[:, None]
            whole = np.empty((rows, len(self._pose)))
            whole[:, own] = planned
            whole[:, self.body.others] = self._now + later / dt * (self._then - self._now)
            whole[2, self.body.others] = self._then
        terms = Terms(
            self.robot, self.most, self._bounds, self._care, self._memory.W, own, chain, moved,
            scratch,
        )  # fmt: skip
        return GiveWay(terms, times, whole, planned).step(2)

    def _brakes(self, before: float, dt: float) -> np.ndarray:
        to = np.empty_like(self._q)
        causal.brake(self._q, self._v, 0.5 * (before + dt), dt, self._bounds, to)
        return to


def _proofs(robot: Robot) -> tuple[Chain, Swept, segment.Scratch]:
    """What proving paths of a robot takes."""
    return robot.chain, swept(robot.chain), segment.scratch(robot.chain)
