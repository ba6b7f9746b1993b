"""Doors of motion clips and of lists of clips."""

import csv
import io
import json
import math
import re
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from doorway import STRICT, Door, Files, Reading, once
from handmade import SHARED, amc, asf, bvh, deepmimic


def _clip_is_sound(clip: Any) -> None:
    from s3le.human.clip import FARTHEST, FPS_RANGE
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


def _amc_owes(it: Reading) -> None:
    files, clip = it.files, it.result
    _clip_is_sound(clip)
    data = files["1_1.amc"]
    skeleton = {
        bytes(n): len(d.split())
        for n, d in re.findall(rb"name (\w+)\s(?:.*?)(?:dof ([^\r\n]*)|end)", files["1.asf"], re.S)
    }
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
        assert "is left out" in it.told[-1]
        frames.pop()
    assert len(clip.points) == len(frames)
    turned = [float(w) for f in frames for n, v in f.items() for w in v[3 * (n == b"root") :]]
    assert (np.abs(turned) <= 1e5).all()  # [deg]
    roots = np.array([[float(w) for w in frame[b"root"][:3]] for frame in frames])
    order = re.search(rb"order +((?:[TR][XYZ] ?){6})", files["1.asf"], re.I)
    if order and order[1].split()[:3] == [b"TX", b"TY", b"TZ"]:
        unit = float(re.search(rb"length +(\S+)", files["1.asf"])[1])
        assert np.allclose(clip.points[:, 0], roots[:, [2, 0, 1]] * 0.0254 / unit)


def _asf_owes(it: Reading) -> None:
    files, clip = it.files, it.result
    _clip_is_sound(clip)
    from s3le.human.amc import read_asf

    lines = files["1.asf"].splitlines()
    data = b"\n".join(line for line in lines if not line.lstrip().startswith(b"#"))
    words = data.split()
    for section in (b":units", b":root", b":bonedata", b":hierarchy"):
        assert sum(w.lower() == section for w in words) == 1, section
    bones = [line.strip() for line in data[data.lower().index(b":bonedata") :].splitlines()]
    assert bones.count(b"begin") == bones.count(b"end") >= 2  # free text may hold these words
    path = it.folder / "1.asf"
    bones = read_asf(path).bones
    for bone in bones.values():
        assert np.isfinite(bone.offset).all() and np.linalg.norm(bone.offset) <= 1.02e6
        assert np.allclose(bone.axis @ bone.axis.T, np.eye(3))
        assert not bone.parent or bone.parent in bones


def _bvh_owes(it: Reading) -> None:
    files, clip = it.files, it.result
    _clip_is_sound(clip)
    text = files["a.bvh"].removeprefix(b"\xef\xbb\xbf")
    while text.rstrip().endswith(b"\x1a"):
        text = text.rstrip()[:-1]
    lines = text.splitlines(keepends=True)
    at = next(i for i, line in enumerate(lines) if line.strip().upper() == b"MOTION")
    head, tail = b"".join(lines[:at]), b"".join(lines[at + 1 :])
    assert head.count(b"{") == head.count(b"}")
    words = head.split()
    channels = [i + 1 for i, word in enumerate(words) if word.upper() == b"CHANNELS"]
    columns = sum(int(words[i]) for i in channels)
    found = re.match(rb"\s*Frames\s*:\s*(\d+)\s*Frame\s+Time\s*:\s*(\S+)", tail, re.I)
    values = tail[found.end() :].split()
    rows, rest = divmod(len(values), columns)
    assert rest == 0, "a row that is not whole"
    assert rows == int(found[1]) or any("whole ones; these are read" in t for t in it.told)
    left_out = 0
    if not tail[-1:].isspace():
        decimals = [len(word.partition(b".")[2]) for word in tail.splitlines()[-1].split()]
        left_out = len(set(decimals[:-1])) == 1 and decimals[-1] < decimals[0]
        left_out |= rows < int(found[1])
        assert not left_out or "is left out" in it.told[-1]
    read = len(clip.points) + left_out
    assert read == rows or (read == rows - 1 and not float(values[3]))  # at rest
    assert all(STRICT.fullmatch(w) and math.isfinite(float(w)) for w in [*values, found[2]])


def _deepmimic_owes(it: Reading) -> None:
    files, clip = it.files, it.result
    _clip_is_sound(clip)
    tree = json.loads(files["a.json"].decode(), object_pairs_hook=once)
    assert all(type(value) in (int, float) for row in tree["Frames"] for value in row)
    rows = np.array(tree["Frames"], float)
    assert rows.shape[1:] == (44,) and np.isfinite(rows).all()
    assert (np.abs(rows[:, [20, 29, 34, 43]]) <= 1e3).all()  # [rad]
    if len(rows) < 3 or np.ptp(rows[:-1, 0]) < 1e-5:
        assert len(clip.points) == len(rows)
        assert np.allclose(clip.points[:, 0], rows[:, 1:4] * (1, 1, -1) @ np.eye(3)[[0, 2, 1]])


def _frames(read: Callable) -> Callable[[Path], Any]:
    def door(folder: Path) -> Any:
        from s3le.human.read import read_clip

        return read_clip(folder / read)

    return door


ROW = [0.0, 1.0, 0.0, 5.0, 6.0, 7.0, 10.0, 20.0, 30.0, -0.125, 2.5, 1e-3]
FRAMES = ({}, {"root": "1.5 2 -3 10 20 30", "lhumerus": "1.5 -2 3e1"}, {"thorax": ".5 0 1"})


def _made(kind: str) -> list[Files]:
    """Good clips by hand."""
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
    }[kind]  # fmt: skip


def _real(kind: str) -> list[Files]:
    """The beginnings of real clips, where they are at hand."""
    from s3le.human.text import read_bytes

    if kind == "deepmimic":
        found = []
        for path in sorted(SHARED.glob("other/deepmimic/*.txt"))[:3]:
            tree = json.loads(path.read_bytes())
            tree["Frames"] = tree["Frames"][:6]
            found.append({"a.json": json.dumps(tree, indent=1).encode()})
        return found
    if kind == "bvh":
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
    from s3le.human import manifest

    rows = manifest.manifest(folder / "m.csv", CMU)
    return [(row, manifest.rate(folder / "m.csv", row["trial"], row["fps"])) for row in rows]


def _manifest_owes(it: Reading) -> None:
    files, rows = it.files, it.result
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


def _lists() -> list[Files]:
    rows = ",".join(CMU) + "\n"
    rows += f'02_05,"punch, strike",120,train,{"ab" * 32},{"0c" * 32}\n'
    rows += f'79_51,chipmunk,60,test,,{"1d" * 32}\n14_05,"a ""bear""",119.5,heldout,,\n'
    return [{"m.csv": rows.encode()}, {"m.csv": rows.replace("\n", "\r\n").encode()}]


def _door(kind: str, real: bool) -> Door:
    goods = (_real if real else _made)("amc" if kind == "asf" else kind)
    return {
        "amc": lambda: Door(goods, ("1_1.amc",), _frames("1_1.amc"), _amc_owes),
        "asf": lambda: Door(goods, ("1.asf",), _frames("1_1.amc"), _asf_owes),
        "bvh": lambda: Door(goods, ("a.bvh",), _frames("a.bvh"), _bvh_owes),
        "deepmimic": lambda: Door(goods, ("a.json",), _frames("a.json"), _deepmimic_owes),
    }[kind]()


def _points(folder: Path) -> Any:
    from s3le.human.read import read_clip

    clip = read_clip(folder / "a.parquet")
    return {"fps": clip.fps, "points": clip.points}


def _seen() -> list[Files]:
    from s3le.human import points_parquet

    goods = []
    for n, fps in ((6, 25.0), (40, 59.94)):
        points = np.random.default_rng(n).normal(0.0, 0.3, (n, 10, 3))
        points[n // 2] = np.nan
        status = np.where(np.isfinite(points[:, 0, 0]), "seen", "nobody")
        with tempfile.TemporaryDirectory() as scratch:
            path = Path(scratch) / "a.parquet"
            time = np.arange(n) / fps
            points_parquet.write(path, fps, time, points, np.ones(n), status, {"video": "a.mp4"})
            goods.append({"a.parquet": path.read_bytes()})
    return goods


CLIPS = {kind: partial(_door, kind, False) for kind in ("amc", "asf", "bvh", "deepmimic")}
CLIPS["manifest"] = lambda: Door(_lists(), ("m.csv",), _manifest, _manifest_owes)
CLIPS["points"] = lambda: Door(_seen(), ("a.parquet",), _points, exact=True)
REAL = {f"real {kind}": partial(_door, kind, True) for kind in ("amc", "asf", "bvh", "deepmimic")}
