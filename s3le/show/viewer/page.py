"""The page: one scene, one panel, the same for everybody who opens it."""

import contextlib
import errno
import io
import socket
import threading
import time as clock
from collections.abc import Callable
from html import escape
from pathlib import Path

import numpy as np
import viser

from s3le.errors import FilmError
from s3le.kernels import batch
from s3le.show import pace
from s3le.show.human import NOMINAL, Size
from s3le.show.motions import Human, Shown, modes, poses
from s3le.show.viewer import timeline
from s3le.show.viewer.bodies import HumanNodes, RobotNodes, looks_of
from s3le.show.viewer.player import SPEEDS, Player
from s3le.skeleton import bone_vectors

BESIDE, BESIDE_SMALL, OVER, HIDDEN = "beside", "beside, robot's size", "over the robots", "hidden"
COLOURS = ("#7d9bb8", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#8c6d31", "#7f7f7f")
TRIES = 100  # ports
APART = 0.95  # [m] between figures
REFRESH = 1.0 / 30.0  # [s]
TOOLS = ("|◀", "◀", "▶", "▶|")
VIEWS = {"front": (12.0, 12.0), "left": (90.0, 8.0), "right": (-90.0, 8.0), "above": (0.0, 75.0)}


def free_port(host: str, port: int) -> int:
    """The port, or the next one that is free; 0: any. viser would wait for ever on a foreign host.

    Raises:
        FilmError: the address cannot be listened on.
    """
    for wanted in range(port, min(port + TRIES, 65_536)):
        try:
            with socket.create_server((host, wanted)) as free:
                return free.getsockname()[1]
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                reason = error.strerror or str(error)
                raise FilmError(f"{host}:{wanted} cannot be listened on ({reason})") from None
    raise FilmError(f"{host}: ports {port} to {port + TRIES - 1} are taken; give another --port")


class Page:
    """Serves motions to browsers until stop is called."""

    def __init__(
        self,
        motions: list[Shown],
        human: Human | None,
        times: np.ndarray,
        host: str,
        port: int,
        progress: Callable[[int], object] | None = None,
        meshes: Path | None = None,
    ) -> None:
        """Measure the motions and open the page.

        Args:
            motions: what is shown, at least one.
            human: whom they follow, or None.
            times: the moments that the slider knows [s], (n,).
            host: address to listen on.
            port: to listen on; 0 and taken ones: the next that is free.
            progress: called with numbers of moments measured.
            meshes: URDF whose meshes the robots are drawn from; None: their own.

        Raises:
            FilmError: the address cannot be listened on.
            RobotError: `meshes` cannot be read.
        """
        self._looks = [looks_of(m.robot, meshes) for m in motions]
        self.motions, self.human, self.player = motions, human, Player(times)
        self._q = [poses(m, times) for m in motions]
        self._kind = [pace.kinds(m, times) for m in motions]
        self._clearance = [
            batch.clearances(m.robot.chain, q, progress)
            for m, q in zip(motions, self._q, strict=True)
        ]
        port = free_port(host, port)
        with contextlib.redirect_stdout(io.StringIO()):  # it greets even when told not to
            self._server = viser.ViserServer(host=host, port=port, label="S3LE", verbose=False)
        self._lock = threading.Lock()  # one thread draws at a time
        self._stale = True
        self._shown_index = -1
        with self._server.atomic():
            self._build_scene()
            self._build_panel()
        self.draw()

    @property
    def address(self) -> str:
        """Where a browser finds it."""
        return f"http://{self._server.get_host()}:{self._server.get_port()}"

    def run(self, stopped: threading.Event) -> None:
        """Play until somebody says stop."""
        then = clock.monotonic()
        while not stopped.wait(REFRESH):
            now = clock.monotonic()
            self.player.advance(now - then)
            then = now
            if self._stale or self.player.index != self._shown_index:
                self.draw()

    def stop(self) -> None:
        """Close the page."""
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()

    # --- the scene

    def _build_scene(self) -> None:
        scene = self._server.scene
        scene.set_up_direction("+z")
        scene.configure_default_lights(cast_shadow=False)  # dear where there is no GPU
        floors = [
            (batch.capsule_ends(m.robot.chain, q[:1])[0][..., 2].min(axis=1)
             - m.robot.chain.body_radius).min()
            for m, q in zip(self.motions, self._q, strict=True)
        ]  # fmt: skip
        figures = len(self.motions) + (self.human is not None)
        # Seen from the front, what comes first stands on the left.
        along = (np.arange(figures) - (figures - 1) / 2) * APART
        own = along[figures - len(self.motions) :]
        self._robots = [
            RobotNodes(
                self._server, f"/robot{i}", m, COLOURS[i % len(COLOURS)],
                np.array([0.0, own[i], -floors[i]]), self._looks[i],
            )
            for i, m in enumerate(self.motions)
        ]  # fmt: skip
        self._names = [
            scene.add_label(
                f"/robot{i}/name", m.label, position=(0.0, 0.0, 0.62), anchor="bottom-center"
            )
            for i, m in enumerate(self.motions)
        ]
        hips = [self._hip(i, 0)[2] + r.place[2] for i, r in enumerate(self._robots)]
        self._human_place = np.array([0.0, along[0], max(hips)])
        self._humans: list[HumanNodes] = []
        scene.add_grid(
            "/floor", infinite_grid=True, cell_size=0.1, section_size=0.5, cell_thickness=0.6,
            section_thickness=1.0, cell_color=(170, 176, 184), section_color=(140, 146, 154),
            fade_distance=8.0, shadow_opacity=0.25,
        )  # fmt: skip
        self._middle = (0.0, 0.0, max(hips) * 1.05)
        self._far = max(2.3, (APART * figures + 0.7) / 0.69)  # what a square window holds
        camera = self._server.initial_camera
        camera.position, camera.look_at = self._from(*VIEWS["front"]), self._middle
        camera.up = (0.0, 0.0, 1.0)
        camera.fov = float(np.radians(35.0))

    def _from(self, azimuth: float, elevation: float) -> tuple[float, float, float]:
        az, el = np.radians(azimuth), np.radians(elevation)
        towards = np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
        return tuple((np.array(self._middle) + self._far * towards).tolist())

    def _hip(self, robot: int, index: int) -> np.ndarray:
        """The hip point in the robot's frame [m], (3,)."""
        chain = self.motions[robot].robot.chain
        return batch.points(chain, self._q[robot][index : index + 1])[0, 0]

    def _size(self, robot: int) -> Size:
        """The robot's own segments [m], the mean of left and right."""
        own = self.motions[robot].robot
        points = batch.points(own.chain, own.anchor[None])
        length = np.linalg.norm(bone_vectors(points, own.neck)[0], axis=1)
        return Size(float(length[0]), *(float(length[1:4][k] + length[4:7][k]) / 2
                                        for k in range(3)))  # fmt: skip

    def _place_humans(self, how: str) -> None:
        """Make the human anew, as it is to stand."""
        for old in self._humans:
            old.root.remove()
        self._humans = []
        if self.human is None or how == HIDDEN:
            return
        if how == OVER:
            self._humans = [
                HumanNodes(
                    self._server, f"/human_over{i}", self.human, self._size(i),
                    robot.place + self._hip(i, 0), None, 0.8,
                )
                for i, robot in enumerate(self._robots)
            ]  # fmt: skip
        else:
            size = NOMINAL if how == BESIDE else self._size(0)
            self._humans = [
                HumanNodes(self._server, "/human", self.human, size, self._human_place, 0.0)
            ]
            self._server.scene.add_label(
                "/human/name", f"human: {self.human.label}", anchor="bottom-center",
                position=(0.0, 0.0, 1.72 * size.trunk),
            )  # fmt: skip

    # --- the panel

    def _build_panel(self) -> None:
        gui, player = self._server.gui, self.player
        self._theme(False)
        times = player.times
        self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY)
        self._slider = gui.add_slider(
            "time [s]", float(np.floor(times[0] * 1e3) / 1e3),
            float(np.ceil(max(times[-1], times[0] + 0.001) * 1e3) / 1e3), 0.001,
            round(float(times[0]), 3),
        )  # fmt: skip
        n = len(self.motions)
        self._cursor = gui.add_html(timeline.cursor(0.0, n))
        margins = [m.robot.margin for m in self.motions]
        colours = [COLOURS[i % len(COLOURS)] for i in range(n)]
        gui.add_html(timeline.picture(self._kind, self._clearance, colours, margins))
        self._words = gui.add_html("")
        tools = gui.add_button_group("step", TOOLS)
        speed = gui.add_button_group("speed", tuple(SPEEDS))
        loop = gui.add_checkbox("loop", True)
        self._closest = gui.add_checkbox("closest pair", False)
        has_meshes = any(robot.has_meshes for robot in self._robots)
        self._bodies = gui.add_checkbox(
            "collision bodies", not has_meshes, disabled=not has_meshes,
            hint=None if has_meshes else "The robot is drawn from its collision bodies.",
        )  # fmt: skip
        options = (BESIDE, BESIDE_SMALL, OVER, HIDDEN) if self.human else (HIDDEN,)
        self._stance = gui.add_dropdown("human", options, disabled=self.human is None)
        seen = [gui.add_checkbox(m.label, True) for m in self.motions] if n > 1 else []
        dark = gui.add_checkbox("dark", False)
        views = gui.add_button_group("camera", tuple(VIEWS))

        self._play.on_click(lambda _: self._do(player.toggle))
        self._slider.on_update(self._scrub)
        tools.on_click(lambda event: self._do(self._tool, event.target.value))
        speed.on_click(lambda event: player.set_speed(SPEEDS[event.target.value]))
        loop.on_update(lambda event: player.set_loop(event.target.value))
        dark.on_update(lambda event: self._theme(event.target.value))
        views.on_click(self._look_from)
        for box in (self._closest, self._bodies):
            box.on_update(lambda _: self._do(self._look))
        self._stance.on_update(lambda _: self._do(self._look, True))
        for box, robot in zip(seen, self._robots, strict=False):
            box.on_update(
                lambda event, root=robot.root: setattr(root, "visible", event.target.value)
            )
        self._look(True)

    def _theme(self, dark: bool) -> None:
        self._server.gui.configure_theme(
            control_layout="collapsible", control_width="medium", dark_mode=dark, show_logo=False,
            show_share_button=False, brand_color=(0, 114, 178),
        )  # fmt: skip

    def _do(self, action: Callable, *words: object) -> None:
        """What a person did: carried out while nobody draws, and seen at the next drawing."""
        with self._lock:
            action(*words)
            self._stale = True

    def _scrub(self, event: viser.GuiEvent) -> None:
        if event.client is not None:  # a person's hand, not this page following the play
            self.player.pause()
            self._do(self.player.seek, event.target.value)

    def _tool(self, which: str) -> None:
        far = len(self.player.times)
        self.player.step(dict(zip(TOOLS, (-far, -1, 1, far), strict=True))[which])

    def _look(self, humans: bool = False) -> None:
        if humans:
            self._place_humans(self._stance.value)
        over = self.human is not None and self._stance.value == OVER
        for robot in self._robots:
            robot.look(self._bodies.value, over)

    def _look_from(self, event: viser.GuiEvent) -> None:
        if event.client is not None:
            camera = event.client.camera
            camera.position = self._from(*VIEWS[event.target.value])
            camera.look_at = self._middle
            camera.up_direction = (0.0, 0.0, 1.0)

    # --- drawing

    def draw(self) -> None:
        """Bring everything to the player's moment."""
        with self._lock, self._server.atomic():
            index, self._stale = self.player.index, False
            moment = float(self.player.times[index])
            for robot, q in zip(self._robots, self._q, strict=True):
                robot.move(q[index], self._closest.value)
            for i, human in enumerate(self._humans):
                over = self._stance.value == OVER
                human.move(moment, self._robots[i].place + self._hip(i, index) if over else None)
            self._slider.value = round(moment, 3)
            share = index / max(len(self.player.times) - 1, 1)
            self._cursor.content = timeline.cursor(share, len(self.motions))
            self._words.content = self._say(index, moment)
            label = "Pause" if self.player.playing else "Play"
            if self._play.label != label:
                self._play.label = label
                self._play.icon = (
                    viser.Icon.PLAYER_PAUSE if self.player.playing else viser.Icon.PLAYER_PLAY
                )
            self._shown_index = index

    def _say(self, index: int, moment: float) -> str:
        """The numbers of one moment."""
        lines = [f"<b>{moment:.3f} s</b>, {index + 1} of {len(self.player.times)}"]
        for i, shown in enumerate(self.motions):
            kind = pace.word(shown, self._kind[i][index])
            mode = modes(shown, self.player.times[index : index + 1])
            word = f"{kind} ({escape(str(mode[0])[:40])})" if mode is not None else kind
            clear = self._clearance[i][index] * 1e3
            text = f"{clear:.1f} mm clear" if clear >= 0.0 else f"collides by {-clear:.1f} mm"
            lines.append(
                f'<span style="color:{COLOURS[i % len(COLOURS)]}">●</span> '
                f"<b>{escape(shown.label)}</b>: {word}, {text}"
            )
            if self._closest.value:
                lines.append(f"&emsp;closest: {escape(self._robots[i].pair)}")
            if self._robots[i].note:
                lines.append(f"&emsp;{escape(self._robots[i].note[:200])}")
        body = "<br>".join(lines)
        look = "padding:0 1em;font-size:0.85em;line-height:1.6;overflow-wrap:anywhere"
        return f'<div style="{look}">{body}</div>'
