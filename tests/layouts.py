"""Motions in every layout that is known, made by other means than ours, and what lies in them."""

import json
import pickle
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import s3le
from s3le.motion import files, trajectory, whole
from s3le.robot import model
from s3le.robot.model import Geometry

FPS, ROWS = 50.0, 40
TIME = np.arange(ROWS) / FPS
PAYLOAD = np.array([0x7FF8000000000ABC, 0xFFF0000000000001], "<u8").view("<f8")  # NaNs of two kinds


@cache
def robot(name: str = "g1") -> Geometry:
    return model.load(Path(s3le.__file__).parent / "robots" / f"{name}.yaml")


@cache
def joints(name: str = "g1") -> tuple[str, ...]:
    """All joints with a motor as MuJoCo numbers them."""
    return whole.joints(robot(name)).depth_first


@cache
def motion(name: str = "g1") -> np.ndarray:
    """A swaying about the anchor, within the limits, (ROWS, n)."""
    its = robot(name)
    room = np.minimum(its.upper - its.anchor, its.anchor - its.lower)
    phase = np.arange(len(its.joint_names))
    return its.anchor + np.minimum(0.4, 0.5 * room) * np.sin(3.0 * TIME[:, None] + phase)


def full(name: str = "g1") -> np.ndarray:
    """The same with all joints, held ones at rest, (ROWS, all)."""
    out = np.zeros((ROWS, len(joints(name))))
    for i, joint in enumerate(robot(name).joint_names):
        out[:, joints(name).index(joint)] = motion(name)[:, i]
    return out


def root() -> tuple[np.ndarray, np.ndarray]:
    turn = np.stack([0 * TIME, 0 * TIME, np.sin(TIME), np.cos(TIME)], axis=1)
    return np.stack([TIME, TIME**2, 0.8 + 0 * TIME], axis=1), turn


Cells = dict[str, list[Any]]  # of a column or an array: a value a row, as bytes or text


class Kind(NamedTuple):
    """A layout: how to make one, and what an independent reader finds in it."""

    make: Callable[[Path], Path]
    cells: Callable[[Path], Cells]
    options: dict[str, Any] = {}
    dtype: str = "f8"
    robot: str = "g1"
    same: bool = True  # an unchanged motion gives the same bytes again
    degrees: bool = False


def _rows(array: np.ndarray) -> list[bytes]:
    rows = np.atleast_1d(array)
    return [np.ascontiguousarray(row).tobytes() for row in rows]


# --- numpy


def npz_cells(path: Path) -> Cells:
    found: Cells = {}
    with zipfile.ZipFile(path) as archive:
        found["entries"] = [(e.filename, e.compress_type) for e in archive.infolist()]
    with np.load(path) as arrays:
        for key in arrays.files:
            one = arrays[key]
            found[f"{key}, type"] = [one.dtype.str, one.shape, one.flags.f_contiguous]
            if one.ndim == 2 and key in ("dof_pos", "qpos", "q"):
                for column in range(one.shape[1]):
                    found[f"{key} {column}"] = _rows(one[:, column])
            else:
                found[key] = _rows(one)
    return found


def npz_all(folder: Path) -> Path:
    place, turn = root()
    noise = np.random.default_rng(0).normal(size=(ROWS, 3))
    noise[:2, 0] = PAYLOAD
    np.savez_compressed(
        folder / "a.npz", fps=np.array([FPS], "f4"), dof_pos=full().astype(">f4"),
        joint_names=np.array(joints()), root_pos=place, root_rot=turn, joint_vel=noise,
        clip="walk", qpos_of=np.asfortranarray(noise),
    )  # fmt: skip
    return folder / "a.npz"


def npz_behind_a_base(folder: Path) -> Path:
    q = np.asfortranarray(np.hstack([*root(), full()]))
    np.savez(folder / "b.npz", time=TIME, qpos=q, joint_names=np.array(joints()))
    return folder / "b.npz"


def npz_each(folder: Path) -> Path:
    columns = {f"{n}_pos": motion("coman")[:, i] for i, n in enumerate(robot("coman").joint_names)}
    order = sorted(columns)
    arrays = {key: columns[key].astype("f4") for key in order}
    np.savez(folder / "c.npz", t=TIME, reward=np.full((ROWS, 2), PAYLOAD), **arrays)
    return folder / "c.npz"


def npy(folder: Path) -> Path:
    np.save(folder / "d.npy", np.hstack([*root(), full()]))
    return folder / "d.npy"


def npy_cells(path: Path) -> Cells:
    one = np.load(path)
    found: Cells = {"type": [one.dtype.str, one.shape]}
    return found | {str(i): _rows(one[:, i]) for i in range(one.shape[1])}


# --- pickles


def gmr(folder: Path, protocol: int = 4, dtype: str = "f8", order: str = "C") -> Path:
    place, turn = root()
    qpos = np.array(np.hstack([place, turn, full()]), dtype, order=order)
    tree = {
        "fps": np.float32(FPS), "root_pos": qpos[:, :3], "root_rot": qpos[:, 3:7],
        "dof_pos": qpos[:, 7:], "local_body_pos": np.zeros((ROWS, len(joints()))),
        "link_body_list": ["pelvis", "torso"], "note": {"a": [1, None, ("x", 2.5)]},
    }  # fmt: skip
    path = folder / "e.pkl"
    path.write_bytes(pickle.dumps(tree, protocol))
    return path


def pickle_cells(path: Path) -> Cells:
    tree = pickle.loads(path.read_bytes())  # ours
    one = tree.pop("dof_pos")
    found: Cells = {"type": [one.dtype.str, one.shape, one.flags.f_contiguous]}
    found |= {f"dof_pos {i}": _rows(one[:, i]) for i in range(one.shape[1])}
    return found | {key: [pickle.dumps(value)] for key, value in tree.items()}


# --- text


def csv_cells(path: Path) -> Cells:
    """Fields by column, and all else that a line is."""
    data = path.read_bytes().decode("utf-8")
    found: Cells = {"ends": [line[len(line.rstrip("\r\n")) :] for line in data.splitlines(True)]}
    lines = data.splitlines()
    comma = max(",;\t", key=lines[0].count)
    rows = [line.split(comma) for line in lines if line]
    for i in range(len(rows[0])):
        found[str(i)] = [row[i] for row in rows]
    if (side := path.with_name(path.name + ".json")).exists():
        tree = json.loads(side.read_text())
        found["side"] = [f"{k}: {v}" for k, v in tree.items() if k not in ("sha256", "mode_runs")]
    return found


def csv_mjlab(folder: Path) -> Path:
    np.savetxt(folder / "f.csv", np.hstack([*root(), full()]), "%.6f", ",", newline="\r\n")
    return folder / "f.csv"


def csv_odd(folder: Path) -> Path:
    """Semicolons, quotes, spaces, a mark before the text, empty lines, words, degrees."""
    names = robot("coman").joint_names
    lines = [";".join(["frame", '"time"', "what", *names, "foot_contact"])]
    for i, row in enumerate(np.rad2deg(motion("coman"))):
        angles = [f'"{v:.3f}"' if i % 2 else f" {v:.4e}" for v in row]
        lines += [";".join([str(i), f"{TIME[i]:.4f}", '"a ""b"" c"', *angles, "on"]), ""]
    (folder / "g.csv").write_bytes("\ufeff".encode() + "\r\n".join(lines).encode())
    return folder / "g.csv"


# --- parquet


def parquet_cells(path: Path) -> Cells:
    file = pq.ParquetFile(path)
    table = file.read(use_pandas_metadata=False)
    meta = {k: v for k, v in (table.schema.metadata or {}).items() if b"certificate" not in k}
    groups = [file.metadata.row_group(i) for i in range(file.metadata.num_row_groups)]
    found: Cells = {
        "schema": [str(table.schema.remove_metadata()), sorted(meta.items())],
        "fields": [(f.name, f.nullable, f.metadata) for f in table.schema],
        "groups": [(g.num_rows, [g.column(j).compression for j in range(g.num_columns)])
                   for g in groups],
    }  # fmt: skip
    for name in table.column_names:
        column = table[name].combine_chunks()
        if pa.types.is_floating(column.type) and not column.null_count:
            found[name] = _rows(column.to_numpy())
        elif "list" in str(column.type) and pa.types.is_floating(column.type.value_type):
            wide = column.flatten().to_numpy().reshape(len(column), -1)
            found |= {f"{name} {i}": _rows(wide[:, i]) for i in range(wide.shape[1])}
        else:
            found[name] = [repr(value) for value in column.to_pylist()]
    return found


def parquet_list(folder: Path, kind: str = "fixed") -> Path:
    value = pa.float32()
    kinds = {
        "fixed": pa.list_(value, 7 + len(joints())),
        "list": pa.list_(value),
        "large": pa.large_list(value),
    }
    wide = np.hstack([*root(), full()]).astype("f4")
    wide[:2, 0] = np.array([0x7FC00ABC, 0xFF800001], "<u4").view("<f4")
    table = pa.table(
        {"index": np.arange(ROWS), "qpos": pa.array(list(wide), kinds[kind]),
         "word": pa.array(["a", None] * (ROWS // 2)).dictionary_encode()},
    ).replace_schema_metadata(
        {"fps": str(FPS), "joint_names": json.dumps(list(joints())), "other": "kept"}
    )  # fmt: skip
    pq.write_table(table, folder / "h.parquet", compression="gzip", row_group_size=16)
    return folder / "h.parquet"


def parquet_each(folder: Path) -> Path:
    names = robot("coman").joint_names
    columns: dict[str, Any] = {"timestamp": TIME}
    columns |= {f"{n}.pos": motion("coman")[:, i] for i, n in reversed(list(enumerate(names)))}
    columns["reward"] = np.tile(PAYLOAD, ROWS // 2)
    columns["place"] = [{"x": i, "y": None} for i in range(ROWS)]
    columns["some"] = [None, 1.5] * (ROWS // 2)
    columns["flag"] = [True, False] * (ROWS // 2)
    pq.write_table(pa.table(columns), folder / "i.parquet", compression="none")
    return folder / "i.parquet"


# --- ours


def ours(suffix: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        its = robot("coman")
        mode = np.array(["free", "between"] * (ROWS // 2))
        about = {"robot": "coman", "robot_hash": its.digest, "certificate": {"holds": True},
                 "clip": "walk"}  # fmt: skip
        one = trajectory.make("a", its.joint_names, TIME, motion("coman"), np.full(ROWS, 0.003),
                              mode, about, heading=np.sin(TIME))  # fmt: skip
        files.write(one, folder / f"ours{suffix}")
        return folder / f"ours{suffix}"

    return make


# --- LeRobot


def lerobot(folder: Path, episodes: int = 3) -> Path:
    """Episodes of ROWS frames, two of them in one file; G1's names end in .pos."""
    path = folder / "set"
    names = [f"{joint}.pos" for joint in joints()] + ["left_gripper.pos"]
    wide = np.hstack([full(), np.full((ROWS, 1), np.nan)]).astype("f4")
    vector = {"dtype": "float32", "shape": [len(names)], "names": names}
    info = {
        "codebase_version": "v3.0", "fps": int(FPS), "features": {
            "action": vector, "observation.state": vector,
            **{key: {"dtype": "int64", "shape": [1], "names": None}
               for key in ("frame_index", "episode_index", "index")},
        },
    }  # fmt: skip
    row = pa.list_(pa.float32(), len(names))
    for file, inside in enumerate([list(range(episodes))[:2], list(range(episodes))[2:]]):
        if not inside:
            continue
        count = ROWS * len(inside)
        table = pa.table({
            "observation.state": pa.array([*wide] * len(inside), row),
            "action": pa.array([*wide] * len(inside), row),
            "timestamp": np.tile(TIME, len(inside)).astype("f4"),
            "frame_index": np.tile(np.arange(ROWS), len(inside)),
            "episode_index": np.repeat(inside, ROWS),
            "index": np.arange(count),
        })  # fmt: skip
        to = path / "data" / "chunk-000" / f"file-{file:03d}.parquet"
        to.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(table, to, compression="snappy")
    stats = {"min": wide.min(0), "max": wide.max(0), "mean": wide.mean(0), "std": wide.std(0),
             "q50": np.quantile(wide, 0.5, axis=0), "count": np.array([ROWS])}  # fmt: skip
    rows = {"episode_index": np.arange(episodes)}
    rows |= {f"stats/action/{key}": pa.array([value.astype("f8").tolist()] * episodes)
             for key, value in stats.items()}  # fmt: skip
    to = path / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    to.parent.mkdir(parents=True)
    pq.write_table(pa.table(rows), to)
    (path / "meta" / "info.json").write_text(json.dumps(info, indent=4))
    tree = {key: {k: v.astype("f8").tolist() for k, v in stats.items()}
            for key in ("action", "observation.state")}  # fmt: skip
    (path / "meta" / "stats.json").write_text(json.dumps(tree, indent=4))
    (path / "videos" / "front").mkdir(parents=True)
    (path / "videos" / "front" / "file-000.mp4").write_bytes(bytes(range(256)))
    return path


def lerobot_cells(path: Path) -> Cells:
    found: Cells = {"files": sorted(str(p.relative_to(path)) for p in path.rglob("*"))}
    for file in sorted(path.glob("data/*/*")):
        found |= {f"{file.stem} {k}": v for k, v in parquet_cells(file).items()}
    for name in ("meta/info.json", "videos/front/file-000.mp4"):
        found[name] = [(path / name).read_bytes()]
    tree = json.loads((path / "meta" / "stats.json").read_text())
    found["stats of others"] = [json.dumps(tree["observation.state"])]
    return found


# --- HDF5


def hdf5(folder: Path) -> Path:
    import h5py

    with h5py.File(folder / "j.h5", "w") as file:
        file.attrs["fps"] = FPS
        file.attrs["joint_names"] = list(joints())
        for k in range(2):
            group = file.create_group(f"data/demo_{k}")
            group.create_dataset("joint_pos", data=full().astype("f4"), compression="gzip")
            group["root"] = np.tile(PAYLOAD, ROWS // 2)
        file["data"].attrs["total"] = 2
    return folder / "j.h5"


def hdf5_cells(path: Path) -> Cells:
    import h5py

    found: Cells = {}

    def visit(name: str, item: Any) -> None:
        found[f"{name}, said"] = [repr(sorted((k, str(v)) for k, v in item.attrs.items()))]
        if isinstance(item, h5py.Dataset):
            one = item[()]
            found[f"{name}, type"] = [one.dtype.str, one.shape, item.compression]
            wide = one.reshape(len(one), -1)
            found.update({f"{name} {i}": _rows(wide[:, i]) for i in range(wide.shape[1])})

    with h5py.File(path) as file:
        file.visititems(visit)
    return found


NAMES = {"joints": list(joints())}
KINDS = {
    "npz": Kind(npz_all, npz_cells, dtype="f4", same=False),
    "npz, behind a base": Kind(npz_behind_a_base, npz_cells, same=False),
    "npz, an array each": Kind(npz_each, npz_cells, dtype="f4", robot="coman", same=False),
    "npy": Kind(npy, npy_cells, {**NAMES, "fps": FPS}),
    "gmr": Kind(gmr, pickle_cells),
    "gmr, float32, by columns": Kind(lambda f: gmr(f, 5, "f4", "F"), pickle_cells, dtype="f4"),
    "gmr, protocol 3": Kind(lambda f: gmr(f, 3), pickle_cells),
    "mjlab": Kind(csv_mjlab, csv_cells, {"fps": FPS}, dtype="text"),
    "csv, odd": Kind(csv_odd, csv_cells, {"degrees": True}, "text", "coman", degrees=True),
    "parquet, fixed lists": Kind(parquet_list, parquet_cells, dtype="f4", same=False),
    "parquet, lists": Kind(lambda f: parquet_list(f, "list"), parquet_cells, {}, "f4", same=False),
    "parquet, large": Kind(lambda f: parquet_list(f, "large"), parquet_cells, {}, "f4", same=False),
    "parquet, a column each": Kind(parquet_each, parquet_cells, robot="coman", same=False),
    "ours, parquet": Kind(ours(".parquet"), parquet_cells, robot="coman", same=False),
    "ours, csv": Kind(ours(".csv"), csv_cells, robot="coman"),
    "ours, npz": Kind(ours(".npz"), npz_cells, robot="coman", same=False),
    "lerobot": Kind(lerobot, lerobot_cells, dtype="f4"),
    "hdf5": Kind(hdf5, hdf5_cells, dtype="f4"),
}
