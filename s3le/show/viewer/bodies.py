"""Human and robots as nodes of viser's scene: made once, then only moved."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
import viser

from s3le.errors import RobotError
from s3le.robot.model import Geometry
from s3le.robot.posing import Nearness, Poser
from s3le.show import motions
from s3le.show.human import Size, stand, stick_figures
from s3le.show.motions import Human, Shown
from s3le.show.visual import Visual, visuals

Colour = tuple[int, int, int]
SIDES = [20, 20]  # of a capsule's mesh
PALE, ALARM = (226, 230, 234), (230, 110, 20)
GLASS = 0.35  # opacity of what something else is to be seen through


def rgb(colour: str) -> Colour:
    """A colour as "#rrggbb" in numbers."""
    r, g, b = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return r, g, b


def soft(colour: str) -> Colour:
    """The colour of a surface: lighter, so that shading shows."""
    r, g, b = (round(c + 0.3 * (255 - c)) for c in rgb(colour))
    return r, g, b


def _capsule(length: float, radius: float) -> trimesh.Trimesh:
    return trimesh.creation.capsule(height=max(length, 1e-6), radius=radius, count=SIDES)


def _turns(along: np.ndarray) -> np.ndarray:
    """Unit quaternions (n, 4), w first, that turn z into the directions (n, 3)."""
    length = np.linalg.norm(along, axis=1, keepdims=True)
    d = np.where(length > 1e-9, along / np.maximum(length, 1e-9), [0.0, 0.0, 1.0])
    half = np.stack([1.0 + d[:, 2], -d[:, 1], d[:, 0], np.zeros(len(d))], axis=1)
    size = np.linalg.norm(half, axis=1, keepdims=True)
    return np.where(size > 1e-6, half / np.maximum(size, 1e-9), [0.0, 1.0, 0.0, 0.0])


class Looks(NamedTuple):
    """What a robot is drawn from, besides its bodies."""

    meshes: list[Visual]
    note: str  # why there are none


def looks_of(robot: Geometry, file: Path | None = None) -> Looks:
    """The meshes of a robot.

    Args:
        robot: whose.
        file: URDF to take them from; None: its own, and none where they are not found.

    Raises:
        RobotError: `file` cannot be read, or names meshes that cannot.
    """
    try:
        return Looks(visuals(robot, file), "")
    except RobotError as refusal:
        if file is not None:
            raise
        return Looks([], f"drawn from its bodies, {refusal}")


class RobotNodes:
    """One robot of one motion."""

    def __init__(
        self, server: viser.ViserServer, name: str, shown: Shown, colour: str, place: np.ndarray,
        looks: Looks,
    ) -> None:  # fmt: skip
        """Put a robot into the scene.

        Args:
            server: whose scene.
            name: of its node.
            shown: its motion.
            colour: of its moving bodies.
            place: where its base frame stands [m], (3,).
            looks: its meshes.
        """
        robot = shown.robot
        self.shown, self.place, self.note = shown, place, looks.note
        self._poser = Poser(robot)
        self._near = Nearness(robot, robot.watched, robot.slack())
        scene = server.scene
        self.root = scene.add_frame(name, show_axes=False, position=place)
        self._frames = [
            scene.add_frame(f"{name}/{i}", show_axes=False) for i in range(robot.n_dof + 1)
        ]
        moving, still = soft(colour), PALE
        self._colours = [still if body.joint < 0 else moving for body in robot.bodies]
        self._bodies = [
            _add_body(scene, f"{name}/{body.joint + 1}/body{i}", body, tint)
            for i, (body, tint) in enumerate(zip(robot.bodies, self._colours, strict=True))
        ]
        self._meshes = [
            scene.add_mesh_simple(
                f"{name}/{look.joint + 1}/mesh{i}", look.vertices.astype(np.float32), look.faces,
                color=tuple(round(255 * c) for c in look.colour), side="double",
            )
            for i, look in enumerate(looks.meshes)
        ]  # fmt: skip
        self._line = scene.add_line_segments(
            f"{name}/closest", np.zeros((1, 2, 3)), ALARM, thickness=3.0,
            thickness_units="screen", visible=False,
        )  # fmt: skip
        self._distance = scene.add_label(
            f"{name}/distance", "", visible=False, anchor="bottom-center", font_screen_scale=1.1
        )
        self._tinted: tuple[int, ...] = ()
        self.clearance, self.pair = np.nan, ""

    @property
    def has_meshes(self) -> bool:
        """Is there more to see than bodies?"""
        return bool(self._meshes)

    def look(self, bodies: bool, glass: bool) -> None:
        """Choose what is drawn.

        Args:
            bodies: the collision bodies; without meshes they are what there is to see.
            glass: all of it see-through, for what lies inside.
        """
        over = bodies and self.has_meshes
        for node in self._bodies:
            node.visible = bodies or not self.has_meshes
            node.opacity = GLASS if glass or over else None
        for node in self._meshes:
            node.opacity = GLASS if glass else None

    def move(self, q: np.ndarray, closest: bool) -> None:
        """Take a pose q [rad], (n_dof,), and find the closest pair if it is to be drawn."""
        at = self._poser.place(q)
        for frame, wxyz, position in zip(self._frames, at.wxyz, at.position, strict=True):
            frame.wxyz, frame.position = wxyz, position
        tinted: tuple[int, ...] = ()
        if closest:
            found = self._near.closest(q)
            tinted = tuple(int(i) for i in self.shown.robot.watched[found.pair])
            self.clearance = found.clearance
            self.pair = self.shown.robot.pair_name(found.pair)
            self._line.points = found.points[None].astype(np.float32)
            self._distance.position = found.points.mean(axis=0) + [0.0, 0.0, 0.03]
            self._distance.text = f"{found.clearance * 1e3:.1f} mm"
        self._line.visible = self._distance.visible = closest
        for body in set(self._tinted) ^ set(tinted):
            self._bodies[body].color = ALARM if body in tinted else self._colours[body]
        self._tinted = tinted


def _add_body(scene: viser.SceneApi, name: str, body, colour: Colour) -> viser.MeshHandle:
    """A capsule, fixed in the frame above it."""
    mesh = _capsule(float(np.linalg.norm(body.b - body.a)), body.radius)
    return scene.add_mesh_simple(
        name, mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32), color=colour,
        wxyz=_turns((body.b - body.a)[None])[0], position=(body.a + body.b) / 2,
    )  # fmt: skip


class HumanNodes:
    """The human once: beside the robots, or over one of them."""

    def __init__(
        self,
        server: viser.ViserServer,
        name: str,
        seen: Human,
        size: Size,
        place: np.ndarray,
        floor: float | None,
        slim: float = 1.0,
    ) -> None:
        """Put the human into the scene.

        Args:
            server: whose scene.
            name: of its node.
            seen: the human.
            size: lengths of its segments [m].
            place: where its hip is [m], (3,).
            floor: height of the floor that it is held up from [m]; None: over a robot.
            slim: factor on its thickness.
        """
        self._seen, self._size = seen, size
        self.root = server.scene.add_frame(name, show_axes=False, position=place)
        made = stick_figures(seen.x[:1], size, slim)
        self._nodes = self._add(server, name, made.ends[0], made.radius, made.colours)
        if floor is not None:
            self._add(server, f"{name}/stand", *stand(place[2] - floor))

    @staticmethod
    def _add(server, name, ends, radius, colours) -> list[viser.MeshHandle]:
        """Capsules where they are."""
        nodes = []
        along = ends[:, 1] - ends[:, 0]
        for i, (part, turn) in enumerate(zip(ends, _turns(along), strict=True)):
            mesh = _capsule(float(np.linalg.norm(along[i])), radius[i])
            nodes.append(
                server.scene.add_mesh_simple(
                    f"{name}/part{i}", mesh.vertices.astype(np.float32),
                    mesh.faces.astype(np.uint32), color=rgb(colours[i]), wxyz=turn,
                    position=part.mean(axis=0),
                )
            )  # fmt: skip
        return nodes

    def move(self, time: float, hip: np.ndarray | None = None) -> None:
        """Show a moment [s], with the hip at a place of the scene [m] if it moves."""
        ends = stick_figures(motions.skeletons(self._seen, np.array([time])), self._size).ends[0]
        turns = _turns(ends[:, 1] - ends[:, 0])
        for node, part, turn in zip(self._nodes, ends, turns, strict=True):
            node.wxyz, node.position = turn, part.mean(axis=0)
        if hip is not None:
            self.root.position = hip
