"""What motors make of a motion: rows joined by curves and by straight lines, played in MuJoCo.

    python benchmarks/tracking.py coman MAKER/coman.urdf --packages MAKER [--clips FOLDER]

Each clip is planned twice within the same limits in time: as rows of position and speed, joints
evenly accelerated between (what `s3le retarget` writes), and as rows of positions, joints straight
between. A controller at 1 kHz pulls every joint towards the motion as it is told, equally stiff for
both: STIFF and critical damping, on the greatest inertia about the joint's axis, torque within the
file's effort, what gravity and speed ask for told ahead. Masses are those of the maker's file; the
pelvis is fixed, joints that do not move are held. Printed: how far joints are from where they
should be [deg], the least clearance that the robot as driven keeps [mm] and how often it touches
(coal, 125 times a second), the 99th percentile of torque as a share of the effort, how often it is
all of it. --picture draws the second in which the straight rows are worst. Nothing is asserted.
"""

import xml.etree.ElementTree as ElementTree
from copy import deepcopy
from pathlib import Path
from typing import Annotated, NamedTuple

import matplotlib.pyplot as plt
import mujoco
import numpy as np
import planning
import typer
from tqdm import tqdm

from s3le.kernels import batch
from s3le.onboard import reading
from s3le.onboard.source import Source
from s3le.plan.flow import planner
from s3le.plan.limits import limits
from s3le.plan.settings import Settings
from s3le.retarget.propose import LookUp
from s3le.rng import stream
from s3le.robot.robot import Robot
from s3le.safety import paths
from s3le.search import neighbours
from s3le.skeleton import cosine_distance
from s3le.tuples import sampling

TICK = 1e-3  # [s], of the controller and of the simulation
STIFF = 60.0  # [rad/s], natural frequency of a joint under the controller
SEEN = 8  # ticks from one look at the clearance to the next
LEAST = dict(boundmass="0.001", boundinertia="0.00001")  # of links that weigh nothing
CLIPS = "05_02,05_09,14_07,49_09,135_06"


class Driven(NamedTuple):
    """What was seen of one motion."""

    goal: np.ndarray  # [rad], (ticks, n), where the joints should be
    at: np.ndarray  # [rad], (ticks, n), where they are
    torque: np.ndarray  # (ticks, n), share of the effort
    clearance: np.ndarray  # [m], (looks,)


def main(
    name: Annotated[str, typer.Argument(metavar="ROBOT")],
    urdf: Annotated[Path, typer.Argument(help="its maker's URDF or MJCF, with masses")],
    packages: Annotated[list[Path] | None, typer.Option(help="folders of packages")] = None,
    clips: Annotated[Path, typer.Option(help="folder of CMU's originals")] = Path(
        "../shared/mocap/cmu"
    ),
    only: Annotated[str, typer.Option(help="which of them")] = CLIPS,
    acceleration: Annotated[float, typer.Option(help="limit [rad/s^2]")] = 60.0,
    fed: Annotated[bool, typer.Option(help="the controller is told speeds too")] = True,
    picture: Annotated[Path | None, typer.Option(help="PNG of the worst second")] = None,
) -> None:
    """Print a line for each kind of motion."""
    robot = Robot.load(name)
    plant = Plant(robot, reading.read(urdf, packages or []), fed)
    most = limits(robot, acceleration)
    pool = sampling.draw_feasible(robot, planning.POOL, stream(7, "poses"))[0]
    seen = batch.skeletons(robot.chain, pool).astype(np.float32)
    look = LookUp(pool, neighbours.build(seen, "l2"), 8, None)
    files = [next(clips.rglob(f"{clip}.amc.gz")) for clip in only.split(",")]
    known = [planning.read(robot, look, file) for file in files]
    print(f"{robot.name}, {len(known)} clips at {planning.RATE:g} Hz, {acceleration:g} rad/s^2; "
          f"{STIFF:g} rad/s, {'with' if fed else 'without'} speeds")  # fmt: skip
    print(f"{'':10}{'to human':>9}{'off mean':>10}{'p99':>7}{'most':>7}{'clearance':>11}"
          f"{'touch':>8}{'torque p99':>12}{'at limit':>10}")  # fmt: skip
    made = {}
    for kind in ("curves", "straight"):
        its, found = planner(robot, most, Settings(check=False, curved=kind == "curves")), []
        far: list[np.ndarray] = []
        for clip in tqdm(known, kind, leave=False, disable=None):
            plan = its.plan(clip.time, clip.wanted, skeleton=True)
            far.append(cosine_distance(batch.skeletons(robot.chain, plan.q), clip.x))
            found.append(plant.drive(clip.time, plan.q, plan.v if kind == "curves" else None))
        _say(kind, np.concatenate(far).mean(), found)
        made[kind] = found
    if picture is not None:
        _draw(robot, made["curves"], made["straight"], picture)


def _off(one: Driven) -> np.ndarray:
    """From where the joints should be [deg], (ticks, n)."""
    return np.degrees(np.abs(one.at - one.goal))


def _say(what: str, far: float, found: list[Driven]) -> None:
    off = np.concatenate([_off(one) for one in found])
    torque = np.concatenate([one.torque for one in found])
    clearance = np.concatenate([one.clearance for one in found])
    print(f"{what:<10}{far:>9.4f}{off.mean():>10.3f}{np.quantile(off, 0.99):>7.2f}{off.max():>7.2f}"
          f"{1e3 * clearance.min():>11.2f}{(clearance < 0.0).mean():>8.2%}"
          f"{np.quantile(torque, 0.99):>12.1%}{(torque >= 1.0 - 1e-9).mean():>10.2%}")  # fmt: skip


def _draw(robot: Robot, curves: list[Driven], straight: list[Driven], path: Path) -> None:
    """The joint and the second in which the straight rows are worst, by both."""
    clip = int(np.argmax([_off(one).max() for one in straight]))
    tick, joint = np.unravel_index(_off(straight[clip]).argmax(), straight[clip].at.shape)
    rows = slice(max(int(tick) - 500, 0), int(tick) + 500)
    figure, axes = plt.subplots(2, 2, figsize=(9, 4.5), sharex=True, sharey="row")
    for (up, down), (name, one) in zip(
        axes.T, (("curves", curves[clip]), ("straight", straight[clip])), strict=True
    ):
        time = TICK * np.arange(len(one.at))[rows]
        up.plot(time, np.degrees(one.goal[rows, joint]), "0.6", lw=3, label="as told")
        up.plot(time, np.degrees(one.at[rows, joint]), "C3", lw=1, label="as driven")
        up.set_title(f"{robot.joint_names[joint]}, {name}", fontsize=9)
        down.plot(time, 100.0 * one.torque[rows, joint], "C0", lw=1)
        down.set_xlabel("s")
    axes[0, 0].set_ylabel("deg")
    axes[1, 0].set_ylabel("torque [% of effort]")
    axes[0, 0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=110)


class Plant:
    """A robot in MuJoCo under its controller."""

    def __init__(self, robot: Robot, source: Source, fed: bool) -> None:
        """Build it from the maker's file.

        Raises:
            SystemExit: a joint of the robot has no effort, or the file has no masses.
        """
        self.robot, self.fed, self.certifier = robot, fed, robot.certifier()
        spec = mujoco.MjSpec.from_string(_text(source, robot))
        spec.option.timestep = TICK
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        for joint in spec.joints:
            spec.add_actuator(
                target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT, forcelimited=True,
                forcerange=[-1.0, 1.0],
            )  # fmt: skip
        self.model = spec.compile()
        names = [mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_JOINT, j)
                 for j in range(self.model.njnt)]  # fmt: skip
        own = [names.index(joint) for joint in robot.joint_names]
        effort = {item.get("name"): float(limit.get("effort", "0"))
                  for item in source.root.findall("joint")
                  if (limit := item.find("limit")) is not None}  # fmt: skip
        self.column = self.model.jnt_dofadr[own]
        self.effort = np.array([effort.get(name, 0.0) or np.inf for name in names])
        if not np.isfinite(self.effort[own]).all() or not source.inertial:
            raise SystemExit("the maker's file must have masses, and an effort for every joint")
        self.held = np.zeros(self.model.nv)
        for joint, angle in robot.description.hold.items():
            if joint in names:
                self.held[names.index(joint)] = angle
        stiff = STIFF**2 * self._inertia()
        # force = stiff (ctrl - q) - damp v, of which MuJoCo integrates the damping implicitly.
        self.model.actuator_biastype[:] = mujoco.mjtBias.mjBIAS_AFFINE
        self.model.actuator_gainprm[:, 0] = stiff
        self.model.actuator_biasprm[:, 1] = -stiff
        self.model.actuator_biasprm[:, 2] = -2.0 * stiff / STIFF

    def _inertia(self) -> np.ndarray:
        """The greatest about each joint over random poses [kg m^2], (nv,)."""
        data, nv = mujoco.MjData(self.model), self.model.nv
        unit, made = np.eye(nv), np.empty(nv)
        rng, most = np.random.default_rng(0), np.zeros(nv)
        for _ in range(200):
            data.qpos[:] = self.held
            data.qpos[self.column] = rng.uniform(self.robot.lower, self.robot.upper)
            mujoco.mj_forward(self.model, data)
            for j in range(nv):
                mujoco.mj_mulM(self.model, data, made, unit[j])
                most[j] = max(most[j], made[j])
        return most

    def drive(self, time: np.ndarray, q: np.ndarray, v: np.ndarray | None) -> Driven:
        """Play a motion, from rest at its first row.

        Args:
            time: of the rows [s], (m,).
            q: [rad], (m, n).
            v: [rad/s], (m, n); None: joints are straight between rows.
        """
        data = mujoco.MjData(self.model)
        at = time[0] + np.arange(0.0, time[-1] - time[0], TICK)
        left = np.clip(np.searchsorted(time, at, "right") - 1, 0, len(time) - 2)
        if v is None:
            slope = np.diff(q, axis=0) / np.diff(time)[:, None]
            goal, pace = q[left] + slope[left] * (at - time[left])[:, None], slope[left]
        else:
            goal, pace = paths.sampled(time, q, v, left, at)
        data.ctrl[:] = self.held
        data.qpos[:] = self.held
        data.qpos[self.column] = q[0]
        was, share = np.empty(goal.shape), np.empty(goal.shape)
        for k in range(len(at)):
            # A speed is told as a place farther on: the damping of so far is what it pulls.
            data.ctrl[self.column] = goal[k] + (2.0 / STIFF) * pace[k] * self.fed
            mujoco.mj_step1(self.model, data)
            was[k] = data.qpos[self.column]
            ahead = data.qfrc_bias.copy()
            # The motor gives no more than its effort, whatever is told ahead.
            self.model.actuator_forcerange[:, 0] = -self.effort - ahead
            self.model.actuator_forcerange[:, 1] = self.effort - ahead
            data.qfrc_applied[:] = ahead
            mujoco.mj_step2(self.model, data)
            pull = data.actuator_force + ahead
            share[k] = (np.abs(pull) / self.effort)[self.column]
        return Driven(goal, was, share, self.certifier.check(was[::SEEN]).clearance)


def _text(source: Source, robot: Robot) -> str:
    """The maker's kinematics and masses as a URDF for MuJoCo, its base upright and fixed."""
    root = deepcopy(source.root)
    for joint in root.findall("joint"):
        if joint.get("type") in ("floating", "planar"):
            joint.set("type", "fixed")
    for link in root.findall("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
        if (item := source.inertial.get(link.get("name", ""))) is not None:
            link.append(deepcopy(item))
    extra = ElementTree.SubElement(root, "mujoco")
    options = dict(LEAST, fusestatic="false", balanceinertia="true")
    ElementTree.SubElement(extra, "compiler", options)
    down = -9.81 * robot.base_rotation[2]
    ElementTree.SubElement(extra, "option", gravity=" ".join(f"{v:.9g}" for v in down))
    return ElementTree.tostring(root, encoding="unicode")


if __name__ == "__main__":
    typer.run(main)
