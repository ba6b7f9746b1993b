"""Films, and a person as a camera sees one."""

import os
from pathlib import Path

import numpy as np
import pytest
from command import ROOT

from s3le.video import convert
from s3le.video.convert import Choices, Looked
from s3le.video.estimator import JOINTS

AT = {name: i for i, name in enumerate(JOINTS)}
STANDING = {  # [m] in a camera's frame, x right, y down, z away: a person who faces the camera
    "shoulder": (0.18, -0.50, 0.0), "elbow": (0.25, -0.25, 0.0), "hand": (0.25, -0.05, -0.1),
    "hip": (0.10, 0.0, 0.0), "knee": (0.10, 0.42, 0.0), "ankle": (0.10, 0.84, 0.0),
}  # fmt: skip


def person(n=60, fps=30.0, u=0.5):
    """Joints of somebody who stands and swings the arms, (n, 12, 6)."""
    joints = np.full((n, 12, 6), 0.95)
    swing = 0.15 * np.sin(2 * np.pi * 0.8 * np.arange(n) / fps)
    for name, i in AT.items():
        x, y, z = STANDING[name[2:]]
        side = 1.0 if name[0] == "l" else -1.0  # who faces the camera has the left on its right
        joints[:, i, :3] = side * x, y, z
        if name.endswith(("elbow", "hand")):
            joints[:, i, 2] += side * swing
    joints[:, :, 4] = u + joints[:, :, 0] * 0.2
    joints[:, :, 5] = 0.5 + joints[:, :, 1] * 0.2
    return joints


def looked(joints, time=None, change=None):
    time = np.arange(len(joints)) / 30.0 if time is None else time
    change = np.full(len(joints), 0.002) if change is None else change
    about = {"mean_fps": (len(time) - 1) / (time[-1] - time[0]), "frames": len(time)}
    return Looked(time, joints, change, about)


def made(joints, time=None, change=None, **choices):
    return convert.skeletons(looked(joints, time, change), Choices(**choices))


# --- films


def film(path, pictures, times=None, turn=0, fps=25, aspect=None):
    """A film of uint8 pictures; times [s] make its rate vary."""
    av = pytest.importorskip("av")
    from fractions import Fraction

    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=fps, options={"crf": "18", "g": "10"})
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt, stream.codec_context.thread_count = "yuv420p", 1
        if times is not None:
            stream.codec_context.time_base = stream.time_base = Fraction(1, 1000)
        if aspect:
            stream.codec_context.sample_aspect_ratio = aspect
        if turn:
            stream.set_display_rotation(turn)
        for i, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, "rgb24")
            if times is not None:
                frame.pts, frame.time_base = round(times[i] * 1000), Fraction(1, 1000)
            out.mux(stream.encode(frame))
        out.mux(stream.encode())
    return path


def scene(n=20, shade=40, size=(48, 64)):
    """A dark film with a bright bar at the top."""
    pictures = [np.full((*size, 3), shade, np.uint8) for _ in range(n)]
    for i, picture in enumerate(pictures):
        picture[:12] = 220
        picture[-4:, : i + 1] = 120
    return pictures


# --- the real one


REAL = Path(os.environ.get("S3LE_VIDEO", ROOT / "data" / "downloads" / "video" / "demo.mp4"))
