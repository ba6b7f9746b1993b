"""Doors of robots, parameters, and of what the pipeline itself has written."""

import difflib
import hashlib
import json
import math
import re
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
from doorway import Door, Files, Reading, once

TAG = "arm 0123 margin=0.002 neck=midpoint"


def _robot(folder: Path) -> Any:
    from s3le.robot.robot import Robot

    return Robot.from_file(folder / "arms.yaml", 0.002, "midpoint")


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


def _robot_owes(it: Reading) -> None:
    files, made = it.files, it.result
    robot = made
    assert len(made.watched) and made.margin == 0.002
    assert re.fullmatch(r"[\w.+-]{1,100}", robot.name)
    numbers = [made.anchor, made.base_rotation]
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


def _robots() -> list[Files]:
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
    from s3le.robot.robot import Robot

    return Robot.read(folder)


def _settings_owe(it: Reading) -> None:
    files, made = it.files, it.result
    tree = json.loads(files["settings.json"], object_pairs_hook=once)
    assert type(tree["margin"]) in (int, float) and 0 <= tree["margin"] == made.margin < 1
    assert made.neck == tree["neck"]


def _carried() -> list[Files]:
    good = _robots()[0]
    settings = b'{\n  "margin": 0.002,\n  "neck": "midpoint"\n}\n'
    return [{"robot.yaml": good["arms.yaml"], "arms.urdf": good["arms.urdf"],
             "settings.json": settings}]  # fmt: skip


# --- tables


def _contract() -> Any:
    from s3le.learn.table import index

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
    from s3le.store import tables

    rows = tables.read(_contract(), folder / "t.parquet", TAG)
    return rows | {"note": tables.read_note(folder / "t.parquet", "metric", "index")}


def _tables() -> list[Files]:
    from s3le.store import tables

    with tempfile.TemporaryDirectory() as scratch:
        goods = []
        for n in (5, 40):
            path = Path(scratch) / "t.parquet"
            tables.write(_columns(0, n), _contract(), path, TAG, {"metric": "l2"})
            goods.append({"t.parquet": path.read_bytes()})
        return goods


def _shards(folder: Path) -> Any:
    from s3le.store import tables

    return tables.read(_contract(), folder, TAG)


def _folders() -> list[Files]:
    from s3le.store import tables

    files = {f"{k}.parquet": tables.encode(_columns(4 * k, 4), _contract(), TAG) for k in (0, 1)}
    listed = [
        {"file": name, "rows": 4, "sha256": hashlib.sha256(data).hexdigest()}
        for name, data in files.items()
    ]
    manifest = {"table": "index", "robot": TAG, "rows": 8, "shards": listed}
    return [files | {"manifest.json": json.dumps(manifest, indent=1).encode()}]


# --- models and parameters


def _model(folder: Path) -> Any:
    from s3le.learn import artifact

    model, config = artifact.load_model(folder / "m.safetensors", method="s3le", robot_hash="abc")
    return {k: v.numpy() for k, v in model.state_dict().items()} | {"config": config}


def _models() -> list[Files]:
    import torch

    from s3le.learn import artifact
    from s3le.learn.models import Sizes, build

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


def _params_owe(it: Reading) -> None:
    found = it.result
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


def _parameters() -> list[Files]:
    whole = (Path(__file__).parents[1] / "params.yaml").read_bytes()
    short = b"seed: 7\nneck: joint\nmargin: 2e-3\nrobot: coman\nprojection: nearest\n"
    short += b"skeletons:\n  rate: 30\n"
    short += b"  tilt_max: 60.0\n  domain_rows: 100\n  noise: .03\n"
    short += b"pair:\n  rows: 8\n  ridge: 1e-3\n"
    return [{"params.yaml": short}, {"params.yaml": short}, {"params.yaml": whole}]


PRODUCT = {
    "robot file": lambda: Door(_robots(), ("arms.yaml",), _robot, _robot_owes),
    "urdf": lambda: Door(_robots(), ("arms.urdf",), _robot, _robot_owes),
    "settings": lambda: Door(_carried(), ("settings.json",), _settings, _settings_owe),
    "table": lambda: Door(_tables(), ("t.parquet",), _table, exact=True),
    "shards": lambda: Door(_folders(), ("manifest.json", "1.parquet"), _shards, exact=True),
    "model": lambda: Door(_models(), ("m.safetensors",), _model, exact=True),
    "parameters": lambda: Door(_parameters(), ("params.yaml",), _params, _params_owe),
}
