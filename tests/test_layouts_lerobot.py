"""A LeRobot data set comes back with other joints, new statistics and nothing else changed."""

import json
import os

import layouts as made
import numpy as np
import pyarrow.parquet as pq
import pytest
from layouts import ROWS, TIME, joints, motion, robot
from reopened import beside, moved, refused

from s3le.errors import TrajectoryError
from s3le.guard.layouts.door import open_layout


def test_what_a_data_set_says_of_its_columns_follows_the_joints(tmp_path):
    path = made.lerobot(tmp_path)
    layout = open_layout(path, robot())
    assert [one.name for one in layout.episodes] == [f"{path}, episode {i}" for i in range(3)]
    wanted = [one.q for one in layout.episodes]
    wanted[1] = moved(layout.episodes[1])
    wanted[1][20] = wanted[1].min(axis=0) - 0.01
    wanted[1][21] = wanted[1].max(axis=0) + 0.01
    wanted[1][:, 4:] = layout.episodes[1].q[:, 4:]
    layout.write(tmp_path / "new", wanted)
    new = open_layout(tmp_path / "new", robot())
    whole = np.concatenate([one.q for one in new.episodes])
    at = [joints().index(joint) for joint in robot().joint_names]
    both = at[:4]
    old, told = (
        json.loads((p / "meta" / "stats.json").read_text())["action"] for p in (path, new.path)
    )
    for name, by in (("min", np.min), ("max", np.max), ("mean", np.mean), ("std", np.std)):
        assert np.allclose(np.array(told[name])[both], by(whole, axis=0)[:4], atol=1e-12)
    median = np.quantile(whole, 0.5, axis=0)
    assert np.allclose(np.array(told["q50"])[both], median[:4], atol=1e-12)
    for name in old:  # of joints that did not move, not a digit
        rest = [i for i in range(len(old[name])) if i not in both]
        assert repr([old[name][i] for i in rest]) == repr([told[name][i] for i in rest])
    tables = [
        pq.read_table(p / "meta" / "episodes" / "chunk-000" / "file-000.parquet")
        for p in (path, new.path)
    ]
    for name in tables[0].column_names:
        before, after = (repr(table[name].to_pylist()) for table in tables)
        assert (before == after) == (not name.startswith("stats/") or name.endswith("count"))
        for row in (0, 2):
            assert repr(tables[0][name][row].as_py()) == repr(tables[1][name][row].as_py())
    least = tables[1]["stats/action/min"][1].as_py()
    assert np.allclose(np.array(least)[both], new.episodes[1].q.min(axis=0)[:4], atol=1e-12)
    # a file in which nothing moved is the old one
    for name, same in (("file-000", False), ("file-001", True)):
        one, two = (p / "data" / "chunk-000" / f"{name}.parquet" for p in (path, new.path))
        assert (one.read_bytes() == two.read_bytes()) == same


def test_another_column_may_hold_the_joints(tmp_path):
    path = made.lerobot(tmp_path)
    layout = open_layout(path, robot(), column="observation.state")
    layout.write(beside(path), [moved(one) for one in layout.episodes])
    again = open_layout(beside(path), robot())
    assert np.array_equal(again.episodes[0].q, motion().astype("f4").astype(float))
    refused(path, "no column 'qpos'", "action, observation.state", column="qpos")
    refused(made.gmr(tmp_path), "of LeRobot's folders alone", column="action")


def edited(path, change):
    file = path / "meta" / "info.json"
    tree = json.loads(file.read_text())
    change(tree)
    file.write_text(json.dumps(tree))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.update(codebase_version="v2.1"), ("'v2.1', read is v3", "v21_to_v30")),
        (lambda t: t.pop("codebase_version"), ("read is v3",)),
        (lambda t: t.pop("features"), ("has no 'features'",)),
        (lambda t: t.update(fps="30"), ("fps is '30'",)),
        (lambda t: t.update(fps=0), ("a rate of 0.0 Hz",)),
        (lambda t: t["features"]["action"].update(names=None), ("without names", "--joints")),
        (lambda t: t["features"]["action"].update(shape=[3]), ("has 3 columns for 30",)),
        (lambda t: t["features"]["action"].update(shape="x"), ("wanted [joints]",)),
        (lambda t: t["features"]["action"]["names"].__setitem__(0, "left_gripper.pos"),
         ("two columns of 'action'",)),
        (lambda t: t["features"]["action"]["names"].__setitem__(12, "waist_yaw_jonit.pos"),
         ("'waist_yaw_joint' of g1 is missing; is it 'waist_yaw_jonit.pos'?",)),
    ],
)  # fmt: skip
def test_an_info_that_does_not_say_what_is_wanted_is_refused(tmp_path, change, words):
    path = made.lerobot(tmp_path)
    edited(path, change)
    refused(path, *words)


def test_names_may_stand_under_a_word_of_their_own(tmp_path):
    path = made.lerobot(tmp_path)
    edited(path, lambda t: t["features"]["action"].update(
        names={"motors": t["features"]["action"]["names"]}))  # fmt: skip
    assert len(open_layout(path, robot()).episodes) == 3


def test_damaged_data_sets_are_refused(tmp_path):
    path = made.lerobot(tmp_path)
    data = path / "data" / "chunk-000" / "file-001.parquet"
    table = pq.read_table(data)
    pq.write_table(table.set_column(4, "episode_index", [[0] * ROWS]), data)
    refused(path, "file-001.parquet: row 0: episode 0 begins a second time")
    pq.write_table(table.drop_columns(["timestamp"]), data)
    refused(path, "file-001.parquet: has no column 'timestamp'")
    data.write_bytes(b"PAR1 and no more")
    refused(path, "file-001.parquet: is no sound Parquet")
    (path / "meta" / "info.json").write_text("{")
    refused(path, "info.json: is no JSON")
    refused(path / "meta", "no LeRobot data set")


def test_an_episode_with_times_of_its_own_keeps_them(tmp_path):
    path = made.lerobot(tmp_path)
    data = path / "data" / "chunk-000" / "file-001.parquet"
    table = pq.read_table(data)
    own = (TIME * 1.5).astype("f4")
    pq.write_table(table.set_column(2, "timestamp", [own]), data)
    layout = open_layout(path, robot())
    assert np.array_equal(layout.episodes[2].time, own.astype(float))
    assert "their own times are taken" in layout.episodes[2].notes[1]
    assert np.array_equal(layout.episodes[0].time, TIME)


def test_a_data_set_is_written_whole_or_not_at_all(tmp_path):
    path = made.lerobot(tmp_path)
    layout = open_layout(path, robot())
    wanted = [moved(one) for one in layout.episodes]
    with pytest.raises(TrajectoryError, match="lies in the data set"):
        layout.write(path / "sub", wanted)
    (tmp_path / "taken").mkdir()
    with pytest.raises(TrajectoryError, match="is there and is no LeRobot data set"):
        layout.write(tmp_path / "taken", wanted)
    table = pq.read_table(path / "data" / "chunk-000" / "file-001.parquet")
    other = table.set_column(1, "action", table["observation.state"].take(list(range(ROWS))[::-1]))
    pq.write_table(other, path / "data" / "chunk-000" / "file-001.parquet")
    with pytest.raises(TrajectoryError, match="file-001.parquet: has changed since it was read"):
        layout.write(tmp_path / "new", wanted)
    assert {p.name for p in tmp_path.iterdir()} == {"set", "taken"}
    # somebody was stopped between two steps of an exchange: nothing is lost
    path.rename(tmp_path / ".set.old")
    with pytest.raises(FileNotFoundError):
        layout.write(path, wanted)
    assert (tmp_path / ".set.old").is_dir() or path.is_dir()


def test_links_in_a_data_set_become_files(tmp_path):
    path = made.lerobot(tmp_path)
    (path / "videos").rename(tmp_path / "elsewhere")
    os.symlink(tmp_path / "elsewhere", path / "videos")
    layout = open_layout(path, robot())
    layout.write(tmp_path / "new", [one.q for one in layout.episodes])
    copy = tmp_path / "new" / "videos" / "front" / "file-000.mp4"
    assert copy.read_bytes() == bytes(range(256)) and not copy.parent.parent.is_symlink()
    os.symlink(path, path / "loop")
    with pytest.raises(TrajectoryError, match="is a link in a circle"):
        layout.write(tmp_path / "newer", [one.q for one in layout.episodes])
    assert not (tmp_path / "newer").exists()
