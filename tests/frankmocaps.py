"""Frames as FrankMocap writes them, of a body that is known."""

import collections
import pickle

import bodies
import numpy as np

BODY = bodies.body()
CAMERA = BODY @ bodies.INTO["camera"].T
PIXELS = bodies.listed("spin49", CAMERA) * 300.0 + (640, 360, 0)


# --- FrankMocap


def frankmocap(folder, frames, protocol=4, people=1, key="pred_joints_img", name="{:05d}"):
    """A folder as FrankMocap writes it; frames are numbers of frames."""
    folder.mkdir(parents=True, exist_ok=True)
    for row, frame in enumerate(frames):
        one = {
            key: PIXELS[row], "pred_camera": np.array([0.9, 0.0, 0.1], "f4"),
            "pred_body_pose": np.zeros((1, 72), "f4"), "bbox_scale_ratio": np.float64(1.3),
        }  # fmt: skip
        saved = collections.OrderedDict(
            demo_type="body", smpl_type="smpl", image_path=f"/x/{frame:05d}.jpg",
            body_bbox_list=[np.array([1, 2, 3, 4])] * people, hand_bbox_list=[None] * people,
            save_mesh=False, pred_output_list=[one] + [None] * (people - 1),
        )  # fmt: skip
        path = folder / f"{name.format(frame)}_prediction_result.pkl"
        path.write_bytes(pickle.dumps(saved, protocol))
    return folder
