"""A robot ready to be computed with: its files resolved once, then one object for all stages.

The `robot` stage writes a folder that stands by itself (robot file, URDF, settings); every later
stage reads that folder, so a change of the robot reaches exactly what depends on it.
"""

import contextlib
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from s3le.errors import RobotError
from s3le.robot import chain, pairs, sense
from s3le.robot.certificate import Certifier, point_positions
from s3le.robot.model import Robot, load
from s3le.robot.table import ROBOT_PAIRS
from s3le.skeleton import (
    ABSENT,
    BONES,
    NECKS,
    POINTS,
    SHORTEST_BONE,
    bone_vectors,
    with_fixed,
)
from s3le.store import documents, tables
from s3le.store.atomic import replace

ROBOT_FILE, SETTINGS, PAIRS = "robot.yaml", "settings.json", "pairs.parquet"
BONES_FILE = "bones.json"


@dataclass(frozen=True)
class Machine:
    """A robot with its watched pairs, the clearance it must keep, and where its neck is."""

    robot: Robot
    pairs: tuple[pairs.Pair, ...]
    margin: float  # [m]
    neck: str  # skeleton.NECKS

    @cached_property
    def watched(self) -> np.ndarray:
        """Body indices of the watched pairs, int64 (n_pairs, 2)."""
        return pairs.watched(list(self.pairs))

    @cached_property
    def chain(self) -> chain.Chain:
        """The robot as flat arrays for the kernels."""
        return chain.build(self.robot, self.watched, self.neck)

    @cached_property
    def followed(self) -> np.ndarray | None:
        """Which of the seven bones the robot has and can turn, bool (7,); None: all of them."""
        bones = bones_of(self.robot, sense.points(self.robot, sense.poses(self.robot)), self.neck)
        present = _present(self.robot)
        found = present.copy()
        found[present] = sense.turning(bones[:, present])
        if not found.any():
            raise RobotError(
                f"{self.robot.description.source}: its joints turn none of the bones; look at "
                "points and joints"
            )
        return None if found.all() else found

    @cached_property
    def vectors(self) -> tuple[str, ...]:
        """Names of the bones that are followed, and that distances are means over."""
        kept = np.ones(len(BONES), bool) if self.followed is None else self.followed
        return tuple(bone for bone, good in zip(BONES, kept, strict=True) if good)

    def seen(self, x: np.ndarray) -> np.ndarray:
        """Human skeletons as this robot sees them: bones it cannot follow are replaced by its own.

        Args:
            x: skeletons, (..., 21); as they are for a robot with all seven.
        """
        return with_fixed(x, self.fixed)

    @cached_property
    def fixed(self) -> dict[str, list[float]]:
        """Bones that are not followed -> their direction at the anchor, a unit vector."""
        if self.followed is None:
            return {}
        at = sense.points(self.robot, self.robot.anchor[None])
        bones = bones_of(self.robot, at, self.neck)[0]
        found = {}
        for b in np.flatnonzero(~self.followed):
            bone = bones[b] if _present(self.robot)[b] else np.array(ABSENT[BONES[b]])
            found[BONES[b]] = (bone / np.linalg.norm(bone)).tolist()
        return found

    @property
    def tag(self) -> str:
        """Name, digest and settings: what a table says it was made for."""
        return f"{self.robot.name} {self.robot.digest} margin={self.margin!r} neck={self.neck}"

    def unwatched(self) -> list[tuple[str, str, str, str]]:
        """Pairs that could move but are not watched: both bodies, what they are, and why."""
        bodies = self.robot.bodies
        return [
            (bodies[pair.a].name, bodies[pair.b].name, pair.kind, pair.reason)
            for pair in self.pairs
            if pair.reason not in (pairs.WATCHED, pairs.FIXED)
        ]

    def certifier(self) -> Certifier:
        """A fresh independent checker (one per thread)."""
        return Certifier(self.robot, self.watched)

    def pair_name(self, row: int) -> str:
        """The two bodies of a watched pair."""
        return " and ".join(self.robot.bodies[body].name for body in self.watched[row])


def adopt(robot_file: Path, margin: float, neck: str) -> Machine:
    """Make a robot that people have described, once its points can be meant as they stand.

    Raises:
        RobotError: as make, or left and right are swapped, the base is not upright, an elbow does
            not bend, or no bone turns.
    """
    machine = make(robot_file, margin, neck)
    sense.refuse_nonsense(machine.robot)
    return machine


def make(robot_file: Path, margin: float, neck: str) -> Machine:
    """Read a robot file and settle what every stage needs to know.

    Raises:
        RobotError: the files are unusable, or the anchor pose does not keep the margin.
    """
    robot = load(robot_file)
    if neck not in NECKS:
        raise RobotError(f"neck must be one of {', '.join(NECKS)}, got {neck!r}")
    at = dict(zip(robot.points, point_positions(robot, robot.anchor)[:, None], strict=True))
    lengths = np.linalg.norm(bones_of(robot, at, neck)[0], axis=1)
    for bone, length, there in zip(BONES, lengths, _present(robot), strict=True):
        if there and not length > SHORTEST_BONE:
            raise RobotError(f"{robot_file}: its points leave no length for {bone}")
    machine = Machine(robot, tuple(pairs.all_pairs(robot)), margin, neck)
    if hit := pairs.anchor_collision(robot, list(machine.pairs)):
        raise RobotError(
            f"{robot_file}: at the anchor {robot.bodies[hit.a].name} and "
            f"{robot.bodies[hit.b].name} overlap by {-hit.clearance * 1e3:.2f} mm; "
            "give an anchor that does not collide"
        )
    report = machine.certifier().check(robot.anchor[None])
    if not report.clearance[0] >= margin:
        raise RobotError(
            f"{robot_file}: at the anchor {machine.pair_name(int(report.pair[0]))} are "
            f"{report.clearance[0] * 1e3:.2f} mm apart, the margin is {margin * 1e3:g} mm; "
            "give another anchor or a smaller margin"
        )
    return machine


def _present(robot: Robot) -> np.ndarray:
    """Which of the seven bones the robot has, bool (7,)."""
    def there(bone: str) -> bool:
        return bone not in ABSENT or any(
            bone.startswith((f"{side}_", f"neck_to_{side}_")) for side in robot.arms
        )

    return np.array([there(bone) for bone in BONES])


def bones_of(robot: Robot, at: dict[str, np.ndarray], neck: str) -> np.ndarray:
    """Bones of poses, (n, 7, 3) [m], from points by role (n, 3); a robot of one arm has a neck."""
    points = np.stack([at.get(role, at["hip"]) for role in POINTS], axis=1)
    return bone_vectors(points, neck if len(robot.arms) == 2 else "joint")


def write(machine: Machine, folder: Path) -> None:
    """Write the folder that `read` takes: robot file, URDF, settings and the list of pairs."""
    folder.mkdir(parents=True, exist_ok=True)
    description = machine.robot.description
    local = description.source.read_text(encoding="utf-8")
    for name, file in (
        (description.urdf_name, description.urdf),
        (description.srdf_name, description.srdf),
        (description.hulls_name, description.hulls),
    ):
        if file is not None:
            local = local.replace(name, file.name)
            replace(folder / file.name, lambda part, file=file: shutil.copyfile(file, part))
    documents.write_text(local, folder / ROBOT_FILE)
    settings = {"margin": machine.margin, "neck": machine.neck}
    documents.write_json(settings, folder / SETTINGS)
    documents.write_json({"fixed": machine.fixed}, folder / BONES_FILE)
    bodies = machine.robot.bodies
    rows = [
        (
            bodies[p.a].name,
            bodies[p.b].name,
            p.kind,
            p.reason == pairs.WATCHED,
            p.reason,
            p.clearance,
        )
        for p in machine.pairs
    ]
    columns = dict(zip(ROBOT_PAIRS.columns, map(np.array, zip(*rows, strict=True)), strict=True))
    tables.write(columns, ROBOT_PAIRS, folder / PAIRS, machine.tag)


def carried(folder: Path) -> tuple[tuple[str, bytes], ...]:
    """Names and bytes of the files that `read` needs, to be sent elsewhere.

    Raises:
        RobotError: a file is missing.
    """
    kinds = ("*.urdf", "*.srdf", "*.hulls.npz")
    pieces = [p.name for kind in kinds for p in Path(folder).glob(kind)]
    names = [SETTINGS, ROBOT_FILE, *sorted(pieces)]
    try:
        return tuple((name, (Path(folder) / name).read_bytes()) for name in names)
    except OSError as error:
        raise RobotError(f"{error}; write it with: dvc repro robot") from None


@contextlib.contextmanager
def unpacked(files: tuple[tuple[str, bytes], ...]) -> Iterator[Machine]:
    """The machine of files that were carried; its certifier can be made while the block runs."""
    with tempfile.TemporaryDirectory() as folder:
        for name, data in files:
            (Path(folder) / name).write_bytes(data)
        yield read(Path(folder))


def read(folder: Path) -> Machine:
    """Read what `write` wrote.

    Raises:
        RobotError, TableError: a file is missing or damaged.
    """
    settings = documents.read_json(folder / SETTINGS, "robot")
    margin, neck = settings.get("margin"), settings.get("neck")
    if type(margin) not in (int, float) or not 0.0 <= margin < 1.0 or neck not in NECKS:
        raise RobotError(
            f"{folder / SETTINGS}: wanted are a margin in [0, 1) m and a neck of "
            f"{', '.join(NECKS)}, got {margin!r} and {neck!r}; write it with: dvc repro robot"
        )
    return make(folder / ROBOT_FILE, float(margin), neck)
