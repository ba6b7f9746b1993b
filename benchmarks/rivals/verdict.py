"""What a motion is: how near to the human, what of it is broken, how it moves, what it cost.

All entrants are judged here, in this project's environment, by code that none of them runs on:
coal at every pose; our proof of every path; where that does not say yes, coal at samples no more
than 1 mm apart, with MuJoCo's word on what coal calls broken; the same on every PROBED-th path that
is proven; HPP's own proof of a share of paths, where it is installed. *Broken* is only what a
colliding pose was shown of; a path that is neither proven nor shown to collide is *unproven*.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from tasks import RATE, Task

sys.path.append(str(Path(__file__).resolve().parents[1] / "judge"))
import continuous  # noqa: E402
from engines import Coal, Mujoco  # noqa: E402
from judging import Judge, Promise, Row  # noqa: E402
from streams import SAG  # noqa: E402

from s3le.errors import CertificateError  # noqa: E402
from s3le.guard.claim import claim  # noqa: E402
from s3le.guard.clean import Guard  # noqa: E402
from s3le.guard.layouts.episode import Episode  # noqa: E402
from s3le.guard.layouts.numbers import Numbers  # noqa: E402
from s3le.kernels import batch  # noqa: E402
from s3le.plan.limits import accelerations, limits, speeds  # noqa: E402
from s3le.robot.hulls import HullCheck  # noqa: E402
from s3le.robot.robot import Robot  # noqa: E402
from s3le.safety import paths  # noqa: E402
from s3le.skeleton import BONES, cosine_distance  # noqa: E402

PROBED = 20  # of so many proven paths one is sampled all the same
HEARD = 20  # of so many paths one is HPP's to prove
TOUCH = 1e-9  # [m], less than this is no overlap but a digit
STILL, MOVES = 1e-9, np.radians(1.0)  # [rad]: the robot stands; a human's bone moves
BETWEEN_HULLS = 1  # poses between two frames at which hulls of meshes are measured
LONGEST_LAG = 10  # frames
OVER = 1e-6  # share by which a limit may be exceeded: of floats and of a solver's tolerance
FAR, MOVED = 10.0, 0.05  # [deg]
REFUSED = {  # words of the guard -> what is told
    "turns at": "a joint would turn too fast", "changes speed by": "a joint would turn too hard",
    "no way to rest": "no way to rest is proven", "no motion was found": "no motion was found",
}  # fmt: skip


class Court:
    """Judges motions of one robot; holds scratch, so one per process."""

    def __init__(self, robot: Robot, hulls: Path | None = None) -> None:
        """Make the judges.

        Args:
            robot: whose motions.
            hulls: of its meshes, as meshes.hulls_of gives them; None: they are not looked at.
        """
        self.robot, self.most = robot, limits(robot)
        between = robot.margin / 4.0
        promise = Promise(
            robot.margin, between, self.most.speed, robot.lower, robot.upper,
            self.most.acceleration,
        )  # fmt: skip
        self.between = between
        self.coal = Judge(robot, promise, Coal(robot, promise.between))
        try:
            self.mujoco: Mujoco | None = Mujoco(robot, promise.between)
        except ImportError:  # told in the record: nothing is called broken by it then
            self.mujoco = None
        self.hulls = HullCheck(robot, hulls) if hulls else None
        near = between - SAG
        self.hpp = continuous.Continuous(robot, near) if continuous.installed() else None
        # Who judges beside coal and the proof, for what was judged without them is judged anew.
        self.others = [
            name
            for name, there in (("mujoco", self.mujoco), ("hulls", self.hulls), ("hpp", self.hpp))
            if there
        ]
        asked = claim(robot)
        self.guard = Guard(*asked)

    def judge(self, task: Task, made: dict[str, np.ndarray], repair: bool = True) -> dict[str, Any]:
        """Everything about one motion, as JSON can hold it.

        Args:
            task: what it follows.
            made: "q" (m, n), "seconds" (m,), "failed" (m,); of curves "t", "at", "fast" too.
            repair: put it through the guard as well.
        """
        q, x, base = made["q"], task.x[: len(made["q"])], made.get("base")
        found = {"frames": len(q), "steps": max(len(q) - 1, 0), "failed": int(made["failed"].sum())}
        found |= self._likeness(q, x, base) | self._moves(q, x) | self._poses(q) | self._paths(made)
        found["us"] = [round(1e6 * s, 1) for s in made["seconds"].tolist()]
        if self.hulls:
            found |= self._hulls(q)
        if repair:
            found |= self._repaired(task.name, made)
        return found

    def _likeness(self, q: np.ndarray, x: np.ndarray, base: np.ndarray | None) -> dict[str, Any]:
        seen = batch.skeletons(self.robot.chain, q)
        angle = _angles(seen, x)
        kept = np.ones(7, bool) if self.robot.followed is None else self.robot.followed
        far = cosine_distance(seen, x, self.robot.followed)
        return {
            "bones": {b: float(v) for b, v, k in zip(BONES, angle.mean(axis=0), kept, strict=True)
                      if k},
            "angle": float(angle[:, kept].mean()),
            "angle_p95": float(np.quantile(angle[:, kept].mean(axis=1), 0.95)),
            "far": float(far.mean()),
            "trunk_off": int((angle[:, 0] > FAR).sum()),
            "lag_ms": 1e3 * _lag(seen, x) / RATE,
        } | ({} if base is None else self._leaning(seen, x, base, kept))  # fmt: skip

    def _leaning(
        self, seen: np.ndarray, x: np.ndarray, base: np.ndarray, kept: np.ndarray
    ) -> dict[str, Any]:
        """Angles of a robot whose base floats, as somebody sees it who stands beside it."""
        bones = seen.reshape(-1, 7, 3) @ base.transpose(0, 2, 1)
        lean = np.degrees(np.arccos(np.clip(base[:, 2, 2], -1.0, 1.0)))
        return {
            "angle_beside": float(_angles(bones.reshape(-1, 21), x)[:, kept].mean()),
            "lean": float(lean.mean()),
        }

    def _moves(self, q: np.ndarray, x: np.ndarray) -> dict[str, Any]:
        most, time = self.most, np.arange(len(q)) / RATE
        fast, hard = np.abs(speeds(time, q)), np.abs(accelerations(time, q))
        jerk = np.abs(np.diff(q, n=3, axis=0)) * RATE**3
        with np.errstate(invalid="ignore"):
            share = fast / most.speed
        turned = np.arccos(np.clip((x[1:] * x[:-1]).reshape(-1, 7, 3).sum(axis=2), -1.0, 1.0))
        stands = (np.abs(np.diff(q, axis=0)) <= STILL).all(axis=1)
        out = np.maximum(self.robot.lower - q, q - self.robot.upper)
        return {
            "outside": int((out > 1e-6).any(axis=1).sum()),
            "outside_most": float(max(out.max(), 0.0)),
            "fast": int((share > 1.0 + OVER).any(axis=1).sum()),
            "fastest": float(share.max(initial=0.0)),
            "hard": int((hard > most.acceleration * (1.0 + 1e-3)).any(axis=1).sum()),
            "acceleration": [round(float(v), 3) for v in hard.max(axis=1, initial=0.0)],
            "jerk": [round(float(v), 1) for v in jerk.max(axis=1, initial=0.0)],
            "held": int((stands & (turned.max(axis=1, initial=0.0) > MOVES)).sum()),
        }

    def _poses(self, q: np.ndarray) -> dict[str, Any]:
        clearance = self.robot.certifier().check(q).clearance
        deep = np.flatnonzero(clearance < -TOUCH)
        denied = 0
        if self.mujoco:
            denied = sum(not self.mujoco.pairs(q[i]).min() < 0.0 for i in deep)
        return {
            "poses_broken": int(len(deep) - denied),
            "poses_denied": denied,
            "poses_near": int((clearance < self.robot.margin - TOUCH).sum()),
            "depth_mm": float(max(-1e3 * clearance.min(), 0.0)),
        }

    def _paths(self, made: dict[str, np.ndarray]) -> dict[str, Any]:
        """Paths from row to row of a file's rows, counted by the frame that they lead to."""
        robot, curved = self.robot, "at" in made
        at = made["at"] if curved else made["q"]
        t = made["t"] if curved else np.arange(len(at)) / RATE
        how = {"time": t, "v": made["fast"]} if curved else {}
        proven = paths.certify(robot, at, self.between, **how).status == paths.CERTIFIED
        if curved:  # that rows meet on parabolas is what the proof rests on
            dt, v = np.diff(t)[:, None], made["fast"]
            off = np.abs(np.diff(at, axis=0) - 0.5 * dt * (v[1:] + v[:-1])).max(axis=1)
            proven &= off < 1e-9
        to = np.minimum(np.ceil(t[1:] * RATE - 1e-6).astype(int), len(made["q"]) - 1)
        broken, unproven, probed, caught, deepest = set(), set(), 0, 0, 0.0
        heard = refused = 0
        for i in range(len(at) - 1):
            if self.hpp and i % HEARD == 0:
                heard += 1
                chords = self._chords(made, at, t, i)
                refused += not all(
                    self.hpp.path(a, b).free for a, b in zip(chords, chords[1:], strict=False)
                )
            if proven[i] and i % PROBED:
                continue
            probed += bool(proven[i])
            poses = self._sampled(made, at, t, i)
            seen = self.coal._along(poses)  # noqa: SLF001  the judge's own eyes, without a promise
            overlap = seen.clearance < -TOUCH
            if overlap and self.mujoco:
                pose = poses[round(seen.t * (len(poses) - 1))]
                overlap = bool(self.mujoco.pairs(pose).min() < 0.0)
            if overlap:
                broken.add(int(to[i]))
                deepest = max(deepest, -1e3 * seen.clearance)
                caught += bool(proven[i])
            elif not proven[i]:
                unproven.add(int(to[i]))
        return {
            "paths_broken": len(broken), "paths_unproven": len(unproven - broken),
            "paths_depth_mm": deepest, "proven_probed": probed, "proven_broken": caught,
            "hpp_heard": heard, "hpp_refused": refused,
        }  # fmt: skip

    def _sampled(self, made: dict, at: np.ndarray, t: np.ndarray, i: int) -> np.ndarray:
        """Poses of a path between which no point moves more than 1 mm."""
        if "at" not in made:
            return self.coal.samples(at[i], at[i + 1])
        return self.coal.sampled(_rows(made, at, t, i))

    def _chords(self, made: dict, at: np.ndarray, t: np.ndarray, i: int) -> np.ndarray:
        """Poses between which a path goes straight, or within SAG of it."""
        if "at" not in made:
            return at[i : i + 2]
        return self.coal.chords(_rows(made, at, t, i), SAG)

    def _hulls(self, q: np.ndarray) -> dict[str, Any]:
        """Hulls of the robot's own meshes, which no entrant was told of, straight between frames.

        Pairs that overlap at the anchor, nested parts, do not count.
        """
        hulls = self.hulls
        assert hulls is not None
        nested = hulls.distances(self.robot.anchor[None])[0] < 0.0
        share = np.linspace(0.0, 1.0, BETWEEN_HULLS + 2)[1:, None]
        parts = [q[:1], *((1.0 - share) * a + share * b for a, b in zip(q, q[1:], strict=False))]
        poses = 0
        broken, depth = 0, 0.0
        for part in parts:
            apart = hulls.distances(part)[:, ~nested].min(axis=1, initial=np.inf)
            broken += bool((apart < -TOUCH).any())
            poses += bool(apart[-1] < -TOUCH)
            depth = max(depth, -1e3 * float(apart.min()))
        return {"hull_poses": poses, "hull_paths": broken, "hull_depth_mm": depth}

    def _repaired(self, name: str, made: dict[str, np.ndarray]) -> dict[str, Any]:
        """What the guard's file door makes of it, and how far that is."""
        q, n = made["q"], made["q"].shape[1]
        v, free = made.get("v"), np.full(n, np.inf)
        told = np.full(q.shape, np.nan) if v is None else v
        # As a file that has a place for joints' speeds: without one fewer motions can be written.
        episode = Episode(
            name, np.arange(len(q)) / RATE, q, [],
            Numbers(tuple(q.T.copy()), (False,) * n, q, self.robot.lower, self.robot.upper),
            v=v, pace=Numbers(tuple(told.T.copy()), (False,) * n, told, -free, free),
        )  # fmt: skip
        try:
            mended = self.guard.nearest(episode)
        except CertificateError as error:
            return {"repair_refused": 1, "repair_why": _kind(str(error).partition(": ")[2])}
        off = np.degrees(np.abs(mended.q - q)).max(axis=1)
        return {
            "repair_refused": 0,
            "repair_left": int(sum(check.broken for check in mended.after.checks)),
            "repair_moved": int((off > MOVED).sum()),
            "repair_off": [round(float(v), 3) for v in off],
        }


def _kind(why: str) -> str:
    """What kind of refusal it is; one that is of no known kind is told as it is."""
    return next((kind for part, kind in REFUSED.items() if part in why), why)


def _rows(made: dict, at: np.ndarray, t: np.ndarray, i: int) -> list[Row]:
    return [Row(float(t[k]), at[k], made["fast"][k]) for k in (i, i + 1)]


def _angles(seen: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Angles of bones [deg], (m, 7), between skeletons (m, 21)."""
    cosine = (seen * x).reshape(-1, 7, 3).sum(axis=2)
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _lag(seen: np.ndarray, x: np.ndarray) -> float:
    """Frames by which a robot's skeleton is best explained as a late copy of the human's."""
    most = min(LONGEST_LAG, len(x) // 4)
    errors = [
        np.square(seen[most:] - x[most - k : len(x) - k]).mean() for k in range(most + 1)
    ]  # fmt: skip
    k = int(np.argmin(errors))
    if not 0 < k < most:
        return float(k)
    before, here, after = errors[k - 1 : k + 2]
    return k + 0.5 * (before - after) / max(before - 2.0 * here + after, 1e-12)
