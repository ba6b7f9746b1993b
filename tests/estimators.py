"""Files as estimators write them, made without their libraries; shared by tests and doors."""

import contextlib
import io
import pickle
import sys
import types
import zipfile
from collections import OrderedDict
from unittest import mock

import numpy as np


def _module(name: str, **members: type) -> types.ModuleType:
    module = types.ModuleType(name)
    for own, member in members.items():
        member.__module__, member.__qualname__, member.__name__ = name, own, own
        setattr(module, own, member)
    return module


class _Wrapper:
    """What joblib writes in the place of an array."""


class _Storage:
    """What torch names a tensor's numbers by."""


class _Numbers:
    """The storage of a tensor."""

    def __init__(self, key: str, count: int) -> None:
        self.key, self.count = key, count


def _rebuild(*given):
    raise AssertionError("called")


class Tensor:
    """A float32 tensor as torch pickles it; a stride of zero repeats an axis."""

    def __init__(self, values: np.ndarray, repeat: int | None = None) -> None:
        self.values, self.repeat = np.ascontiguousarray(values, "<f4"), repeat
        self.key = ""

    def __reduce__(self):
        size = self.values.shape
        stride = tuple(step // 4 for step in self.values.strides)
        if self.repeat:
            size, stride = (self.repeat, *size), (0, *stride)
        numbers = _Numbers(self.key, self.values.size)
        return _rebuild, (numbers, 0, size, stride, False, OrderedDict())


@contextlib.contextmanager
def _libraries():
    own = {
        "joblib": types.ModuleType("joblib"),
        "joblib.numpy_pickle": _module("joblib.numpy_pickle", NumpyArrayWrapper=_Wrapper),
        "torch": _module("torch", FloatStorage=_Storage),
        "torch._utils": _module("torch._utils", _rebuild_tensor_v2=_rebuild),
    }
    with mock.patch.dict(sys.modules, own):
        yield


class _Joblib(pickle._Pickler):
    """Writes the numbers of an array behind the wrapper that stands for it."""

    def __init__(self, stream: io.BytesIO, protocol: int) -> None:
        super().__init__(stream, protocol)
        self.stream = stream

    def save(self, obj, save_persistent_id=True):
        if not isinstance(obj, np.ndarray):
            return super().save(obj, save_persistent_id)
        wrapper = _Wrapper()
        fortran = obj.flags.f_contiguous and not obj.flags.c_contiguous
        wrapper.__dict__ = {
            "subclass": np.ndarray, "shape": obj.shape, "order": "F" if fortran else "C",
            "dtype": obj.dtype, "allow_mmap": True, "numpy_array_alignment_bytes": 16,
        }  # fmt: skip
        super().save(wrapper)
        if self.proto >= 4:
            self.framer.commit_frame(force=True)
        padding = 16 - (self.stream.tell() + 1) % 16
        self.stream.write(bytes([padding]) + b"\xff" * padding)
        self.stream.write(obj.tobytes("F" if fortran else "C"))
        return None


def joblib(tree, protocol: int = 4) -> bytes:
    """A tree as joblib.dump writes it, without compression."""
    stream = io.BytesIO()
    with _libraries():
        _Joblib(stream, protocol).dump(tree)
    return stream.getvalue()


def torch(tree, name: str = "archive") -> bytes:
    """A tree with tensors as torch.save writes it."""
    stream, held = io.BytesIO(), {}

    class Pickler(pickle._Pickler):
        def save(self, obj, save_persistent_id=True):
            if isinstance(obj, Tensor):
                obj.key = str(len(held))
                held[obj.key] = obj.values.tobytes()
            return super().save(obj, save_persistent_id)

        def persistent_id(self, obj):
            if isinstance(obj, _Numbers):
                return ("storage", _Storage, obj.key, "cpu", obj.count)
            return None

    pickled = io.BytesIO()
    with _libraries():
        Pickler(pickled, 2).dump(tree)
    with zipfile.ZipFile(stream, "w") as archive:
        parts = {"data.pkl": pickled.getvalue(), "byteorder": b"little", "version": b"3\n"}
        for part, data in (parts | {f"data/{key}": data for key, data in held.items()}).items():
            archive.writestr(zipfile.ZipInfo(f"{name}/{part}"), data)
    return stream.getvalue()


def gvhmr(pose: np.ndarray) -> bytes:
    """A result of GVHMR for SMPL's rotations (n, at least 66)."""
    world = {
        "body_pose": Tensor(pose[:, 3:66]), "betas": Tensor(np.zeros(10), len(pose)),
        "global_orient": Tensor(pose[:, :3]), "transl": Tensor(np.ones((len(pose), 3))),
    }  # fmt: skip
    camera = world | {"global_orient": Tensor(-pose[:, :3])}
    return torch({"smpl_params_incam": camera, "smpl_params_global": world, "K_fullimg": 1.5})


def wham(pose: np.ndarray, protocol: int = 4, ids: tuple = (3,)) -> bytes:
    """A result of WHAM for SMPL's rotations (n, 72)."""
    one = {
        "pose": np.zeros_like(pose), "trans": np.zeros((len(pose), 3)), "pose_world": pose,
        "trans_world": np.zeros((len(pose), 3)), "betas": np.zeros((len(pose), 10)),
        "verts": np.zeros((len(pose), 9, 3), "f4"), "frame_ids": np.arange(len(pose)),
    }  # fmt: skip
    return joblib({np.int64(i): one for i in ids}, protocol)


def phalp(matrices: np.ndarray, absent: tuple[int, ...] = (), second: bool = False) -> dict:
    """4D-Humans' and PHALP's frames for rotations (n, 24, 3, 3), before they are dumped."""
    frames = {}
    for number, own in enumerate(matrices.astype("f4")):
        one = {"global_orient": own[:1], "body_pose": own[1:], "betas": np.zeros(10, "f4")}
        there = [] if number in absent else [one] + [one] * second
        frames[f"outputs/_DEMO/a/img/{number:06d}.jpg"] = {
            "time": number, "shot": 0, "frame_path": "a", "tid": [7, 9][: len(there)],
            "tracked_ids": [7], "smpl": there, "3d_joints": [np.zeros((45, 3), "f4")] * len(there),
            "mask": [{"size": [3, 4], "counts": b"abc"}] * len(there),
        }  # fmt: skip
    return frames


def mmpose(joints: np.ndarray, scores: float = 0.9) -> dict:
    """mmpose's human3d inferencer for joints (n, j, 3)."""
    return {
        "meta_info": {"dataset_name": "h36m", "keypoint_id2name": {}},
        "instance_info": [
            {"frame_id": i, "instances": [
                {"keypoints": own.tolist(), "keypoint_scores": [scores] * len(own)}]}
            for i, own in enumerate(joints)
        ],
    }  # fmt: skip


KINECT = (
    "PELVIS", "SPINE_NAVEL", "SPINE_CHEST", "NECK", "CLAVICLE_LEFT", "SHOULDER_LEFT",
    "ELBOW_LEFT", "WRIST_LEFT", "HAND_LEFT", "CLAVICLE_RIGHT", "SHOULDER_RIGHT", "ELBOW_RIGHT",
    "WRIST_RIGHT", "HAND_RIGHT", "HIP_LEFT", "KNEE_LEFT", "ANKLE_LEFT", "FOOT_LEFT", "HIP_RIGHT",
    "KNEE_RIGHT", "ANKLE_RIGHT", "FOOT_RIGHT", "HEAD", "NOSE",
)  # fmt: skip
# SMPL's joint for each; the sensor's hands lie beyond its wrists.
_KINECT = (0, 3, 6, 12, 13, 16, 18, 20, 22, 14, 17, 19, 21, 23, 1, 4, 7, 10, 2, 5, 8, 11, 15, 15)


def kinect(joints: np.ndarray, bodies: tuple[int, ...] = (1,), begin: int = 4_000_000) -> dict:
    """The Azure Kinect's offline_processor for SMPL's joints in camera axes [m], (n, 24, 3)."""
    places = np.round(joints[:, list(_KINECT)] * 1000.0, 3)
    return {
        "joint_names": list(KINECT), "bone_list": [["NECK", "HEAD"]],
        "frames": [
            {"frame_id": i, "timestamp_usec": begin + round(i * 1e6 / 30), "num_bodies": 1,
             "bodies": [{"body_id": body, "joint_positions": own.tolist(),
                         "joint_orientations": [[1.0, 0.0, 0.0, 0.0]] * len(own)}
                        for body in bodies]}
            for i, own in enumerate(places)
        ],
    }  # fmt: skip


def trc(names: list[str], joints: np.ndarray, rate: float = 60.0, announced: int | None = None):
    """A TRC table of joints (n, j, 3)."""
    count = len(joints) if announced is None else announced
    keys = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame".split()
    values = [f"{rate:g}", f"{rate:g}", count, len(names), "m", f"{rate:g}", 0]
    head = ["Frame#", "Time", *[part for name in names for part in (name, "", "")]]
    axes = ["", "", *[f"{axis}{i + 1}" for i in range(len(names)) for axis in "XYZ"]]
    rows = [
        [str(i), f"{i / rate:.5f}", *[f"{v:.6f}" if np.isfinite(v) else "" for v in own.ravel()]]
        for i, own in enumerate(joints)
    ]
    lines = [["PathFileType", "4", "(X/Y/Z)", "a.trc"], keys, map(str, values), head, axes, [""]]
    return "\n".join("\t".join(line) for line in [*lines, *rows]) + "\n"
