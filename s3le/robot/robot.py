"""A robot ready to be computed with: read once, then one object that carries all it needs.

It holds the bytes of its files, the pinocchio model that they gave, its watched pairs and its
margin. Whoever checks a pose checks this robot, not a file that may since have changed or gone.
"""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from dataclasses import replace as replaced
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from s3le.errors import RobotError
from s3le.robot import chain, known, model, pairs, sense
from s3le.robot.certificate import Certifier, point_positions
from s3le.robot.description import read_description
from s3le.robot.known import MARGIN, NECK
from s3le.robot.model import Geometry
from s3le.robot.pairs import Pair
from s3le.robot.ranges import origin
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
Files = tuple[tuple[str, bytes], ...]  # names and bytes of a robot's own files


@dataclass(frozen=True, eq=False)
class Robot(Geometry):
    """What its files say, its watched pairs, the clearance it must keep, and where its neck is."""

    pairs: tuple[pairs.Pair, ...]
    margin: float  # [m]
    neck: str  # skeleton.NECKS

    @classmethod
    def load(cls, given: Path | str, margin: float = MARGIN) -> "Robot":
        """The robot that is meant by a name, a file or a folder.

        Args:
            given: a folder that stage `robot` or `write` made or one that holds it as `robot`, a
                robot file (.yaml), or a name: of a robot file here or in data/robots, or of a
                robot that comes with the package.
            margin: clearance that poses keep [m], for a robot file; a folder has its own.

        Raises:
            RobotError: there is no such robot, or its files are unusable; see adopt.
            TableError: its list of pairs is damaged.
        """
        path = Path(given)
        for folder in (path, path / "robot"):
            if (folder / SETTINGS).is_file():
                return cls.read(folder)
        if path.suffix not in (".yaml", ".yml"):
            path = known.named(str(given), (Path(), known.OWN))
        return cls.adopt(path, margin, NECK)

    @classmethod
    def from_file(cls, file: Path, margin: float = MARGIN, neck: str = NECK) -> "Robot":
        """Read a robot file and settle what every stage needs to know.

        Args:
            file: robot file (YAML).
            margin: clearance that poses keep [m].
            neck: skeleton.NECKS.

        Raises:
            RobotError: the files are unusable, or the anchor pose does not keep the margin.
        """
        return cls._settled(model.load(file), file, margin, neck)

    @classmethod
    def adopt(cls, file: Path, margin: float = MARGIN, neck: str = NECK) -> "Robot":
        """Read a robot that people have described, once its points can be meant as they stand.

        Raises:
            RobotError: as from_file, or left and right are swapped, the base is not upright, an
                elbow does not bend, or no bone turns.
        """
        robot = cls.from_file(file, margin, neck)
        sense.refuse_nonsense(robot)
        return robot

    @classmethod
    def read(cls, folder: Path) -> "Robot":
        """Read what `write` wrote.

        Raises:
            RobotError, TableError: a file is missing or damaged.
        """
        margin, neck = _settings(documents.read_json(folder / SETTINGS, "robot"), folder / SETTINGS)
        return cls.from_file(folder / ROBOT_FILE, margin, neck)

    @classmethod
    def from_bytes(cls, files: Iterable[tuple[str, bytes]]) -> "Robot":
        """The robot that `to_bytes` took apart; nothing is read from a disk.

        Raises:
            RobotError: a file is missing or damaged.
        """
        held = dict(files)
        try:
            margin, neck = _settings(json.loads(held[SETTINGS]), Path(SETTINGS))
            description = read_description(Path(ROBOT_FILE), held)
        except (KeyError, ValueError) as error:
            raise RobotError(f"the robot that was sent is not whole ({error})") from None
        return cls._settled(model.from_description(description), Path(ROBOT_FILE), margin, neck)

    @classmethod
    def _settled(cls, found: Geometry, file: Path, margin: float, neck: str) -> "Robot":
        """The robot of a geometry, once its anchor can be stood at."""
        if neck not in NECKS:
            raise RobotError(f"neck must be one of {', '.join(NECKS)}, got {neck!r}")
        at = dict(zip(found.points, point_positions(found, found.anchor)[:, None], strict=True))
        lengths = np.linalg.norm(bones_of(found, at, neck)[0], axis=1)
        for bone, length, there in zip(BONES, lengths, _present(found), strict=True):
            if there and not length > SHORTEST_BONE:
                raise RobotError(f"{file}: its points leave no length for {bone}")
        own = {field.name: getattr(found, field.name) for field in fields(found)}
        decided = tuple(pairs.all_pairs(found))
        if found.description.ranges:
            plain = replaced(found.description, ranges={})
            alike = cls._settled(model.from_description(plain), file, margin, neck)
            decided = pairs.alike(found, decided, alike, alike.pairs, margin)
        robot = cls(**own, pairs=decided, margin=margin, neck=neck)
        if hit := pairs.anchor_collision(robot, list(robot.pairs)):
            raise RobotError(
                f"{file}: at the anchor {robot.bodies[hit.a].name} and "
                f"{robot.bodies[hit.b].name} overlap by {-hit.clearance * 1e3:.2f} mm; "
                "give an anchor that does not collide"
            )
        report = robot.certifier().check(robot.anchor[None])
        if not report.clearance[0] >= margin:
            raise RobotError(
                f"{file}: at the anchor {robot.pair_name(int(report.pair[0]))} are "
                f"{report.clearance[0] * 1e3:.2f} mm apart, the margin is {margin * 1e3:g} mm; "
                "give another anchor or a smaller margin"
            )
        return robot

    def without_ranges(self, names: Iterable[str]) -> "Robot":
        """The same robot, of whose ranges some are left out: a motion says what these joints do."""
        text = self.description
        kept = {name: ends for name, ends in text.ranges.items() if name not in set(names)}
        if kept == text.ranges:
            return self
        found = model.from_description(replaced(text, ranges=kept))
        return self._settled(found, text.source, self.margin, self.neck)

    def write(self, folder: Path) -> None:
        """Write the folder that `read` takes: robot file, URDF, settings and the list of pairs."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, data in self.to_bytes():
            replace(folder / name, partial(Path.write_bytes, data=data))
        documents.write_json({"fixed": self.fixed}, folder / BONES_FILE)
        rows = [
            (
                self.bodies[p.a].name,
                self.bodies[p.b].name,
                p.kind,
                p.reason in pairs.KEPT,
                p.reason,
                p.clearance,
            )
            for p in self.pairs
        ]
        columns = dict(
            zip(ROBOT_PAIRS.columns, map(np.array, zip(*rows, strict=True)), strict=True)
        )
        tables.write(columns, ROBOT_PAIRS, folder / PAIRS, self.tag)

    def to_bytes(self) -> Files:
        """Names and bytes of the files that `read` and `from_bytes` need, in one folder."""
        text = self.description
        local = text.files["robot"].decode("utf-8")
        found: dict[str, bytes] = {}
        for kind, name, file in (
            ("urdf", text.urdf_name, text.urdf),
            ("srdf", text.srdf_name, text.srdf),
            ("hulls", text.hulls_name, text.hulls),
        ):
            if name is not None and file is not None:
                local = local.replace(name, file.name)
                found[file.name] = text.files[kind]
        settings = documents.encode_json({"margin": self.margin, "neck": self.neck})
        return (
            (SETTINGS, settings.encode()),
            (ROBOT_FILE, local.encode()),
            *sorted(found.items()),
        )

    @cached_property
    def watched(self) -> np.ndarray:
        """Body indices of the watched pairs, int64 (n_pairs, 2)."""
        return pairs.watched(list(self.pairs))

    @cached_property
    def baselines(self) -> np.ndarray:
        """Baselines [m] of the watched pairs that overlap by design, (n_pairs,); else NaN."""
        return pairs.baselines(self.pairs)

    def slack(self, between: float | None = None) -> np.ndarray:
        """What is added to the distances of watched pairs that overlap by design [m], (n_pairs,).

        So counted, poses that keep the robot's margin, and ways between that keep `between`, come
        no deeper than their baselines allow (s3le.robot.pairs). Zero for all other pairs.

        Args:
            between: clearance that is kept on the paths [m]; None: of poses.
        """
        free = (
            self.margin + pairs.RESTING - self.baselines
            if between is None
            else between + pairs.DEEPER - self.baselines
        )
        own = self.margin + pairs.RESTING > self.baselines  # NaN: no
        return np.where(own, free, 0.0)

    @cached_property
    def chain(self) -> chain.Chain:
        """The robot as flat arrays for the kernels."""
        floor = np.nan_to_num(self.baselines - pairs.DEEPER)
        return chain.build(self, self.watched, self.neck, self.slack(), floor)

    @cached_property
    def followed(self) -> np.ndarray | None:
        """Which of the seven bones the robot has and can turn, bool (7,); None: all of them."""
        bones = bones_of(self, sense.points(self, sense.poses(self)), self.neck)
        present = _present(self)
        found = present.copy()
        found[present] = sense.turning(bones[:, present])
        if not found.any():
            raise RobotError(
                f"{self.description.source}: its joints turn none of the bones; look at "
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
        bones = bones_of(self, sense.points(self, self.anchor[None]), self.neck)[0]
        found = {}
        for b in np.flatnonzero(~self.followed):
            bone = bones[b] if _present(self)[b] else np.array(ABSENT[BONES[b]])
            found[BONES[b]] = (bone / np.linalg.norm(bone)).tolist()
        return found

    @property
    def tag(self) -> str:
        """Name, digest and settings: what a table says it was made for."""
        return f"{self.name} {self.digest} margin={self.margin!r} neck={self.neck}"

    def unwatched(self) -> list[tuple[str, str, str, str]]:
        """Pairs that could move but are not watched: both bodies, what they are, and why."""
        return self._named(lambda pair: pair.reason not in pairs.SURE)

    def by_design(self) -> list[tuple[str, str, str, str]]:
        """Pairs that overlap by design and are held to a baseline, as `unwatched` has them."""
        return self._named(self.designed)

    def designed(self, pair: Pair) -> bool:
        """Does a pair overlap by design, or come nearer than the margin, and is it held to that?"""
        held = pair.reason == pairs.BASELINE and pair.baseline < self.margin + pairs.RESTING
        return held or pair.reason == pairs.BOUNDED

    def _named(self, asked: Callable[[Pair], bool]) -> list[tuple[str, str, str, str]]:
        names = [origin(body.name) for body in self.bodies]
        found = [
            (names[pair.a], names[pair.b], pair.kind, pairs.told(pair))
            for pair in self.pairs
            if asked(pair)
        ]
        return list(dict.fromkeys(found))

    def certifier(self, between: float | None = None) -> Certifier:
        """A fresh independent checker (one per thread).

        Args:
            between: measure as on the paths that keep it [m] (see slack); None: as at poses.
        """
        return Certifier(self, self.watched, self.slack(between))

    def pair_name(self, row: int) -> str:
        """The two bodies of a watched pair."""
        return " and ".join(origin(self.bodies[body].name) for body in self.watched[row])


def bones_of(robot: Geometry, at: dict[str, np.ndarray], neck: str) -> np.ndarray:
    """Bones of poses, (n, 7, 3) [m], from points by role (n, 3); a robot of one arm has a neck."""
    points = np.stack([at.get(role, at["hip"]) for role in POINTS], axis=1)
    return bone_vectors(points, neck if len(robot.arms) == 2 else "joint")


def _present(robot: Geometry) -> np.ndarray:
    """Which of the seven bones the robot has, bool (7,)."""

    def there(bone: str) -> bool:
        return bone not in ABSENT or any(
            bone.startswith((f"{side}_", f"neck_to_{side}_")) for side in robot.arms
        )

    return np.array([there(bone) for bone in BONES])


def _settings(tree: Mapping[str, Any], file: Path) -> tuple[float, str]:
    """Margin [m] and neck of a robot's settings."""
    margin: Any = tree.get("margin")
    neck: Any = tree.get("neck")
    if type(margin) not in (int, float) or not 0.0 <= margin < 1.0 or neck not in NECKS:
        raise RobotError(
            f"{file}: wanted are a margin in [0, 1) m and a neck of "
            f"{', '.join(NECKS)}, got {margin!r} and {neck!r}; write it with: dvc repro robot"
        )
    return float(margin), neck
