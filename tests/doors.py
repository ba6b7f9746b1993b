"""Every reader of files from outside, with what it owes; a program that sends mutants through one.

A door says which good files there are, how they are read, and what must hold of a file that was
read although it is broken: its own grammar, looked up again in the bytes by simpler means than
the reader's, and numbers within the ranges that the reader promises. What is written with
checksums (tables, shards, models) must read as a good file to the last bit, or not at all.

As a program (doors.py DOOR FIRST COUNT FOLDER) it runs in a process of its own, so that a reader
may crash, hang or eat memory without taking the tests along.
"""

import csv
import difflib
import io
import json
import logging
import math
import os
import re
import resource
import signal
import struct
import sys
import traceback
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from handmade import SHARED, amc, asf, bvh, deepmimic
from mutants import mutant

from s3le.errors import S3leError

SECONDS = 2.0  # of processor time, for one file
MEMORY = 512 * 2**20  # [bytes] of address space beyond what reading the good file takes
LONGEST = 5000  # characters of a refusal
STRICT = re.compile(rb"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
TAG = "arm 0123 margin=0.002 neck=midpoint"


class Door(NamedTuple):
    """One reader.

    Attributes:
        goods: sets of good files, by name.
        broken: which of the names are mutated, one at a time.
        read: reads the folder; refuses with S3leError.
        owed: asserts that what was read is what (folder, files as written, result) must give.
        exact: whether damage never goes unseen, so that what is read equals the good file's.
    """

    goods: list[dict[str, bytes]]
    broken: tuple[str, ...]
    read: Callable[[Path], Any]
    owed: Callable[[dict[str, bytes], Any], None]
    exact: bool = False


# --- motion


def _clip_is_sound(clip: Any) -> None:
    from s3le.mocap.clip import FARTHEST, FPS_RANGE
    from s3le.skeleton import POINTS

    assert clip.points.shape[1:] == (len(POINTS), 3) and len(clip.points)
    assert (np.abs(clip.points) <= FARTHEST).all()
    assert FPS_RANGE[0] <= clip.fps <= FPS_RANGE[1]
    at = {name: clip.points[:, i] for i, name in enumerate(POINTS)}
    arms = [
        np.linalg.norm(at[f"{s}_elbow"] - at[f"{s}_shoulder"], axis=1)
        + np.linalg.norm(at[f"{s}_hand"] - at[f"{s}_elbow"], axis=1)
        for s in "rl"
    ]
    assert 0.0499 < np.median(arms) < 5.001, "an arm of no human length [m]"


def _amc_owes(files: dict[str, bytes], clip: Any) -> None:
    _clip_is_sound(clip)
    data = files["1_1.amc"]
    skeleton = {bytes(n): len(d.split()) for n, d in re.findall(
        rb"name (\w+)\s(?:.*?)(?:dof ([^\r\n]*)|end)", files["1.asf"], re.S)}
    moving = {name: count for name, count in skeleton.items() if count} | {b"root": 6}
    frames: list[dict[bytes, list[bytes]]] = []
    numbers = []
    for line in data.splitlines():
        words = line.split()
        if not words or words[0].startswith(b"#") or (words[0].startswith(b":") and not frames):
            continue
        if len(words) == 1 and words[0].isdigit():
            frames.append({})
            numbers.append(int(words[0]))
        else:
            assert words[0] in moving and words[0] not in frames[-1], line
            assert len(words) - 1 == moving[words[0]], line
            assert all(STRICT.fullmatch(w) and math.isfinite(float(w)) for w in words[1:]), line
            frames[-1][words[0]] = words[1:]
    assert numbers == list(range(numbers[0], numbers[0] + len(frames)))
    assert all(frame.keys() == moving.keys() for frame in frames)
    if not data[-1:].isspace():  # the last number may be a part of one
        assert "is left out" in _told[-1]
        frames.pop()
    assert len(clip.points) == len(frames)
    turned = [float(w) for f in frames for n, v in f.items() for w in v[3 * (n == b"root") :]]
    assert (np.abs(turned) <= 1e5).all()  # [deg]
    roots = np.array([[float(w) for w in frame[b"root"][:3]] for frame in frames])
    order = re.search(rb"order +((?:[TR][XYZ] ?){6})", files["1.asf"], re.I)
    if order and order[1].split()[:3] == [b"TX", b"TY", b"TZ"]:
        unit = float(re.search(rb"length +(\S+)", files["1.asf"])[1])
        assert np.allclose(clip.points[:, 0], roots[:, [2, 0, 1]] * 0.0254 / unit)


def _asf_owes(files: dict[str, bytes], clip: Any) -> None:
    _clip_is_sound(clip)
    from s3le.mocap.amc import read_asf

    lines = files["1.asf"].splitlines()
    data = b"\n".join(line for line in lines if not line.lstrip().startswith(b"#"))
    words = data.split()
    for section in (b":units", b":root", b":bonedata", b":hierarchy"):
        assert sum(w.lower() == section for w in words) == 1, section
    bones = [line.strip() for line in data[data.lower().index(b":bonedata") :].splitlines()]
    assert bones.count(b"begin") == bones.count(b"end") >= 2  # free text may hold these words
    path = _folder / "1.asf"
    bones = read_asf(path).bones
    for bone in bones.values():
        assert np.isfinite(bone.offset).all() and np.linalg.norm(bone.offset) <= 1.02e6
        assert np.allclose(bone.axis @ bone.axis.T, np.eye(3))
        assert not bone.parent or bone.parent in bones


def _bvh_owes(files: dict[str, bytes], clip: Any) -> None:
    _clip_is_sound(clip)
    head, _, tail = files["a.bvh"].partition(b"MOTION")
    assert head.count(b"{") == head.count(b"}")
    words = head.split()
    columns = sum(int(words[i + 1]) for i, word in enumerate(words) if word == b"CHANNELS")
    found = re.match(rb"\s*Frames\s*:\s*(\d+)\s*Frame\s+Time\s*:\s*(\S+)", tail)
    values = tail[found.end() :].split()
    assert len(values) == int(found[1]) * columns
    left_out = 0
    if not tail[-1:].isspace():
        decimals = [len(word.partition(b".")[2]) for word in tail.splitlines()[-1].split()]
        left_out = len(set(decimals[:-1])) == 1 and decimals[-1] < decimals[0]
        assert not left_out or "is left out" in _told[-1]
    read = len(clip.points) + left_out
    assert read == int(found[1]) or (read == int(found[1]) - 1 and not float(values[3]))  # at rest
    assert all(STRICT.fullmatch(w) and math.isfinite(float(w)) for w in [*values, found[2]])


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    assert len(dict(pairs)) == len(pairs), "a key is there twice"
    return dict(pairs)


def _deepmimic_owes(files: dict[str, bytes], clip: Any) -> None:
    _clip_is_sound(clip)
    tree = json.loads(files["a.json"].decode(), object_pairs_hook=_once)
    assert all(type(value) in (int, float) for row in tree["Frames"] for value in row)
    rows = np.array(tree["Frames"], float)
    assert rows.shape[1:] == (44,) and np.isfinite(rows).all()
    assert (np.abs(rows[:, [20, 29, 34, 43]]) <= 1e3).all()  # [rad]
    if len(rows) < 3 or np.ptp(rows[:-1, 0]) < 1e-5:
        assert len(clip.points) == len(rows)
        assert np.allclose(clip.points[:, 0], rows[:, 1:4] * (1, 1, -1) @ np.eye(3)[[0, 2, 1]])


def _frames(read: Callable) -> Callable[[Path], Any]:
    def door(folder: Path) -> Any:
        from s3le.mocap.read import read_clip

        return read_clip(folder / read)

    return door


ROW = [0.0, 1.0, 0.0, 5.0, 6.0, 7.0, 10.0, 20.0, 30.0, -0.125, 2.5, 1e-3]
FRAMES = ({}, {"root": "1.5 2 -3 10 20 30", "lhumerus": "1.5 -2 3e1"}, {"thorax": ".5 0 1"})


def _motions() -> dict[str, list[dict[str, bytes]]]:
    """Good clips by door."""
    second = asf().replace("axis 0 0 0 XYZ", "axis 10 -20 30 XYZ").encode()
    fixed = re.sub(r"(?<=Frame Time: .0083333\n)(.*)", lambda found: "\n".join(
        " ".join(f"{float(word):.6f}" for word in line.split()) for line in found[1].split("\n")),
        bvh([ROW, [v + 0.5 for v in ROW]]), flags=re.S)  # fmt: skip
    rest = bvh([[0.0] * 12, ROW, ROW]).replace(
        "JOINT LeftUpLeg\n{", "JOINT LHipJoint\n{\nOFFSET 0 0 0\nJOINT LeftUpLeg\n{").replace(
        "JOINT RightUpLeg", "}\nJOINT RightUpLeg", 1)  # fmt: skip
    turn = {4: [0.9, 0.1, 0.3, 0.3], 29: [1.5]}
    return {
        "amc": [
            {"1_1.amc": amc(*FRAMES).encode(), "1.asf": asf().encode()},
            {"1_1.amc": amc(*FRAMES[::-1], first=7).replace("\n", "\r\n").encode(),
             "1.asf": second},
        ],
        "bvh": [
            {"a.bvh": text.encode()}
            for text in (bvh([ROW, ROW, ROW]), rest, fixed.rstrip("\n"),
                         bvh([ROW] * 2, "XYZ", "mixamorig:", scale=100, step="0.0333333"))
        ],
        "deepmimic": [
            {"a.json": deepmimic({}, turn, {}).encode()},
            {"a.json": deepmimic(turn, turn, {}).replace("\n", "").encode()},
        ],
    }  # fmt: skip


def _real(door: str) -> list[dict[str, bytes]]:
    """The beginnings of real clips, where they are at hand."""
    from s3le.mocap.text import read_bytes

    if door == "deepmimic":
        found = []
        for path in sorted(SHARED.glob("other/deepmimic/*.txt"))[:3]:
            tree = json.loads(path.read_bytes())
            tree["Frames"] = tree["Frames"][:6]
            found.append({"a.json": json.dumps(tree, indent=1).encode()})
        return found
    if door == "bvh":
        found = []
        for path in sorted(SHARED.glob("**/*.bvh*")):
            head, _, tail = read_bytes(path).partition(b"MOTION")
            lines = tail.splitlines()
            data = b"MOTION\nFrames: 4\n" + b"\n".join(lines[2:7]) + b"\n"
            found.append({"a.bvh": head + data})
        return found
    found = []
    for path in sorted(SHARED.glob("cmu/*/*.amc*")):
        end = re.search(rb"^6\r?$", data := read_bytes(path), re.M)
        skeleton = next(path.parent.glob("*.asf*"))
        found.append({"1_1.amc": data[: end.start()], "1.asf": read_bytes(skeleton)})
    return found[::5]


# --- lists of clips

CMU = ("trial", "description", "fps", "split", "sha256", "asf_sha256")


def _manifest(folder: Path) -> Any:
    from s3le.mocap import manifest

    rows = manifest.manifest(folder / "m.csv", CMU)
    return [(row, manifest.rate(folder / "m.csv", row["trial"], row["fps"])) for row in rows]


def _manifest_owes(files: dict[str, bytes], rows: Any) -> None:
    text = files["m.csv"].decode()
    lines = [line for line in csv.reader(io.StringIO(text, newline="")) if line]
    assert lines[0] == list(CMU) and len(lines) - 1 == len(rows)
    for (row, fps), line in zip(rows, lines[1:], strict=True):
        assert list(row.values()) == line
        assert re.fullmatch(r"[A-Za-z0-9_]{1,100}", row["trial"])
        assert re.fullmatch(r"[0-9.]+(e[+-]?\d+)?", row["fps"], re.A | re.I)
        assert 0.1 <= fps == float(row["fps"]) <= 10_000
        assert all(value.isprintable() for value in row.values())
        assert all(re.fullmatch("([0-9a-f]{64})?", row[key]) for key in CMU[4:])
        assert row["split"] in ("train", "test", "heldout")
    assert len({row["trial"] for row, _ in rows}) == len(rows)


def _lists() -> list[dict[str, bytes]]:
    rows = ",".join(CMU) + "\n"
    rows += f'02_05,"punch, strike",120,train,{"ab" * 32},{"0c" * 32}\n'
    rows += f'79_51,chipmunk,60,test,,{"1d" * 32}\n14_05,"a ""bear""",119.5,heldout,,\n'
    return [{"m.csv": rows.encode()}, {"m.csv": rows.replace("\n", "\r\n").encode()}]


# --- robots


def _robot(folder: Path) -> Any:
    from s3le import machine

    return machine.make(folder / "arms.yaml", 0.002, "midpoint")


KNOWN = {  # what a URDF may hold where geometry hangs on it
    "robot": {"link", "joint"},
    "link": {"collision"},
    "joint": {"parent", "child", "origin", "axis", "limit"},
    "collision": {"origin", "geometry"},
    "geometry": {"capsule", "sphere", "box", "cylinder"},
}
ATTRIBUTES = {
    "origin": {"xyz", "rpy"}, "axis": {"xyz"}, "limit": {"lower", "upper", "velocity", "effort"},
}  # fmt: skip


def _robot_owes(files: dict[str, bytes], made: Any) -> None:
    robot = made.robot
    assert len(made.watched) and made.margin == 0.002
    assert re.fullmatch(r"[\w.+-]{1,100}", robot.name)
    numbers = [made.robot.anchor, made.robot.base_rotation]
    for joint in robot.joints:
        numbers += [joint.rotation, joint.translation, [joint.lower, joint.upper]]
        assert -100 <= joint.lower < joint.upper <= 100 and 0 <= joint.velocity < math.inf
        assert np.allclose(joint.rotation @ joint.rotation.T, np.eye(3), atol=1e-9)
        assert abs(np.linalg.norm(joint.axis) - 1) < 1e-9
    for body in robot.bodies:
        numbers += [body.a, body.b, body.radius]
        assert body.radius > 0
    numbers += [point.offset for point in robot.points.values()]
    assert all((np.abs(part) <= 100).all() for part in numbers), "beyond any robot, or nowhere"
    clearance = made.certifier().check(robot.anchor[None]).clearance
    assert clearance[0] >= made.margin
    root = ElementTree.fromstring(files["arms.urdf"])
    links = root.findall("link")
    assert len(robot.bodies) == sum(len(link.findall("collision")) for link in links)
    assert b"<!DOCTYPE" not in files["arms.urdf"]
    for item in [root, *links, *root.findall("joint"), *root.iterfind("link/collision"),
                 *root.iterfind("link/collision/geometry")]:  # fmt: skip
        names = [child.tag for child in item]
        for name in set(names):
            known = KNOWN[item.tag] | {"visual", "inertial", "material", "dynamics", "mimic"}
            if name not in known:
                near = difflib.get_close_matches(name, KNOWN[item.tag], 1, 0.7)
                assert not near, f"<{name}> in <{item.tag}> is lost"
            if item.tag != "robot" and name != "collision" and name in KNOWN[item.tag]:
                assert names.count(name) == 1, f"<{name}> twice in <{item.tag}>"
    for tag, known in ATTRIBUTES.items():
        for item in [*root.iterfind(f"joint/{tag}"), *root.iterfind(f"link/collision/{tag}")]:
            for name in set(item.keys()) - known:
                assert not difflib.get_close_matches(name, known, 1, 0.7), f"{name} is lost"


def _robots() -> list[dict[str, bytes]]:
    from worlds import ARMS_URDF, ARMS_YAML, ROBOTS

    shapes = ARMS_URDF.replace(
        '<capsule radius="0.04" length="0.2"/>', '<cylinder radius="0.04" length="0.2"/>'
    ).replace('<capsule radius="0.03" length="0.15"/>', '<box size="0.03 0.04 0.1"/>', 1)
    ours = {name: (ROBOTS / name).read_bytes() for name in ("coman.yaml", "urdf/coman.urdf")}
    return [
        {"arms.yaml": ARMS_YAML.encode(), "arms.urdf": ARMS_URDF.encode()},
        {"arms.yaml": ARMS_YAML.replace("hold: {}", "hold: {}  # none").encode(),
         "arms.urdf": shapes.encode()},
        {"arms.yaml": ours["coman.yaml"].replace(b"urdf/coman.urdf", b"arms.urdf"),
         "arms.urdf": ours["urdf/coman.urdf"]},
    ]  # fmt: skip


def _settings(folder: Path) -> Any:
    from s3le import machine

    return machine.read(folder)


def _settings_owe(files: dict[str, bytes], made: Any) -> None:
    tree = json.loads(files["settings.json"], object_pairs_hook=_once)
    assert type(tree["margin"]) in (int, float) and 0 <= tree["margin"] == made.margin < 1
    assert made.neck == tree["neck"]


def _carried() -> list[dict[str, bytes]]:
    good = _robots()[0]
    settings = b'{\n  "margin": 0.002,\n  "neck": "midpoint"\n}\n'
    return [{"robot.yaml": good["arms.yaml"], "arms.urdf": good["arms.urdf"],
             "settings.json": settings}]  # fmt: skip


# --- tables


def _contract() -> Any:
    from s3le.tables.index import index

    return index(n_dof=3, margin=0.002, latent=2)


def _columns(first: int, n: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(first)
    x = rng.normal(size=(n, 7, 3))
    return {
        "row": np.arange(first, first + n, dtype=np.int32),
        "source": np.array(["robot_poses", "kinematic_pairs"])[rng.integers(0, 2, n)],
        "source_row": rng.integers(0, 99, n).astype(np.int32),
        "z": rng.normal(size=(n, 2)).astype(np.float32),
        "q": rng.normal(size=(n, 3)),
        "x": (x / np.linalg.norm(x, axis=2, keepdims=True)).reshape(n, 21),
        "clearance": rng.uniform(0.002, 0.1, n),
        "limit_margin": rng.uniform(0.0, 1.0, n),
    }


def _table(folder: Path) -> Any:
    from s3le import store

    rows = store.read(_contract(), folder / "t.parquet", TAG)
    return rows | {"note": store.read_note(folder / "t.parquet", "metric", "index")}


def _tables() -> list[dict[str, bytes]]:
    import tempfile

    from s3le import store

    with tempfile.TemporaryDirectory() as scratch:
        goods = []
        for n in (5, 40):
            path = Path(scratch) / "t.parquet"
            store.write(_columns(0, n), _contract(), path, TAG, {"metric": "l2"})
            goods.append({"t.parquet": path.read_bytes()})
        return goods


def _shards(folder: Path) -> Any:
    from s3le import store

    return store.read(_contract(), folder, TAG)


def _folders() -> list[dict[str, bytes]]:
    import hashlib

    from s3le import store

    files = {f"{k}.parquet": store.encode(_columns(4 * k, 4), _contract(), TAG) for k in (0, 1)}
    listed = [
        {"file": name, "rows": 4, "sha256": hashlib.sha256(data).hexdigest()}
        for name, data in files.items()
    ]
    manifest = {"table": "index", "robot": TAG, "rows": 8, "shards": listed}
    return [files | {"manifest.json": json.dumps(manifest, indent=1).encode()}]


# --- models and parameters


def _model(folder: Path) -> Any:
    from s3le import artifact

    model, config = artifact.load_model(folder / "m.safetensors", method="s3le", robot_hash="abc")
    return {k: v.numpy() for k, v in model.state_dict().items()} | {"config": config}


def _models() -> list[dict[str, bytes]]:
    import tempfile

    import torch

    from s3le import artifact
    from s3le.models import Sizes, build

    torch.set_num_threads(1)
    goods = []
    with tempfile.TemporaryDirectory() as scratch:
        for layers in (1, 2):
            ones = torch.ones(3)
            sizes = Sizes(dim_q=3, latent=2, hidden=3, layers=layers)
            path = Path(scratch) / "m"
            config = {"method": "s3le", "robot_hash": "abc", "training": {"tau": 1.0}}
            artifact.save_model(path, build("s3le", sizes, -ones, ones), config)
            goods.append({"m.safetensors": path.read_bytes()})
    return goods


def _params(folder: Path) -> Any:
    from pipeline import pair, robot, skeletons, stage

    return [stage.read(m.Params, folder / "params.yaml") for m in (skeletons, pair, robot)]


def _params_owe(files: dict[str, bytes], found: Any) -> None:
    from dataclasses import fields

    for params in found:
        for f in fields(params):
            value, (low, high) = getattr(params, f.name), f.metadata["range"]
            assert type(value) is f.type, f.name
            if f.type in (int, float):
                assert math.isfinite(value) and low <= value <= high and abs(value) < 2**63
            if f.metadata["one_of"]:
                assert value in f.metadata["one_of"]
            if f.type is str:
                assert value.isprintable() and len(value) < 1000


def _parameters() -> list[dict[str, bytes]]:
    whole = (Path(__file__).parents[1] / "params.yaml").read_bytes()
    short = b"seed: 7\nneck: joint\nmargin: 2e-3\nrobot: coman\nskeletons:\n  rate: 30\n"
    short += b"  tilt_max: 60.0\n  domain_rows: 100\n  noise: .03\n"
    short += b"pair:\n  rows: 8\n  ridge: 1e-3\n"
    return [{"params.yaml": short}, {"params.yaml": short}, {"params.yaml": whole}]


def _nothing(files: dict[str, bytes], result: Any) -> None:
    """Nothing beyond being exact."""


def door(name: str) -> Door:
    """A reader by name; imports no more than it needs."""
    kind, real = name.removeprefix("real "), name.startswith("real ")
    if kind in ("amc", "asf"):
        goods = _real("amc") if real else _motions()["amc"]
        owed = _amc_owes if kind == "amc" else _asf_owes
        return Door(goods, ("1_1.amc" if kind == "amc" else "1.asf",), _frames("1_1.amc"), owed)
    if kind == "bvh":
        return Door(_real(kind) if real else _motions()[kind], ("a.bvh",), _frames("a.bvh"),
                    _bvh_owes)  # fmt: skip
    if kind == "deepmimic":
        goods = _real(kind) if real else _motions()[kind]
        return Door(goods, ("a.json",), _frames("a.json"), _deepmimic_owes)
    return {
        "manifest": lambda: Door(_lists(), ("m.csv",), _manifest, _manifest_owes),
        "robot file": lambda: Door(_robots(), ("arms.yaml",), _robot, _robot_owes),
        "urdf": lambda: Door(_robots(), ("arms.urdf",), _robot, _robot_owes),
        "settings": lambda: Door(_carried(), ("settings.json",), _settings, _settings_owe),
        "table": lambda: Door(_tables(), ("t.parquet",), _table, _nothing, exact=True),
        "shards": lambda: Door(
            _folders(), ("manifest.json", "1.parquet"), _shards, _nothing, exact=True
        ),
        "model": lambda: Door(_models(), ("m.safetensors",), _model, _nothing, exact=True),
        "parameters": lambda: Door(_parameters(), ("params.yaml",), _params, _params_owe),
    }[name]()


DOORS = ("amc", "asf", "bvh", "deepmimic", "manifest", "robot file", "urdf", "settings", "table",
         "shards", "model", "parameters")  # fmt: skip
REAL = ("real amc", "real asf", "real bvh", "real deepmimic")


# --- the program

_folder = Path()
_told: list[str] = []  # what was said while a file was read


class TooLongError(BaseException):
    """A file took more than its time; no reader catches this."""


def _stop(*_: object) -> None:
    raise TooLongError


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(_same(a[k], b[k]) for k in a)
    if isinstance(a, np.ndarray):
        equal = a.shape == b.shape and a.dtype == b.dtype
        return equal and (a.tolist() == b.tolist() if a.dtype == object else
                          a.tobytes() == b.tobytes())  # fmt: skip
    return a == b


def _listing(folder: Path) -> list[tuple[str, int, int]]:
    return sorted(
        (entry.name, entry.stat().st_size, entry.stat().st_mtime_ns) for entry in os.scandir(folder)
    )


def judge(at: Door, folder: Path, files: dict[str, bytes], goods: list) -> tuple[str, str]:
    """Read a folder and judge what came of it.

    Returns:
        Pair (verdict, why): "read", "refused", or what is wrong: "crash", "slow", "accepted",
        "words" (of a refusal) or "written".
    """
    before = _listing(folder)
    _told.clear()
    result, refused = None, ""
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        result = at.read(folder)
    except TooLongError:
        return "slow", f"more than {SECONDS:g} s of processor time"
    except S3leError as error:
        refused = str(error) or "(no words)"
    except BaseException as error:  # noqa: B036  a panic of a library is no Exception
        last = traceback.extract_tb(error.__traceback__)[-1]
        what = f"{type(error).__name__}: {str(error)[:200]!r}"
        return "crash", f"{what} at {Path(last.filename).name}:{last.lineno}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    if _listing(folder) != before:
        return "written", "the folder is not what it was"
    if refused:
        if len(refused.splitlines()) != 1 or not refused.isprintable():
            return "words", f"not one line: {refused!r:.300}"
        if len(refused) > LONGEST:
            return "words", f"{len(refused)} characters: {refused[:200]}"
        if not any(str(folder / name) in refused for name in [*files, ""]):
            return "words", f"names no file: {refused[:300]}"
        return "refused", refused
    if any(len(line) > LONGEST or not line.isprintable() for line in _told):
        return "words", f"said: {_told!r:.300}"
    try:
        at.owed(files, result)
        assert not at.exact or any(_same(result, one) for one in goods), "reads as no good file"
    except Exception as error:  # the check itself may stumble over what should not have been read
        return "accepted", f"{type(error).__name__}: {str(error)[:300]}"
    return "read", ""


def main(name: str, first: int, count: int, folder: Path) -> None:
    """Send mutants through a door; one JSON line for each that is not as it must be."""
    global _folder
    _folder = folder
    at = door(name)
    goods = []
    for number, files in enumerate(at.goods):
        home = folder / f"good{number}"
        home.mkdir(parents=True)
        for file, data in files.items():
            (home / file).write_bytes(data)
        _folder = home
        goods.append(at.read(home))
        at.owed(files, goods[-1])
    signal.signal(signal.SIGPROF, _stop)
    pages = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (pages + MEMORY, pages + MEMORY))
    warnings.simplefilter("error")
    ear = logging.Handler()
    ear.emit = lambda record: _told.append(record.getMessage())
    logging.getLogger("s3le").addHandler(ear)
    counts: dict[str, int] = {}
    mark = os.open(folder / "number", os.O_CREAT | os.O_WRONLY)
    for number in range(first, first + count):
        os.pwrite(mark, struct.pack("<q", number), 0)
        turn = number % len(at.goods)
        files = at.goods[turn]
        target = at.broken[number // len(at.goods) % len(at.broken)]
        others = [data for other in at.goods for data in other.values()]
        data, done = mutant(files[target], others, f"{name} {number}")
        _folder = folder / f"good{turn}"
        (_folder / target).write_bytes(data)
        verdict, why = judge(at, _folder, files | {target: data}, goods)
        if verdict == "slow":  # for its own sake, or because the machine was busy
            verdict, why = judge(at, _folder, files | {target: data}, goods)
        (_folder / target).write_bytes(files[target])
        counts[verdict] = counts.get(verdict, 0) + 1
        if verdict not in ("read", "refused"):
            print(json.dumps({"number": number, "how": done, "verdict": verdict, "why": why}))
            sys.stdout.flush()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024  # [bytes]
    print(json.dumps({"counts": counts, "most": peak}))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]))
