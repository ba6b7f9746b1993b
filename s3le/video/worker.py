"""The far end of the pipe: MediaPipe Pose, in an environment that has it and not this project.

Run as a script by that environment's interpreter, so nothing of the project is imported and the
syntax is Python 3.9's. The near end (s3le/video/process.py) takes the words of the pipe from here.
Another estimator is another script that speaks like this one.

Every message is a header (magic, version, kind, width, height, bytes that follow) and its bytes:

    near -> far   FRAME    width x height pixels, three bytes each: red, green, blue
    far -> near   HELLO    JSON: estimator, version; once, before anything else
                  JOINTS   12 x 6 little-endian float32: x, y, z [m] (x to the image's right, y
                           down, z away from the camera), visibility in [0, 1], u, v (shares of the
                           image's width and height)
                  NOBODY   nothing
                  FAILED   words, UTF-8; the last message

One answer to each frame, in their order. The near end closes the pipe when it is done.
"""

from __future__ import annotations

import importlib.util
import json
import os
import struct
import sys
import types

MAGIC, VERSION = b"S3LV", 1
HEADER = struct.Struct("<4sBBHHI")
FRAME, HELLO, JOINTS, NOBODY, FAILED = 1, 2, 3, 4, 5
ANSWER = 4096  # bytes that an answer has at most
LARGEST = 4096  # pixels of an image's side at most
# The joints of an answer, and MediaPipe's landmarks that they are.
NAMES = (
    "r_shoulder", "r_elbow", "r_hand", "l_shoulder", "l_elbow", "l_hand",
    "r_hip", "l_hip", "r_knee", "l_knee", "r_ankle", "l_ankle",
)  # fmt: skip
_OF_POSE = (12, 14, 16, 11, 13, 15, 24, 23, 26, 25, 28, 27)
_PACKAGES = ("mediapipe", "mediapipe.python", "mediapipe.python.solutions")


def message(kind: int, payload: bytes = b"", width: int = 0, height: int = 0) -> bytes:
    """A message as it goes through the pipe."""
    return HEADER.pack(MAGIC, VERSION, kind, width, height, len(payload)) + payload


def _pose():
    """MediaPipe's Pose class and version, without what else its packages would load.

    Their __init__ files import drawing, audio and converters, and with these OpenCV, matplotlib,
    JAX, ...: two gigabytes that Pose has no use for. Empty packages in their place let its own
    modules be found.
    """
    spec = importlib.util.find_spec("mediapipe")
    if spec is None:
        raise ImportError("no package mediapipe")
    root = list(spec.submodule_search_locations)[0]
    for name in _PACKAGES:
        module = types.ModuleType(name)
        module.__path__ = [os.path.join(root, *name.split(".")[1:])]
        sys.modules[name] = module
    from importlib.metadata import version

    from mediapipe.python.solutions.pose import Pose

    return Pose, version("mediapipe")


def main() -> int:
    """Answer frames on standard input until it ends."""
    pipe = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not end up among the answers

    def say(kind: int, payload: bytes = b"") -> None:
        pipe.write(message(kind, payload[:ANSWER]))
        pipe.flush()

    try:
        import numpy as np

        pose_class, version = _pose()
        # Its own smoothing lags and takes every video for 30 Hz; s3le smooths both ways in time.
        pose = pose_class(model_complexity=1, smooth_landmarks=False)
    except Exception as error:
        say(FAILED, f"{type(error).__name__}: {error}".encode())
        return 1
    say(HELLO, json.dumps({"estimator": "mediapipe", "version": version}).encode())
    frames = sys.stdin.buffer
    while True:
        head = frames.read(HEADER.size)
        if not head:
            return 0
        try:
            magic, speaks, kind, width, height, size = HEADER.unpack(head)
            if (magic, speaks, kind) != (MAGIC, VERSION, FRAME) or size != 3 * width * height:
                raise ValueError("not a frame of this protocol")
            pixels = frames.read(size)
            if len(pixels) != size:
                return 1  # the near end is gone
            picture = np.frombuffer(pixels, np.uint8).reshape(height, width, 3)
            found = pose.process(picture)
            if found.pose_world_landmarks is None:
                say(NOBODY)
                continue
            world, image = found.pose_world_landmarks.landmark, found.pose_landmarks.landmark
            rows = [
                (world[i].x, world[i].y, world[i].z, image[i].visibility, image[i].x, image[i].y)
                for i in _OF_POSE
            ]
            say(JOINTS, np.array(rows, "<f4").tobytes())
        except Exception as error:
            say(FAILED, f"{type(error).__name__}: {error}".encode())
            return 1


if __name__ == "__main__":
    sys.exit(main())
