"""Trajectory files: what is written comes back to the bit, and nothing else gets in."""

import io
import json
import pickle
import zipfile

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from handmade import broken
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import coman

from s3le.errors import S3leError, TrajectoryError
from s3le.motion import files, npz, text, trajectory
from s3le.motion.fit import fit

WRITTEN = files.WRITTEN
finite = st.floats(allow_nan=False, allow_infinity=False)


def made(rows=5, joints=("hip", "knee"), **more):
    """Some motion, numbers as awkward as they come."""
    rng = np.random.default_rng(1)
    q = rng.normal(size=(rows, len(joints))) / 3
    columns = {
        "clearance": rng.random(rows) / 7,
        "mode": np.array(["reached", "held"])[np.arange(rows) % 2],
        "about": {"robot": "toy", "robot_hash": "12ab", "certificate": {"margin_m": 0.002}},
    } | more
    return trajectory.make("toy", joints, np.arange(rows) / 30, q, **columns)


def saved(path, **arrays):
    np.savez(path, **arrays)
    return path


def refused(path, *words, **options):
    """The one line with which a file is refused."""
    with pytest.raises(TrajectoryError) as caught:
        files.read(path, **options)
    said = str(caught.value)
    assert "\n" not in said and str(path) in said
    for word in words:
        assert word in said, said
    return said


# --- there and back


@pytest.mark.parametrize("suffix", WRITTEN)
def test_what_is_written_comes_back_to_the_bit(tmp_path, suffix):
    one = made()
    files.write(one, tmp_path / f"a{suffix}")
    back = files.read(tmp_path / f"a{suffix}")
    assert back.joints == one.joints and back.mode.tolist() == one.mode.tolist()
    for want, have in ((one.time, back.time), (one.q, back.q), (one.clearance, back.clearance)):
        assert want.tobytes() == have.tobytes()
    assert back.about.items() >= one.about.items()
    assert back.rate == pytest.approx(30.0)


@settings(max_examples=40, deadline=None)
@given(
    numbers=st.lists(st.tuples(finite, finite), min_size=1, max_size=6),
    start=st.floats(-1e3, 1e3),
    step=st.floats(1e-3, 10),
    suffix=st.sampled_from(WRITTEN),
)
def test_any_finite_numbers_come_back(tmp_path_factory, numbers, start, step, suffix):
    path = tmp_path_factory.mktemp("any") / f"a{suffix}"
    time = start + step * np.arange(len(numbers))
    one = trajectory.make("any", ("b", "a"), time, np.array(numbers))
    files.write(one, path)
    back = files.read(path)
    assert back.q.tobytes() == one.q.tobytes() and back.time.tobytes() == one.time.tobytes()
    assert back.clearance is None and back.mode is None


@pytest.mark.parametrize("suffix", WRITTEN)
def test_the_same_motion_gives_the_same_bytes(tmp_path, suffix):
    for name in "ab":
        files.write(made(), tmp_path / f"{name}{suffix}")
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_a_parquet_file_explains_itself(tmp_path):
    files.write(made(), tmp_path / "a.parquet")
    schema = pq.read_schema(tmp_path / "a.parquet")
    assert schema.names == ["time", "hip", "knee", "clearance", "mode"]
    assert schema.field("hip").metadata[b"unit"] == b"rad"
    about = schema.metadata
    assert about[b"s3le.robot"] == b"toy" and about[b"s3le.robot_hash"] == b"12ab"
    assert json.loads(about[b"s3le.certificate"]) == {"margin_m": 0.002}
    assert b"s3le.version" in about


def test_numpy_alone_reads_an_npz(tmp_path):
    files.write(made(), tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as arrays:
        assert arrays["q"].shape == (5, 2) and arrays["joint_names"].tolist() == ["hip", "knee"]
        assert arrays["fps"] == pytest.approx(30.0)


def test_a_rate_is_claimed_only_where_the_steps_are_alike(tmp_path):
    one = trajectory.make("a", ("hip",), [0.0, 0.1, 0.3], np.zeros((3, 1)))
    assert one.rate is None
    files.write(one, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as arrays:
        assert "fps" not in arrays


def test_a_csv_changed_by_hand_claims_nothing(tmp_path):
    path = tmp_path / "a.csv"
    files.write(made(), path)
    assert files.read(path).about["robot"] == "toy"
    path.write_text(path.read_text() + "0.2,0,0,1,held\n")
    back = files.read(path)
    assert len(back.q) == 6 and back.about == {}


@pytest.mark.parametrize("suffix", WRITTEN)
def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"a{suffix}"
    files.write(made(), path)
    before = path.read_bytes()

    def fails(*_args, **_more):
        raise OSError("disk full")

    for place in ("s3le.motion.parquet.pq.write_table", "numpy.savez_compressed"):
        monkeypatch.setattr(place, fails)
    monkeypatch.setattr("s3le.store.atomic.os.fsync", fails)
    with pytest.raises(OSError, match="disk full"):
        files.write(made(rows=9), path)
    assert path.read_bytes() == before
    assert not [p for p in tmp_path.iterdir() if p.name.endswith(".part")]


# --- other tools' files


def test_joints_in_one_array_with_names_and_a_rate(tmp_path):
    q = np.arange(6.0).reshape(3, 2)
    path = saved(tmp_path / "a.npz", dof_pos=q, joint_names=["hip", "knee"], fps=50)
    back = files.read(path)
    assert back.joints == ("hip", "knee") and (back.q == q).all() and back.rate == 50.0


def test_a_free_base_in_front_of_the_joints_is_left_out(tmp_path):
    q = np.hstack([np.full((3, 7), 9.0), np.arange(6.0).reshape(3, 2)])
    path = saved(tmp_path / "a.npz", qpos=q, joint_names=["hip", "knee"], dt=0.02)
    assert (files.read(path).q == q[:, 7:]).all()
    named = saved(tmp_path / "b.npz", qpos=q, joint_names=["root", "hip", "knee"], dt=0.02)
    assert files.read(named).joints == ("hip", "knee")
    rows = tmp_path / "a.csv"
    rows.write_text("\n".join(",".join(map(str, row)) for row in q))
    back = files.read(rows, fps=30.0, joints=["hip", "knee"])
    assert (back.q == q[:, 7:]).all() and back.rate == pytest.approx(30.0)


def test_parquet_with_a_list_of_joints_a_row(tmp_path):
    table = pa.table({"timestamp": [0.0, 0.1], "joint_pos": [[1.0, 2.0], [3.0, 4.0]]})
    table = table.replace_schema_metadata({"joint_names": '["hip", "knee"]'})
    pq.write_table(table, tmp_path / "a.parquet")
    assert files.read(tmp_path / "a.parquet").q.tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize("mark", [",", ";", "\t"], ids=["comma", "semicolon", "tab"])
def test_csv_of_any_common_kind(tmp_path, mark):
    path = tmp_path / "a.csv"
    path.write_bytes(b"\xef\xbb\xbf" + f"t{mark}knee{mark}hip\r\n0{mark}1{mark}2e-1\r\n".encode())
    back = files.read(path)
    assert back.joints == ("knee", "hip") and back.q.tolist() == [[1.0, 0.2]]


# --- refusals: file, place, value


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("time,a\n0,1\n0.1,x\n", ("line 3", "a", "'x' is no number")),
        ("time,a\n0,1\n0.1,\n", ("line 3", "'' is no number")),
        ("time,a\n0,1_0\n", ("line 2", "'1_0' is no number")),
        ("time,a\n0,1\n0.1\n", ("line 3", "1 fields for 2 columns")),
        ("time,a\n0,1\n0.1,nan\n", ("line 3", "a is nan")),
        ("time,a\n0,1\n0.1,1e999\n", ("line 3", "a is inf")),
        ("time,a\n0,1\nnan,1\n", ("line 3", "time is nan")),
        ("time,a\n0.5,1\n0.4,1\n", ("line 3", "0.4 s comes after 0.5 s")),
        ("time,a\n0.5,1\n0.5,1\n", ("line 3", "must rise")),
        ("time,a,a\n0,1,1\n", ("'a' occurs twice",)),
        ("time\n0\n", ("no column of a joint",)),
        ("time,a\n", ("holds no rows",)),
        ("", ("is empty",)),
        ("\n", ("is",)),
        ("a\n1\n", ("neither time nor rate", "--fps")),
        ("0,1\n0.1,2\n", ("holds numbers, not names", "--joints")),
        ('time,a\n0,"1\n', ("line 2",)),
        ("time,a\0\n0,1\n", ("zero byte",)),
        ("time," + "n" * 300 + "\n0,1\n", ("is no name",)),
    ],
)
def test_a_bad_csv_is_refused_with_its_line(tmp_path, lines, words):
    path = tmp_path / "a.csv"
    path.write_text(lines)
    refused(path, *words)


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"q": np.zeros((2, 1)), "fps": 30}, ("without names", "--joints")),
        ({"q": np.zeros((2, 1)), "joint_names": ["a"]}, ("neither time nor rate",)),
        ({"q": np.zeros((2, 1)), "joint_names": ["a"], "fps": 0}, ("positive",)),
        ({"q": np.zeros((2, 1)), "joint_names": ["a"], "fps": np.nan}, ("positive",)),
        ({"q": np.zeros((2, 3)), "joint_names": ["a"], "fps": 1}, ("3 columns for 1 joints",)),
        ({"q": np.zeros((2, 1)), "joint_names": ["a"], "time": [0.0]}, ("1 times for 2",)),
        ({"q": np.zeros((0, 1)), "joint_names": ["a"], "fps": 1}, ("no rows",)),
        ({"q": [[np.inf]], "joint_names": ["a"], "fps": 1}, ("row 0", "a is inf")),
        ({"q": np.zeros((2, 2)), "joint_names": ["a", "a"], "fps": 1}, ("occurs twice",)),
        ({"q": np.zeros((2, 1)), "joint_names": [1.0], "fps": 1}, ("list of words",)),
        ({"q": np.zeros((2, 1)), "dof_pos": np.zeros((2, 1)), "fps": 1}, ("which of",)),
        ({"q": [["x"]], "joint_names": ["a"], "fps": 1}, ("no numbers",)),
        ({"q": np.array([[{}]]), "joint_names": ["a"], "fps": 1}, ("'q' is pickled",)),
        ({"q": np.zeros((1, 1), complex), "joint_names": ["a"], "fps": 1}, ("neither",)),
        ({"a": np.zeros((2, 2, 2)), "time": [0, 1]}, ("has shape (2, 2, 2)",)),
    ],
)
def test_a_bad_npz_is_refused_with_its_array(tmp_path, arrays, words):
    refused(saved(tmp_path / "a.npz", **arrays), *words)


def test_pickles_are_refused_with_the_safe_way(tmp_path):
    class Trap:
        def __reduce__(self):
            return (open, (str(tmp_path / "opened"), "w"))

    for name in ("gmr.pkl", "gmr.npz", "gmr.csv", "gmr.pt"):
        (tmp_path / name).write_bytes(pickle.dumps(Trap()))
        refused(tmp_path / name, "is a pickle", "np.savez", "docs/files.md")
    trap = saved(tmp_path / "trap.npz", q=np.array([[Trap()]], object))
    refused(trap, "is pickled")
    assert not (tmp_path / "opened").exists()


def test_an_npz_that_claims_more_than_it_holds_is_refused_before_memory_is_asked_for(tmp_path):
    def one(header, data=b"\0" * 8):
        body = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + data
        with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
            archive.writestr("q.npy", body)
        return tmp_path / "a.npz"

    head = "{{'descr': {}, 'fortran_order': False, 'shape': {}}}\n"
    refused(one(head.format("'<f8'", "(1 << 50, 1)").encode()), "no array")
    refused(one(head.format("'<f8'", f"({1 << 50}, 1)").encode()), "claims")
    refused(one(head.format("'<f8'", "(-1, -1)").encode()))
    refused(one(head.format("'<f8'", "(2, 1)").encode()), "claims")
    refused(one(head.format("'<f8'", "(1, 1)").encode(), b"\0" * 9), "does not hold")
    refused(one(head.format("'<U2'", "(1,)").encode(), b"\xff" * 8), "no text")
    refused(one(b"{" * 400), "no array")
    refused(one(head.format("'<V8'", "(1, 1)").encode()), "neither")
    refused(one(head.format("'<U0'", f"({1 << 40},)").encode(), b""), "claims")
    refused(one(head.format("'<f8'", "(1L, 1)").encode()), "no array", "Python 2")
    refused(one(b"{'a': '\\\n"), "no array")


def test_an_archive_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    path = saved(tmp_path / "a.npz", q=np.zeros((2, 1)), joint_names=["a"], fps=1)
    files.read(path)
    monkeypatch.setattr(npz, "MOST_BYTES", 100)
    refused(path, "unpacks to more than")
    with zipfile.ZipFile(tmp_path / "b.npz", "w") as archive:
        for _ in range(2):
            with pytest.warns(UserWarning) if "q.npy" in archive.NameToInfo else _nothing():
                archive.writestr("q.npy", b"")
    refused(tmp_path / "b.npz", "two of one name")


class _nothing:  # noqa: N801
    def __enter__(self):
        return self

    def __exit__(self, *_):
        return False


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"time": [0.0, 0.1], "a": [1.0, None]}, ("row 1", "a is missing")),
        ({"time": [0.0, 0.1], "a": ["x", "y"]}, ("holds no numbers",)),
        ({"time": [0.0, 0.1], "a": [{"b": 1}, {"b": 2}]}, ("neither numbers nor words",)),
        ({"time": [0.0, 0.1], "q": [[1.0], [1.0, 2.0]]}, ("different lengths",)),
        ({"time": ["x", "y"], "a": [1.0, 2.0]}, ("'time' holds no numbers",)),
        ({"time": [], "a": []}, ("no rows",)),
    ],
)
def test_a_bad_parquet_is_refused_with_its_column(tmp_path, columns, words):
    pq.write_table(pa.table(columns), tmp_path / "a.parquet")
    refused(tmp_path / "a.parquet", *words)


def test_suffix_and_content_must_agree(tmp_path):
    files.write(made(), tmp_path / "a.npz")
    data = (tmp_path / "a.npz").read_bytes()
    for name, words in (
        ("b.parquet", "is no parquet"),
        ("b.npy", "is no npy"),
        ("b.bvh", "trajectories end in"),
    ):
        (tmp_path / name).write_bytes(data)
        refused(tmp_path / name, words)
    (tmp_path / "c.npz").write_bytes(b"")
    refused(tmp_path / "c.npz", "is empty")
    refused(tmp_path / "none.csv", "No such file")
    refused(tmp_path, "trajectories end in") if tmp_path.suffix else refused(tmp_path)


@pytest.mark.parametrize("suffix", WRITTEN)
def test_a_damaged_file_is_read_or_refused_and_nothing_else(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    files.write(made(rows=40), path)
    for copy in broken(path.read_bytes(), 150, 3):
        path.write_bytes(copy)
        try:
            back = files.read(path)
        except TrajectoryError as refusal:
            assert "\n" not in str(refusal)
        else:
            assert np.isfinite(back.q).all() and (np.diff(back.time) > 0).all()


def test_memory_cannot_be_claimed_by_a_long_line(tmp_path, monkeypatch):
    monkeypatch.setattr(text, "MOST_BYTES", 10)
    (tmp_path / "a.csv").write_text("time,a\n0,1\n")
    refused(tmp_path / "a.csv", "more than")


# --- held against a robot


def of_coman(q=None, joints=None, **more):
    robot = coman()
    q = np.repeat(robot.anchor[None], 3, 0) if q is None else q
    joints = robot.joint_names if joints is None else joints
    return trajectory.make("walk.csv", joints, np.arange(len(q)) / 30, q, **more)


def test_joints_come_into_the_robots_order_whatever_theirs():
    robot = coman()
    q = np.repeat(robot.anchor[None], 3, 0) + np.arange(11) / 100
    names = robot.joint_names[::-1]
    found = fit(of_coman(q[:, ::-1], names), robot)
    assert found.trajectory.joints == tuple(robot.joint_names)
    assert (found.trajectory.q == q).all() and found.notes == []
    suffixed = fit(of_coman(q, [f"{name}_dof" for name in robot.joint_names]), robot)
    assert (suffixed.trajectory.q == q).all()


def test_the_base_is_left_out_and_said():
    robot = coman()
    q = np.hstack([np.ones((3, 2)), np.repeat(robot.anchor[None], 3, 0)])
    found = fit(of_coman(q, ["root_x", "qw", *robot.joint_names]), robot)
    assert found.notes == ["columns of the base are left out: root_x, qw"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda n: n[:-1], ("joint 'RElbj' of coman is missing", "the file has")),
        (lambda n: [*n[:-1], "RElbow"], ("'RElbj' of coman is missing", "is it 'RElbow'?")),
        (lambda n: [*n, "LElb"], ("column 'LElb' is no joint of coman.urdf", "is it 'LElbj'?")),
        (lambda n: [*n, "LElbj_pos"], ("'LElbj_pos' and another column are both 'LElbj'",)),
    ],
    ids=["missing", "misspelt", "extra", "twice"],
)
def test_joints_that_do_not_fit_are_refused_by_name(change, words):
    robot = coman()
    names = change(robot.joint_names)
    q = np.zeros((3, len(names)))
    with pytest.raises(TrajectoryError) as caught:
        fit(of_coman(q, names), robot)
    assert str(caught.value).startswith("walk.csv: ")
    for word in words:
        assert word in str(caught.value)


def test_a_joint_that_the_robot_holds_may_stand_there_and_not_move():
    robot = coman()
    q = np.hstack([np.repeat(robot.anchor[None], 3, 0), np.zeros((3, 1))])
    names = [*robot.joint_names, "LWrj1"]
    assert fit(of_coman(q, names), robot).trajectory.q.shape == (3, 11)
    q[1, -1] = 0.2
    with pytest.raises(TrajectoryError, match="row 1: LWrj1 is 0.2 rad, but .* holds it at 0"):
        fit(of_coman(q, names), robot)


def test_degrees_are_suspected_and_read_as_such():
    robot = coman()
    q = np.repeat(robot.anchor[None], 3, 0)
    (note,) = fit(of_coman(np.rad2deg(q)), robot).notes
    assert "LShLat is 90 rad" in note and "--degrees" in note
    found = fit(of_coman(np.rad2deg(q)), robot, degrees=True)
    assert found.notes == [] and found.trajectory.q == pytest.approx(q, abs=1e-12)


def test_a_file_of_another_robot_is_told_apart():
    (note,) = fit(of_coman(about={"robot": "x", "robot_hash": "00"}), coman()).notes
    assert "made for robot x 00" in note


@settings(max_examples=100, deadline=None)
@given(data=st.binary(max_size=400), suffix=st.sampled_from([".csv", ".npz", ".parquet", ".npy"]))
def test_any_bytes_are_read_or_refused(tmp_path_factory, data, suffix):
    begin = {".npz": b"PK\x03\x04", ".parquet": b"PAR1", ".npy": b"\x93NUMPY\x01\x00"}
    path = tmp_path_factory.mktemp("bytes") / f"a{suffix}"
    path.write_bytes(begin.get(suffix, b"") + data)
    try:
        files.read(path, fps=30.0, joints=["a"])
    except S3leError as refusal:
        assert "\n" not in str(refusal)


def test_what_numpy_saves_in_its_other_orders_is_read_alike(tmp_path):
    q = np.arange(6.0).reshape(3, 2)
    for i, array in enumerate((np.asfortranarray(q), q.astype(">f8"), q.astype("<f4"))):
        buffer = io.BytesIO()
        np.save(buffer, array)
        (tmp_path / f"{i}.npy").write_bytes(buffer.getvalue())
        assert (files.read(tmp_path / f"{i}.npy", 30.0, ["a", "b"]).q == q).all()
