"""Doors of keypoints: joints of estimators in archives, arrays, tables, JSON and pickles.

What is owed does not go the reader's way: however a body is turned, the distances between its
points are those in the file, but for the unit.
"""

import csv
import io
import json
import pickle
from functools import partial
from pathlib import Path
from typing import Any

import bodies
import estimators
import numpy as np
from doorway import STRICT, Door, Files, Reading, once

CAMERA = bodies.body(6) @ bodies.INTO["camera"].T
PIXELS = bodies.listed("spin49", CAMERA).astype("f4") * 300 + 500
NAMES = ("hip", "r_hip", "l_hip", "neck", "r_shoulder", "r_elbow", "r_wrist", "l_shoulder",
         "l_elbow", "l_wrist")  # fmt: skip
POSE = bodies.pose(6)
CENTRES = ("MidHip", "RHip", "LHip", "Neck", "RShoulder", "RElbow", "RWrist", "LShoulder",
           "LElbow", "LWrist")  # fmt: skip
PICKLE = "a_00002_prediction_result.pkl"


def _distances(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, :, None] - points[:, None], axis=-1)


def _owed(it: Reading, joints: np.ndarray | None, fps: float | None, scaled: bool = False) -> None:
    """The clip's points lie as those of the joints do, (n, j, at least 3)."""
    from s3le.human.clip import FARTHEST
    from s3le.human.keypoints.clocks import USUAL
    from s3le.human.keypoints.layouts import LAYOUTS, pick

    clip = it.result
    assert USUAL[0] <= clip.fps <= USUAL[1]
    assert fps is None or clip.fps == fps
    known = np.isfinite(clip.points).all(axis=(1, 2))
    assert known.any() and np.isnan(clip.points[~known]).all()
    assert (np.abs(clip.points[known]) <= FARTHEST).all()
    assert clip.reading.told is not None and all(w.isprintable() for w in clip.reading.told)
    if joints is None:
        return
    name = clip.reading.how.layout
    points = joints[..., :3] if name is None else pick(joints[..., :3], LAYOUTS[name].points)
    assert len(points) == len(clip.points)
    unit = {"m": 1.0, "cm": 0.01, "mm": 0.001}[clip.reading.unit]
    got, want = _distances(clip.points[known]), _distances(points[known]) * unit
    if scaled:
        got, want = (d / d[:, 0, 3][:, None, None] for d in (got, want))
    assert np.allclose(got, want, rtol=1e-5, atol=1e-6)
    trunk = np.median(_distances(clip.points[known])[:, 0, 3])
    assert 0.19 < trunk < 1.21


def _read(name: str) -> Any:
    def door(folder: Path) -> Any:
        from s3le.human.read import read_clip

        return read_clip(folder / name if name else folder)

    return door


def _archive_owes(it: Reading) -> None:
    with np.load(it.folder / "a.npz", allow_pickle=False) as found:
        arrays = {key.lower(): found[key] for key in found.files}
    _owed(it, arrays.get("world", arrays.get("joints")), _rate(arrays))


def _rate(arrays: dict[str, Any]) -> float | None:
    rate = arrays.get("fps")
    return None if rate is None else float(rate)


def _array_owes(it: Reading) -> None:
    _owed(it, np.load(it.folder / "a.npy", allow_pickle=False), 30.0)


def _table_owes(it: Reading) -> None:
    text = it.files["a.csv"].decode("utf-8-sig")
    lines = [line for line in text.splitlines() if line.strip()]
    rows = list(csv.reader(io.StringIO("\n".join(lines), newline=""), strict=True))
    comma = max(",;\t", key=lines[0].count)
    assert comma == ",", "a good file has commas"
    head, rows = [name.strip() for name in rows[0]], rows[1:]
    assert all(len(row) == len(head) == len(set(head)) for row in rows)
    fields = [field.strip() for row in rows for field in row]
    plain = ("", "nan", "na", "null", "none")
    assert all(STRICT.fullmatch(f.encode()) or f.lower() in plain for f in fields)
    columns = [f"{name}_{axis}" for name in NAMES for axis in "xyz"]
    if set(columns) <= set(head):
        table = np.array([
            [float(row[head.index(c)].strip().lower().replace("null", "nan") or "nan")
             if row[head.index(c)].strip().lower() not in plain else np.nan for c in columns]
            for row in rows
        ])  # fmt: skip
        if all(word.endswith("Hz by its times") for word in it.result.reading.told[-1:]):
            _owed(it, table.reshape(len(rows), 10, 3), None)
            return
    _owed(it, None, None)


def _json_owes(it: Reading) -> None:
    tree = json.loads(it.files["a.json"].decode(), object_pairs_hook=once)
    frames = tree.get("frames") if isinstance(tree, dict) else None
    joints = None
    if isinstance(frames, list) and all(isinstance(f, dict) and "joints" in f for f in frames):
        joints = np.array([f["joints"] for f in frames], float)
    elif isinstance(tree, dict) and all(name in tree for name in NAMES):
        joints = np.stack([np.array(tree[name], float) for name in NAMES], axis=1)
    _owed(it, joints, None)


class _Plain(pickle.Unpickler):
    """Python's own, for numpy's arrays alone."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ("_codecs", "encode"):
            return super().find_class(module, name)
        known = {"_reconstruct", "ndarray", "dtype", "OrderedDict", "scalar", "_frombuffer"}
        assert name in known and module.split(".")[0] in ("numpy", "collections"), (module, name)
        return super().find_class(module, name)


def _pickle_owes(it: Reading) -> None:
    frames = []
    for name in sorted(it.files):
        tree = _Plain(io.BytesIO(it.files[name])).load()
        people = tree["pred_output_list"]
        one = people[0] if people else None
        frames.append(np.full((49, 3), np.nan) if one is None else one["pred_joints_img"])
    with np.errstate(invalid="ignore"):  # NaN of other bits
        joints = np.array(frames, float).reshape(len(frames), 49, 3)
    _owed(it, joints, 30.0, scaled=True)


def _centres_owe(it: Reading) -> None:
    lines = [line for line in it.files["a.trc"].decode("utf-8-sig").split("\n") if line.strip()]
    assert lines[0].startswith("PathFileType") and lines[3].lower().startswith("frame#")
    names = [name.strip() for name in lines[3].split("\t")[2:] if name.strip()]
    rows = [line.rstrip("\r").split("\t") for line in lines[5:]]
    rows = [row[: 2 + 3 * len(names)] for row in rows]
    assert all(len(row) == 2 + 3 * len(names) for row in rows)
    if set(CENTRES) <= set(names):
        plain = ("", "nan", "na", "null", "none")
        table = np.array([[np.nan if f.strip().lower() in plain else float(f) for f in row]
                          for row in rows])  # fmt: skip
        places = [names.index(name) for name in CENTRES]
        _owed(it, table[:, 2:].reshape(len(rows), -1, 3)[:, places], None)
    else:
        _owed(it, None, None)


class _Joblib(pickle._Unpickler):
    """Python's own in Python, for numbers behind the names that stand for them."""

    class Wrapper:
        """What joblib writes in the place of an array."""

    dispatch = dict(pickle._Unpickler.dispatch)  # noqa: RUF012

    def find_class(self, module: str, name: str) -> Any:
        if name == "NumpyArrayWrapper":
            return self.Wrapper
        if (module, name) == ("_codecs", "encode"):
            return super().find_class(module, name)
        assert name in {"ndarray", "dtype", "scalar"} and module.split(".")[0] == "numpy"
        return super().find_class(module, name)

    def load_build(self) -> None:
        super().load_build()
        made = self.stack[-1]
        if isinstance(made, self.Wrapper):
            if made.numpy_array_alignment_bytes is not None:
                self.read(self.read(1)[0])
            size = int(np.prod(made.shape)) * made.dtype.itemsize
            flat = np.frombuffer(self.read(size), made.dtype)
            self.stack[-1] = flat.reshape(made.shape, order=made.order)

    dispatch[pickle.BUILD[0]] = load_build


def _rotations_owe(it: Reading) -> None:
    from s3le.human.keypoints import smpl

    if "a.pt" in it.files:  # its parts have checksums
        _owed(it, smpl.joints(POSE), 30.0)
        return
    tree = _Joblib(io.BytesIO(it.files["a.pkl"])).load()
    ((_, one),) = tree.items()
    pose = one.get("pose_world")
    numbers = one.get("frame_ids")
    known = {"pose", "trans", "pose_world", "trans_world", "betas", "verts", "frame_ids"}
    if set(one) == known and numbers.tolist() == list(range(len(POSE))):
        _owed(it, smpl.joints(np.asarray(pose, float)), 30.0)
    else:
        _owed(it, None, None)


def _people_owe(it: Reading) -> None:
    tree = json.loads(it.files["a.json"].decode(), object_pairs_hook=once)
    frames = tree.get("instance_info")
    try:
        joints = np.array([f["instances"][0]["keypoints"] for f in frames], float)
        numbers = [frame["frame_id"] for frame in frames]
    except (KeyError, IndexError, TypeError, ValueError):
        joints = None
    if joints is not None and numbers == list(range(len(frames))) and joints.ndim == 3:
        _owed(it, joints, None)
    else:
        _owed(it, None, None)


def _scene_owes(it: Reading) -> None:
    data = it.files["a.glb"]
    assert data[:4] == b"glTF" and int.from_bytes(data[8:12], "little") == len(data)
    size = int.from_bytes(data[12:16], "little")
    tree = json.loads(data[20 : 20 + size].decode(), object_pairs_hook=once)
    assert len(tree["nodes"]) > 10 and len(tree["animations"]) <= 1
    _owed(it, None, None)


def _frame(number: int, protocol: int) -> bytes:
    one = {"pred_joints_img": PIXELS[number], "pred_camera": np.ones(3, "f4"), "x": np.float64(1.5)}
    tree = {"demo_type": "body", "image_path": "/x.jpg", "pred_output_list": [one]}
    return pickle.dumps(tree, protocol)


def _made(kind: str) -> list[Files]:
    stream = io.BytesIO()
    if kind == "npz":
        visible = np.ones(CAMERA.shape[:2], "f4")
        np.savez(stream, joints=CAMERA.astype("f4"), visibility=visible, fps=np.float64(50))
        second = io.BytesIO()
        np.savez_compressed(second, world=bodies.listed("mediapipe", CAMERA), fps=25, who="a")
        return [{"a.npz": stream.getvalue()}, {"a.npz": second.getvalue()}]
    if kind == "npy":
        np.save(stream, bodies.listed("h36m17", CAMERA).astype("f4"))
        return [{"a.npy": stream.getvalue()}]
    points = bodies.points(CAMERA)
    if kind == "csv":
        head = ["time", *[f"{name}_{axis}" for name in NAMES for axis in "xyz"]]
        rows = [f"{i / 50:.2f}," + ",".join(f"{v:.5f}" for v in row.ravel())
                for i, row in enumerate(points)]  # fmt: skip
        return [{"a.csv": ("\n".join([",".join(head), *rows]) + "\n").encode()}]
    if kind == "json":
        rounded = np.round(CAMERA, 4)
        frames = {"fps": 25, "frames": [{"joints": row} for row in rounded.tolist()]}
        named = {"fps": 50.0} | {
            name: np.round(points[:, i], 4).tolist() for i, name in enumerate(NAMES)
        }
        return [{"a.json": json.dumps(frames).encode()},
                {"a.json": json.dumps(named, indent=1).encode()}]  # fmt: skip
    if kind == "trc":
        up = points @ bodies.INTO["camera"] @ bodies.INTO["y-up"].T
        return [{"a.trc": estimators.trc(list(CENTRES), up).encode()}]
    if kind == "torch":
        return [{"a.pt": estimators.gvhmr(POSE)}]
    if kind == "joblib":
        return [{"a.pkl": estimators.wham(POSE, protocol)} for protocol in (2, 4)]
    if kind == "people":
        joints = np.round(bodies.listed("h36m17", bodies.body(6)), 4)
        sensor = estimators.kinect(bodies.listed("smpl", CAMERA))
        return [{"a.json": json.dumps(estimators.mmpose(joints)).encode()},
                {"a.json": json.dumps(sensor).encode()}]  # fmt: skip
    if kind == "glb":
        from test_gltf import packed, scene

        return [{"a.glb": packed(*scene())}]
    return [
        {PICKLE: _frame(2, protocol), PICKLE.replace("2", "3"): _frame(3, protocol)}
        for protocol in (2, 4, 5)
    ]


def _door(kind: str) -> Door:
    return {
        "npz": lambda: Door(_made(kind), ("a.npz",), _read("a.npz"), _archive_owes),
        "npy": lambda: Door(_made(kind), ("a.npy",), _read("a.npy"), _array_owes),
        "csv": lambda: Door(_made(kind), ("a.csv",), _read("a.csv"), _table_owes),
        "json": lambda: Door(_made(kind), ("a.json",), _read("a.json"), _json_owes),
        "trc": lambda: Door(_made(kind), ("a.trc",), _read("a.trc"), _centres_owe),
        "torch": lambda: Door(_made(kind), ("a.pt",), _read("a.pt"), _rotations_owe),
        "joblib": lambda: Door(_made(kind), ("a.pkl",), _read("a.pkl"), _rotations_owe),
        "people": lambda: Door(_made(kind), ("a.json",), _read("a.json"), _people_owe),
        "glb": lambda: Door(_made(kind), ("a.glb",), _read("a.glb"), _scene_owes),
        "pickle": lambda: Door(_made(kind), (PICKLE,), _read(""), _pickle_owes),
    }[kind]()


KEYPOINTS = {
    f"keypoints {kind}": partial(_door, kind)
    for kind in ("npz", "npy", "csv", "trc", "json", "people", "pickle", "joblib", "torch", "glb")
}
