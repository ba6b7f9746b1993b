"""What holds no motion, or one that cannot be written back, is refused with its place."""

import os
import pickle
import sys
import zipfile

import layouts as made
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from layouts import FPS, KINDS, NAMES, ROWS, TIME, full, joints, motion, robot
from mutants import mutant
from reopened import beside, moved, opened, refused

from s3le.errors import TrajectoryError
from s3le.guard.layouts.door import find, open_layout
from s3le.motion import files, footer

MUTANTS = 25  # of a file


# --- pickles


class Trap:
    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (open, (str(self.path), "w"))


def test_a_pickle_that_would_run_something_is_refused_and_runs_nothing(tmp_path):
    trap = Trap(tmp_path / "ran")
    for where in (trap, {"dof_pos": trap}, {"dof_pos": full(), "fps": 30, "x": [trap]}):
        (tmp_path / "a.pkl").write_bytes(pickle.dumps(where))
        refused(tmp_path / "a.pkl", "wants to call 'io.open'")
    np.savez(tmp_path / "a.npz", q=full(), joint_names=joints(), fps=FPS,
             x=np.array([Trap(tmp_path / "ran")], object))  # fmt: skip
    refused(tmp_path / "a.npz", "'x' is pickled")
    assert not (tmp_path / "ran").exists()


def test_a_pickle_says_what_else_it_is(tmp_path):
    def saved(tree, protocol=4):
        (tmp_path / "a.pkl").write_bytes(pickle.dumps(tree, protocol))
        return tmp_path / "a.pkl"

    q = full()
    refused(saved([q]), "holds a list, no dict of arrays", "np.savez")
    refused(saved({"dof": q, "fps": 30}), "has no dof_pos (rows, joints); it has 'dof', 'fps'")
    refused(saved({"dof_pos": q}), "neither time nor rate", "--fps")
    refused(saved({"dof_pos": q, "fps": 0}), "fps must be one positive number")
    refused(saved({"dof_pos": q[:, :23], "fps": 30}), "23 columns without names", "--joints")
    refused(saved({"dof_pos": q.tolist(), "fps": 30}), "has no dof_pos")
    refused(saved({"dof_pos": q, "fps": 30}, 2), "protocol 3 and up", "pickle.dump(motion, file)")
    refused(saved({"dof_pos": q, "again": [q], "fps": 30}), "'again' and 'dof_pos' are one array")
    refused(saved({"dof_pos": q.astype(int), "fps": 30}), "holds int64, into which no angle")
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"dof_pos": q, "fps": 30})[:-9])
    refused(tmp_path / "a.pkl", "no sound pickle")
    (tmp_path / "a.pkl").write_bytes(b"")
    refused(tmp_path / "a.pkl", "is empty")
    named = {"dof_pos": q[:, ::-1].copy(), "fps": 30, "dof_names": list(joints())[::-1]}
    one = open_layout(saved(named), robot()).episodes[0]
    assert np.array_equal(one.q, motion()) and one.time[1] == 1 / 30


# --- HDF5


def test_without_h5py_it_says_how_to_get_it(tmp_path, monkeypatch):
    (tmp_path / "a.h5").write_bytes(b"\x89HDF\r\n\x1a\n")
    monkeypatch.setitem(sys.modules, "h5py", None)
    refused(tmp_path / "a.h5", "pip install 's3le[hdf5]'")


def test_hdf5_stays_within_its_file(tmp_path):
    h5py = pytest.importorskip("h5py")
    made.hdf5(tmp_path)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["data"] = h5py.ExternalLink("j.h5", "/data")
        file["soft"] = h5py.SoftLink("/data")
        file.create_group("loop")["up"] = file["/"]
    refused(tmp_path / "a.h5", "has a data set (rows, joints)")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("q", (4, 29), "f8", external=[(str(tmp_path / "j.h5"), 0, 928)])
    refused(tmp_path / "a.h5", "has a data set (rows, joints)")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("q", (1 << 40, 29), "f8", chunks=(1, 29))
    refused(tmp_path / "a.h5", "is larger than 4 GiB")
    (tmp_path / "a.h5").write_bytes((tmp_path / "j.h5").read_bytes()[:3000])
    refused(tmp_path / "a.h5", "no sound HDF5")


def test_an_hdf5_filter_that_rounds_is_refused(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["fps"], file["joint_names"] = FPS, list(joints())
        file.create_dataset("dof_pos", data=full(), scaleoffset=3)
    layout = open_layout(tmp_path / "a.h5", robot())
    with pytest.raises(TrajectoryError, match="stored by a filter that rounds"):
        layout.write(tmp_path / "b.h5", [moved(layout.episodes[0])])
    assert not (tmp_path / "b.h5").exists()


# --- bad input


def npz(path, **arrays):
    np.savez(path, **{"joint_names": joints(), "fps": FPS} | arrays)
    return path


def test_bad_arrays_are_refused_with_their_place(tmp_path):
    path, q = tmp_path / "a.npz", full()
    bad = q.copy()
    bad[7, 20] = np.nan
    refused(npz(path, q=bad), f"row 7: {joints()[20]} is nan")
    legs = q.copy()
    legs[3, 0] = 0.3
    refused(npz(path, q=legs), "row 3: left_hip_pitch_joint is 0.3 rad, but the robot file holds")
    refused(npz(path, q=q.astype("i4")), "holds int32, into which no angle can be written back")
    refused(npz(path, q=q[:, 1:]), "q has 28 columns for 29 joints")
    refused(npz(path, q=q, dof_pos=q), "which of q, dof_pos holds the joints?")
    refused(npz(path, x=q), "'waist_yaw_joint' of g1 is missing; the file has: x")
    refused(npz(path, q=q[:0]), "holds no rows")
    twice = [*joints()[:-1], "waist_yaw_joint_pos"]
    refused(npz(path, q=q, joint_names=twice), "'waist_yaw_joint_pos' and 'waist_yaw_joint' are")
    each = {joint: motion()[:, i] for i, joint in enumerate(robot().joint_names)}
    refused(
        npz(path, **each | {"waist_yaw_joint": np.zeros(3)}), "'waist_roll_joint' has shape (40,)"
    )
    falls = np.r_[TIME[:-1], 0.0]
    refused(npz(path, q=q, time=falls), f"row {ROWS - 1}: time 0 s comes after")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("q.npy", b"\x93NUMPY\x01\x00")
    refused(path, "'q' is no array of numpy's")


def test_bad_text_is_refused_with_its_line(tmp_path):
    path = made.csv_mjlab(tmp_path)
    good = path.read_text()
    refused(path, "neither time nor rate", "--fps")
    refused(path, "36 columns for 12 joints", fps=FPS, joints=list(joints())[:12])
    lines = good.splitlines()
    for line, word in (
        (lines[4] + ",1", "line 5: 37 fields for 36 columns"),
        (lines[4].replace("0.0", "0_0", 1), "is no number"),
        (lines[4].replace(",", ',"', 1), "line 5: a quote within a field"),
    ):
        path.write_text("\n".join([*lines[:4], line, *lines[5:]]))
        refused(path, word, fps=FPS)
    path.write_text(good.replace(lines[6], lines[6].rpartition(",")[0] + ",nan"))
    refused(path, "line 7: ", " is nan", fps=FPS)
    path.write_text("")
    refused(path, "is empty")
    path.write_bytes(b"\xff\xfea,b")
    refused(path, "no text in UTF-8")
    odd = made.csv_odd(tmp_path)
    text = odd.read_text("utf-8-sig")
    odd.write_text(text.replace(robot("coman").joint_names[0], "frame", 1))
    refused(odd, "column 'frame' occurs twice", of="coman")


def test_bad_parquet_is_refused_with_its_column(tmp_path):
    path = tmp_path / "a.parquet"
    names = robot("coman").joint_names
    columns = {"time": TIME} | {joint: motion("coman")[:, i] for i, joint in enumerate(names)}

    def saved(**more):
        pq.write_table(pa.table(columns | more), path)
        return path

    refused(saved(**{names[1]: [None, *columns[names[1]][1:]]}), f"row 0: {names[1]} is missing",
            of="coman")  # fmt: skip
    refused(saved(**{names[1]: np.zeros(ROWS, int)}), f"'{names[1]}' holds int64", of="coman")
    refused(saved(**{names[1]: ["x"] * ROWS}), f"'{names[1]}' holds", of="coman")
    refused(saved(time=["x"] * ROWS), "'time' holds no numbers", of="coman")
    refused(saved(**{names[1]: [[1.0]] * ROWS}), "holds lists", of="coman")
    pq.write_table(pa.table({"time": TIME, "q": [[0.0]] * 3 + [[0.0, 1.0]] * (ROWS - 3)}), path)
    refused(path, "different lengths", of="coman")
    refused(made.lerobot(tmp_path) / "data" / "chunk-000" / "file-000.parquet", "meta/info.json")
    path.write_bytes(b"PAR1xxxx")
    refused(path, "no sound Parquet")


def test_what_is_not_read_is_told_the_way_round(tmp_path):
    for name, words in (
        ("a.pt", ("np.savez('motion.npz'",)),
        ("a.mcap", ("as a CSV with a column 'time'",)),
        ("a.bvh", ("s3le retarget",)),
        ("a.xyz", ("motions end in .parquet, .csv",)),
        ("a.npz", ("is no npz",)),
        ("a.pkl", ("is no Python 3's pickle",)),
        ("a.npy", ("is no npy",)),
    ):
        (tmp_path / name).write_bytes(b"nothing")
        refused(tmp_path / name, *words)
    (tmp_path / "b.npz").write_bytes(b"")
    refused(tmp_path / "b.npz", "is empty")
    refused(tmp_path / "gone.npz", "No such file")
    refused(tmp_path, "no LeRobot data set; name its files")
    os.mkfifo(tmp_path / "pipe.npz")
    refused(tmp_path / "pipe.npz", "is no file")
    np.save(tmp_path / "c.npy", np.zeros((3, 2, 2)))
    refused(tmp_path / "c.npy", "has shape (3, 2, 2)", **NAMES)
    np.save(tmp_path / "c.npy", full())
    refused(tmp_path / "c.npy", "29 columns without names", "--joints", fps=FPS)


def broken(path):
    """Files of a good motion that are damaged one at a time."""
    if path.is_file():
        return [path]
    stats = "meta/stats.json", "meta/episodes/chunk-000/file-000.parquet"
    return [path / name for name in ("meta/info.json", "data/chunk-000/file-000.parquet", *stats)]


# libhdf5 itself goes round in circles over some damaged files (docs/files.md).
@pytest.mark.parametrize("name", [name for name in KINDS if name != "hdf5"])
def test_a_damaged_file_is_refused_or_read_and_written_as_any(tmp_path, name):
    kind = KINDS[name]
    path = kind.make(tmp_path)
    refusals = 0
    for file in broken(path):
        good = file.read_bytes()
        for number in range(MUTANTS):
            file.write_bytes(mutant(good, [good], f"{name} {file.name} {number}")[0])
            before = {one: one.read_bytes() for one in broken(path)}
            try:
                layout = opened(kind, path)
                told = [one.as_written(one.q + 1e-3) for one in layout.episodes]
                layout.write(beside(path), told)
            except TrajectoryError as refusal:
                assert len(str(refusal).splitlines()) == 1 and str(tmp_path) in str(refusal)
                refusals += 1
            else:
                again = opened(kind, beside(path)).episodes
                for one, q in zip(again, told, strict=True):
                    assert np.array_equal(one.q, q)
            assert before == {one: one.read_bytes() for one in broken(path)}
        file.write_bytes(good)
    assert refusals > 0.1 * MUTANTS


@pytest.mark.parametrize("kind", ["fixed", "list"])
def test_what_a_parquet_file_claims_to_hold_is_counted_before_it_is_read(tmp_path, kind):
    path = made.parquet_list(tmp_path, kind)
    meta = pq.ParquetFile(path).metadata
    groups = [meta.row_group(i) for i in range(meta.num_row_groups)]
    values = sum(group.column(j).num_values for group in groups for j in range(3))
    assert footer.claimed(path) == values > ROWS * (7 + len(joints()))
    long = pa.array(np.zeros((1, 1 << 20)).tolist(), pa.list_(pa.float32()))
    pq.write_table(pa.table({"q": long}), path)
    assert path.stat().st_size < 10_000 and footer.claimed(path) == 1 << 20


def test_a_parquet_file_that_claims_too_much_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("s3le.motion.parquet.MOST_VALUES", 100)
    refused(made.parquet_each(tmp_path), "holds more than 100 numbers", of="coman")
    with pytest.raises(TrajectoryError, match="holds more than 100 numbers"):
        files.read(tmp_path / "i.parquet")


# --- folders


def test_motions_below_a_folder_are_found_and_nothing_else(tmp_path):
    made.gmr(tmp_path)
    (tmp_path / "sub").mkdir()
    made.npz_all(tmp_path / "sub")
    made.ours(".csv")(tmp_path / "sub")
    made.lerobot(tmp_path / "sub")
    (tmp_path / ".hidden").mkdir()
    made.npy(tmp_path / ".hidden")
    (tmp_path / "sub" / ".a.npz.1.part").write_bytes(b"PK")
    (tmp_path / "readme.txt").write_text("no")
    pq.write_table(pa.table({"a": [1]}).replace_schema_metadata({"s3le.format": "points 1"}),
                   tmp_path / "points.parquet")  # fmt: skip
    made.ours(".parquet")(tmp_path)
    found = [str(path.relative_to(tmp_path)) for path in find(tmp_path)]
    assert found == ["e.pkl", "ours.parquet", "sub/a.npz", "sub/ours.csv", "sub/set"]
    assert find(tmp_path / "e.pkl") == [tmp_path / "e.pkl"]
    assert find(tmp_path / "sub" / "set") == [tmp_path / "sub" / "set"]
    with pytest.raises(TrajectoryError, match="no such file or folder"):
        find(tmp_path / "gone")
    (tmp_path / "empty").mkdir()
    with pytest.raises(TrajectoryError, match="holds no motion"):
        find(tmp_path / "empty")
