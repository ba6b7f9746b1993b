"""Any tool's joint motion comes back in its own layout, with other joints and nothing else."""

import layouts as made
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from layouts import FPS, KINDS, ROWS, TIME, full, joints, motion, robot
from reopened import ALL, MOVED, beside, moved, opened

from s3le.errors import TrajectoryError
from s3le.guard.layouts.door import open_layout
from s3le.guard.layouts.episode import GUARDED
from s3le.guard.layouts.numbers import Numbers, decode
from s3le.motion import files, trajectory, whole
from s3le.motion import layouts as tools
from s3le.motion import root as base

CLAIMS = {"about", "about, type", "side", "clearance", "mode", "mode, type"}


# --- what holds in every layout


@pytest.mark.parametrize("name", ALL)
def test_the_angles_are_those_that_were_written(tmp_path, name):
    kind = KINDS[name]
    for one in opened(kind, kind.make(tmp_path)).episodes:
        exact = motion(kind.robot)
        if kind.dtype == "text":
            assert np.abs(one.q - exact).max() < (1e-4 if kind.degrees else 1e-6)
        else:
            assert np.array_equal(one.q, exact.astype(kind.dtype).astype(float))
        assert np.array_equal(one.time, TIME)


@pytest.mark.parametrize("name", ALL)
def test_a_motion_that_nobody_changed_comes_back_to_the_bit(tmp_path, name):
    kind = KINDS[name]
    path = kind.make(tmp_path)
    layout = opened(kind, path)
    for one in layout.episodes:
        assert np.array_equal(one.as_written(one.q), one.q)
    layout.write(beside(path), [one.q for one in layout.episodes])
    for one, was in zip(opened(kind, beside(path)).episodes, layout.episodes, strict=True):
        assert np.array_equal(one.q, was.q) and np.array_equal(one.time, was.time)
    before, after = kind.cells(path), kind.cells(beside(path))
    for key in CLAIMS - {"clearance", "mode"}:
        before.pop(key, None), after.pop(key, None)
    assert before == after
    if kind.same and path.is_file():
        assert path.read_bytes() == beside(path).read_bytes()
    for file in path.rglob("*") if path.is_dir() else ():
        copy = beside(path) / file.relative_to(path)
        assert copy.is_dir() if file.is_dir() else file.read_bytes() == copy.read_bytes()


@pytest.mark.parametrize("name", ALL)
def test_what_was_proven_lies_in_the_file_and_nothing_else_has_changed(tmp_path, name):
    kind = KINDS[name]
    path = kind.make(tmp_path)
    layout = opened(kind, path)
    wanted = [moved(one) for one in layout.episodes]
    proven = [one.as_written(q) for one, q in zip(layout.episodes, wanted, strict=True)]
    for one, q, told in zip(layout.episodes, wanted, proven, strict=True):
        assert np.array_equal(one.as_written(told), told)
        assert np.abs(told - q).max() < (1e-15 if kind.dtype in ("f8", "text") else 3e-7)
        assert (told[MOVED] != one.q[MOVED]).sum() == 2 * len(MOVED)
        rest = np.setdiff1d(np.arange(ROWS), MOVED)
        assert np.array_equal(told[rest], one.q[rest])
    layout.write(beside(path), wanted)
    for one, q in zip(opened(kind, beside(path)).episodes, proven, strict=True):
        assert np.array_equal(one.q, q) and np.array_equal(one.time, TIME)
    before, after = kind.cells(path), kind.cells(beside(path))
    assert list(before) == list(after)
    changed = {}
    for key in before.keys() - CLAIMS:
        assert len(before[key]) == len(after[key])
        lines = [a != b for a, b in zip(before[key], after[key], strict=True)]
        if any(lines) and before[key][0] not in ("clearance", "mode"):
            changed[key] = (np.flatnonzero(lines) - len(lines) % ROWS) % ROWS
    assert len(changed) == (4 if name in ("lerobot", "hdf5") else 2)
    for rows in changed.values():
        assert set(rows.tolist()) == set(MOVED)


@pytest.mark.parametrize("name", ALL)
def test_what_does_not_fit_is_refused_and_leaves_the_file_that_is_there(tmp_path, name):
    kind = KINDS[name]
    path = kind.make(tmp_path)
    layout = opened(kind, path)
    before = kind.cells(path)
    good = [one.q for one in layout.episodes]
    bad = good[-1].copy()
    bad[3, 1] = np.nan
    for q, word in (
        (good[1:], "motions for its"),
        ([*good[:-1], bad], "row 3: angle 1 is nan"),
        ([*good[:-1], bad[:, 1:]], "angles of shape"),
        ([*good[:-1], bad[1:]], "angles of shape"),
    ):
        with pytest.raises(TrajectoryError, match=word) as error:
            layout.write(path, q)
        assert str(path) in str(error.value)
    assert kind.cells(path) == before
    left = {p.name for p in tmp_path.iterdir()}
    assert not [name for name in left if name.startswith(".")]


@pytest.mark.parametrize("name", ALL)
def test_a_file_may_be_replaced_by_its_own_new_one(tmp_path, name):
    kind = KINDS[name]
    path = kind.make(tmp_path)
    layout = opened(kind, path)
    layout.write(path, [moved(one) for one in layout.episodes])
    for one, was in zip(opened(kind, path).episodes, layout.episodes, strict=True):
        assert np.array_equal(one.q, was.as_written(moved(was)))


# --- numbers


@pytest.mark.parametrize("kind", ["f2", "f4", "f8", ">f4", ">f8"])
@pytest.mark.parametrize("degrees", [False, True])
def test_rounding_is_to_the_nearest_number_and_never_out_of_the_range(kind, degrees):
    rng = np.random.default_rng(1)
    lower, upper = np.array([-1.0 / 3.0, -0.7]), np.array([1.0 / 3.0, 2.0 / 3.0])
    q = rng.uniform(lower, upper, (500, 2))
    q[:3], q[3:6] = upper, lower
    raw = tuple(np.zeros(500, kind) for _ in lower)
    it = Numbers(raw, (degrees, degrees), np.zeros((500, 2)), lower, upper)
    told = it.as_written("a", q)
    assert (told >= lower).all() and (told <= upper).all()
    assert np.array_equal(it.as_written("a", told), told)
    scale = np.rad2deg(1.0) if degrees else 1.0
    step = np.spacing(np.abs(q * scale).astype(kind)).astype(float) / scale
    assert (np.abs(told - q)[6:] <= 0.51 * step[6:] + 1e-16).all()
    for column, values in zip(it.encode("a", q), told.T, strict=True):
        assert column.dtype == np.dtype(kind)
        assert np.array_equal(decode(column, degrees), values)


def test_what_is_out_of_the_range_already_is_not_pulled_in():
    it = Numbers((np.array([0.5, 0.5], "f4"),), (False,), np.array([[0.5], [0.5]]),
                 np.array([-0.3]), np.array([0.3]))  # fmt: skip
    assert it.as_written("a", np.array([[0.5], [0.6]])).tolist() == [[0.5], [np.float32(0.6)]]


def test_an_angle_that_the_file_cannot_hold_is_refused():
    it = Numbers((np.zeros(2, "f4"),), (False,), np.zeros((2, 1)), np.array([-9.0]),
                 np.array([9.0]))  # fmt: skip
    with pytest.raises(TrajectoryError, match="a: row 1: angle 0, 1e.300 rad, is larger than"):
        it.as_written("a", np.array([[1.0], [1e300]]))


# --- what a file of ours says of itself


@pytest.mark.parametrize("suffix", [".parquet", ".csv", ".npz"])
def test_an_old_certificate_goes_and_a_new_one_comes(tmp_path, suffix):
    path = made.ours(suffix)(tmp_path)
    layout = open_layout(path, robot("coman"))
    assert layout.episodes[0].mode.tolist() == ["free", "between"] * (ROWS // 2)
    q = layout.episodes[0].q
    layout.write(beside(path), [q])
    assert files.read(beside(path)).about == {
        key: value for key, value in files.read(path).about.items() if key != "certificate"
    }
    layout.write(beside(path), [moved(layout.episodes[0])], {"certificate": {"by": 2}, "n": "x"})
    again = files.read(beside(path))
    assert again.about["certificate"] == {"by": 2} and again.about["n"] == "x"
    assert again.about["clip"] == "walk" and again.about["robot_hash"] == robot("coman").digest
    rest = np.setdiff1d(np.arange(ROWS), MOVED)
    assert np.isnan(again.clearance[MOVED]).all() and (again.clearance[rest] == 0.003).all()
    assert (again.mode[MOVED] == GUARDED).all() and GUARDED not in again.mode[rest]
    assert np.array_equal(again.heading, np.sin(TIME))


@pytest.mark.parametrize("tool", ["gmr", "mjlab"])
def test_what_was_written_for_a_tool_keeps_names_rate_and_modes(tmp_path, tool):
    its = robot("coman")
    everything = whole.joints(its)
    one = trajectory.make(
        "a", its.joint_names, TIME, motion("coman"), mode=np.array(["free", "between"] * 20),
        about={"certificate": {"holds": True}, "clip": "walk"},
    )  # fmt: skip
    one = whole.numbered(whole.complete(one, its, everything), everything)
    path = tmp_path / f"a{tools.SUFFIX[tool]}"
    tools.write(one, base.find(its), FPS, tool, path)
    layout = open_layout(path, its)
    assert np.array_equal(layout.episodes[0].q, motion("coman"))
    assert np.allclose(layout.episodes[0].time, TIME, atol=1e-12)
    layout.write(beside(path), [moved(layout.episodes[0])], {"certificate": {"by": 2}})
    again, old = files.read(beside(path)), files.read(path)
    assert again.joints == old.joints and np.array_equal(again.time, old.time)
    assert again.about["certificate"] == {"by": 2} and again.about["layout"] == old.about["layout"]
    rows = np.flatnonzero(again.mode != old.mode)
    assert rows.tolist() == list(MOVED) and (again.mode[rows] == GUARDED).all()
    assert np.array_equal(open_layout(beside(path), its).episodes[0].q, moved(layout.episodes[0]))


def test_a_csv_whose_side_file_is_about_another_claims_nothing(tmp_path):
    path = made.ours(".csv")(tmp_path)
    path.write_bytes(path.read_bytes() + b"\n")
    layout = open_layout(path, robot("coman"))
    layout.write(beside(path), [layout.episodes[0].q], {"certificate": {"by": 2}})
    assert not beside(path).with_name("other.csv.json").exists()


def test_words_called_mode_in_a_foreign_file_are_left_alone(tmp_path):
    names = robot("coman").joint_names
    columns = {"time": TIME, "mode": ["walk"] * ROWS, "clearance": np.ones(ROWS)}
    columns |= {joint: motion("coman")[:, i] for i, joint in enumerate(names)}
    pq.write_table(pa.table(columns), tmp_path / "a.parquet")
    layout = open_layout(tmp_path / "a.parquet", robot("coman"))
    layout.write(tmp_path / "b.parquet", [moved(layout.episodes[0])], {"robot": "coman"})
    again = pq.read_table(tmp_path / "b.parquet")
    assert again["mode"].to_pylist() == ["walk"] * ROWS and not again.schema.metadata
    assert again["clearance"].to_pylist() == [1.0] * ROWS


def test_a_file_that_says_it_is_of_another_robot_is_noted(tmp_path):
    its = robot("coman")
    one = trajectory.make("a", its.joint_names, TIME, motion("coman"), about={"robot_hash": "0"})
    files.write(one, tmp_path / "a.npz")
    (note,) = open_layout(tmp_path / "a.npz", its).episodes[0].notes
    assert "made for robot" in note


# --- notes


def test_what_was_assumed_and_what_stays_is_said(tmp_path):
    notes = open_layout(made.gmr(tmp_path), robot()).episodes[0].notes
    assert "no names: its 29 joints are taken as MuJoCo numbers them" in notes[0]
    assert "root_pos, root_rot, local_body_pos" in notes[1]
    notes = open_layout(made.parquet_each(tmp_path), robot("coman")).episodes[0].notes
    assert "stay as they are" in notes[0] and "reward, place, some, flag" in notes[0]
    notes = open_layout(made.lerobot(tmp_path), robot()).episodes[0].notes
    assert "'action'" in notes[0] and "left_gripper.pos" in notes[1]


def test_degrees_for_radians_are_asked_about(tmp_path):
    q = np.rad2deg(full())
    np.savez(tmp_path / "a.npz", q=q, joint_names=joints(), fps=FPS)
    (note,) = open_layout(tmp_path / "a.npz", robot()).episodes[0].notes
    assert "are these degrees? --degrees" in note
    assert not open_layout(tmp_path / "a.npz", robot(), degrees=True).episodes[0].notes
