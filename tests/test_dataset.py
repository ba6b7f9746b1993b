"""The data set beside the story of a run: off by default, one table, rerun by its limits alone."""

import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from dag import readers_and_reruns
from dvc.repo import Repo
from follower import Plain, led_by
from guarding import put
from handmade import bvh, write
from ruamel.yaml import YAML
from test_guard_clean import collides, colliding, lying, swaying
from test_house import ROBOTS, ROOT, STAGES, switched_on
from worlds import coman

from pipeline import dataset
from s3le.errors import CertificateError, TrajectoryError
from s3le.guard.layouts.door import open_layout
from s3le.guard.layouts.lerobot_new import Motion, create
from s3le.guard.table import guard, motions
from s3le.motion import files, trajectory
from s3le.safety import audit
from s3le.store import documents, tables

STAGE = STAGES["dataset"]["do"]
OUT, METRICS = Path("data/dataset/mine"), Path("reports/dataset-mine.json")


# --- what dvc is told


def turned_on(folder: Path, **more) -> None:
    """Write the project's params.yaml with a data set in it, as people do."""
    tree = YAML().load(folder / "params.yaml")
    tree["dataset"] = switched_on(**more)
    YAML().dump(tree, folder / "params.yaml")


def test_dvc_does_not_know_it_before_it_is_turned_on(tmp_path):
    Repo.init(str(tmp_path), no_scm=True).close()
    for name in ("dvc.yaml", "params.yaml"):
        shutil.copy(ROOT / name, tmp_path)
    with Repo(str(tmp_path)) as repo:
        assert not [one for one in repo.index.stages if one.name.startswith("dataset")]


def test_its_files_are_those_that_dvc_yaml_names():
    assert STAGE["outs"] == [str(OUT).replace("mine", "${key}")]
    assert list(STAGE["metrics"][0]) == [str(METRICS).replace("mine", "${key}")]
    assert {ROBOTS, "data/robots", "${item.folder}"} <= set(STAGE["deps"])


def test_its_limits_rerun_it_alone(tmp_path):
    Repo.init(str(tmp_path), no_scm=True).close()
    for name in ("dvc.yaml", "params.yaml"):
        shutil.copy(ROOT / name, tmp_path)
    turned_on(tmp_path)
    promised = readers_and_reruns(tmp_path)
    assert promised["dataset.mine"] == ({"dataset@mine"}, {"dataset@mine"})
    assert [key for key, (read, _) in promised.items() if "dataset@mine" in read] == [
        "executor", "workers", "ray_address", "dataset.mine",
    ]  # fmt: skip


# --- what it makes


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A folder like the project's, with motions of the robot."""
    put(tmp_path / "motions" / "a" / "bad.csv", colliding())
    put(tmp_path / "motions" / "good.parquet", swaying())
    shutil.copy(ROOT / "params.yaml", tmp_path)
    monkeypatch.chdir(tmp_path)
    asked(folder="motions", holds="motions")
    return tmp_path


def asked(**more):
    yaml, path = YAML(), Path("params.yaml")
    tree = yaml.load(path)
    tree["workers"] = 1
    tree["dataset"] = tree["dataset"] or switched_on()
    tree["dataset"]["mine"].update(more)
    yaml.dump(tree, path)


def made():
    robot = coman()
    return tables.read(motions(robot.n_dof, robot.margin), OUT / "motions.parquet", robot.tag)


def test_motions_become_one_table_that_holds(project):
    dataset.main("mine")
    rows = made()
    assert len(rows["row"]) == 120
    wanted = audit.demands(coman(), acceleration=60.0)
    for name in ("a/bad.csv", "good.parquet"):
        of = rows["file"] == name
        assert audit.audit(coman(), rows["time"][of], rows["q"][of], wanted).holds
    assert (rows["q"][rows["file"] == "good.parquet"] == swaying()).all()
    told = tables.read(guard(0.002), OUT / "guard.parquet", coman().tag)
    assert told["status"].tolist() == ["made certified", "made certified"]
    said = documents.read_json(METRICS, "dataset@mine")
    assert said["files"] == 2 and said["left_broken"] == 0 and said["broken_before"]["poses"] > 5
    names = tables.read_note(OUT / "motions.parquet", "joints", "dataset@mine")
    assert names.split(",") == coman().joint_names


def test_another_limit_is_kept_to(project):
    asked(acceleration=3.0)
    dataset.main("mine")
    rows = made()
    for name in ("a/bad.csv", "good.parquet"):
        q = rows["q"][rows["file"] == name]
        assert np.abs(np.diff(q, 2, axis=0)).max() * 30**2 <= 3.0 * (1 + 1e-6)


def test_clips_of_people_are_retargeted_first(project, monkeypatch):
    led_by(monkeypatch, Plain)
    still = bvh([[0.0] * 12] * 3 + [[0, 0, 0, 0, 0, 0, -5 * k, 0, 0, 0, 0, 0] for k in range(8)],
                order="ZXY", step=".033")  # fmt: skip
    write(project / "clips" / "one.bvh", still)
    write(project / "clips" / "odd.bvh", "HIERARCHY")
    asked(folder="clips", holds="clips", rate=60.0)
    dataset.main("mine")
    assert set(made()["file"]) == {"one.parquet"}
    assert np.allclose(np.diff(made()["time"]), 1 / 60)
    assert documents.read_json(METRICS, "")["clips_refused"] == 1


def test_what_has_no_motion_is_counted_and_left_out(project, monkeypatch, capsys):
    lying(monkeypatch, collides)
    dataset.main("mine")
    assert set(made()["file"]) == {"good.parquet"}
    assert documents.read_json(METRICS, "")["without_a_motion"] == 1
    assert "refused: " in capsys.readouterr().out
    Path("motions/good.parquet").unlink()
    with pytest.raises(CertificateError, match="none of 1 files has a motion that holds"):
        dataset.main("mine")


# --- in LeRobot's layout


def test_lerobots_folder_holds_in_its_own_numbers(project):
    asked(lerobot=True, acceleration=2.0)  # so low that rounding to float32 breaks it
    dataset.main("mine")
    came = open_layout(OUT / "lerobot", coman())
    assert [len(one.q) for one in came.episodes] == [60, 60]
    assert came.episodes[0].numbers.raw[0].dtype == np.float32
    wanted = audit.demands(coman(), acceleration=2.0)
    for one in came.episodes:
        assert audit.audit(coman(), one.time, one.q, wanted).holds
    said = documents.read_json(OUT / "lerobot.guard.json", "")
    assert said["certificate"]["holds"] and said["before"]["accelerations"]["broken"] > 0
    q = np.concatenate([one.q for one in came.episodes])
    stats = documents.read_json(OUT / "lerobot" / "meta" / "stats.json", "")["action"]
    assert np.allclose(stats["max"], q.max(axis=0)) and np.allclose(stats["std"], q.std(axis=0))


def test_lerobots_folder_has_one_rate(project):
    slow = trajectory.make("m", coman().joint_names, np.arange(60) / 20, swaying())
    files.write(slow, project / "motions" / "slow.csv")
    asked(lerobot=True)
    with pytest.raises(TrajectoryError, match="has one rate; .* steps of 0.0333333 to 0.05 s"):
        dataset.main("mine")


def test_a_new_lerobot_folder_says_where_its_episodes_lie(tmp_path):
    time = np.arange(60) / 30
    motions = [Motion("a", time, swaying()), Motion("b", time[:20], swaying(20)),
               Motion("a", time, colliding())]  # fmt: skip
    create(tmp_path / "set", motions, coman().joint_names, "coman")
    data = pl.read_parquet(tmp_path / "set" / "data" / "chunk-000" / "file-000.parquet")
    told = pl.read_parquet(
        tmp_path / "set" / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    )
    info = documents.read_json(tmp_path / "set" / "meta" / "info.json", "")
    assert (info["fps"], info["total_episodes"], info["total_frames"]) == (30, 3, 140)
    assert data["index"].to_list() == list(range(140))
    for row, motion in zip(told.iter_rows(named=True), motions, strict=True):
        of = data[row["dataset_from_index"] : row["dataset_to_index"]]
        assert row["tasks"] == [motion.task] and set(of["task_index"]) == {"ab".index(motion.task)}
        assert set(of["episode_index"]) == {row["episode_index"]} and row["length"] == len(of)
        assert (np.stack(of["action"].to_list()) == motion.q.astype("f4")).all()
        assert np.allclose(of["timestamp"], motion.time, atol=1e-6)
        assert np.allclose(row["stats/action/q50"], np.median(motion.q, axis=0), atol=1e-6)
