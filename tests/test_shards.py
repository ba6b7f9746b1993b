"""Shards of the two tables that come from the robot alone: certified, repeatable, resumable."""

import io
import json
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from worlds import MARGIN, coman

from s3le.errors import ParameterError, RobotError, TableError
from s3le.kernels import batch
from s3le.robot.robot import Robot
from s3le.store import tables
from s3le.tuples.engine import key, run
from s3le.tuples.engine.task import Job
from s3le.tuples.samplers import SAMPLERS
from s3le.tuples.sampling import relaxed_limits
from s3le.tuples.shards import PoseShards, TupleShards
from s3le.tuples.tables import kinematic_pairs, robot_poses

TUPLES, POSES = kinematic_pairs(11, MARGIN), robot_poses(11, MARGIN)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("robot")
    coman().write(folder)
    return Robot.read(folder).to_bytes()


def tuple_task(files, **other):
    given = {
        "alpha": 0.2, "renormalise_mix": False, "seed": 7, "shard_rows": 300,
        "sampler": "uniform",
    }  # fmt: skip
    return TupleShards(files=files, **given | other)


def pose_task(files, **other):
    return PoseShards(files=files, **{"seed": 7, "shard_rows": 300} | other)


def frame(made):
    return pl.read_parquet(io.BytesIO(made.data))


def columns(made):
    return {name: series.to_numpy() for name, series in frame(made).to_dict().items()}


@pytest.mark.parametrize(("task", "table"), [(tuple_task, TUPLES), (pose_task, POSES)])
def test_a_shard_keeps_its_table_s_contract_and_is_certified(files, task, table):
    made = task(files).make(Job(2, 300))
    table.check(frame(made))
    rows = columns(made)
    assert rows["row"].tolist() == list(range(600, 900))
    q = rows["q_feasible"] if "q_feasible" in rows else rows["q"]
    report = coman().certifier().require(q, MARGIN)
    assert np.array_equal(report.clearance, rows["clearance"])
    assert made.counts["rows"] == 300


@pytest.mark.parametrize("task", [tuple_task, pose_task])
def test_fewer_rows_of_a_shard_are_the_first_of_it(files, task):
    whole, part = (frame(task(files).make(Job(1, n))) for n in (300, 77))
    assert whole.head(77).equals(part)


@pytest.mark.parametrize("task", [tuple_task, pose_task])
def test_a_shard_is_repeatable_and_no_two_are_alike(files, task):
    first, again, second = (task(files).make(Job(number, 50)).data for number in (0, 0, 1))
    assert first == again
    assert first != second
    assert first != task(files, seed=8).make(Job(0, 50)).data


def test_relaxed_poses_fill_the_relaxed_box_and_no_more(files):
    robot = coman()
    q = columns(tuple_task(files, shard_rows=3000).make(Job(0, 3000)))["q_relaxed"]
    lower, upper = relaxed_limits(robot.lower, robot.upper, 0.2)
    assert (q >= lower).all() and (q <= upper).all()
    share = (q - lower) / (upper - lower)
    assert np.allclose(share.mean(axis=0), 0.5, atol=5 / np.sqrt(12 * 3000))  # five sigma
    assert ((q < robot.lower) | (q > robot.upper)).mean() == pytest.approx(0.2 / 1.2, abs=0.01)


def test_counts_of_a_shard_are_those_of_its_rows(files):
    made = tuple_task(files).make(Job(0, 300))
    rows = columns(made)
    counts = made.counts
    assert counts["feasible"] + counts["solved"] + counts["fallback"] == 300
    assert counts["feasible"] == (rows["projection"] == "feasible already").sum()
    clipped = np.clip(rows["q_relaxed"], coman().lower, coman().upper)
    moved = np.linalg.norm(rows["q_feasible"] - clipped, axis=1)
    collided = batch.clearances(coman().chain, clipped) < MARGIN
    assert counts["collided"] == collided.sum()
    assert counts["moved_rad"] == pytest.approx(moved[collided].sum())


@pytest.mark.parametrize("workers", [1, 2], ids=str)
def test_a_table_in_shards_reads_like_one(files, tmp_path, workers):
    task, out = tuple_task(files), tmp_path / "out"
    run.produce(task, 700, out, run.Where(workers=workers), lambda *_: 0, print, tmp_path / "s")
    rows = tables.read(TUPLES, out, coman().tag)
    assert rows["row"].tolist() == list(range(700))
    for number, first in ((0, 0), (1, 300), (2, 600)):
        part = columns(task.make(Job(number, min(300, 700 - first))))
        for name, values in part.items():
            assert np.array_equal(rows[name][first : first + len(values)], values)
    assert tables.read(TUPLES, out, columns=["mix"]).keys() == {"mix"}


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_shards_of_every_sampler_are_certified_and_a_prefix_is_a_prefix(files, sampler):
    task = tuple_task(files, sampler=sampler, shard_rows=120)
    whole, part = (frame(task.make(Job(1, n))) for n in (120, 50))
    TUPLES.check(whole)
    assert whole.head(50).equals(part)


# --- every parameter is in the key


@pytest.mark.parametrize(
    "other",
    [{"alpha": 0.3}, {"renormalise_mix": True}, {"seed": 8}, {"shard_rows": 301},
     {"sampler": "rest"}],
    ids=str,
)  # fmt: skip
def test_each_parameter_is_another_key(files, other):
    own = key.fingerprint(tuple_task(files))
    assert key.key(tuple_task(files), own) != key.key(tuple_task(files, **other), own)


def test_another_robot_is_another_key(files):
    own = key.fingerprint(tuple_task(files))
    changed = tuple((name, data + b" ") for name, data in files)
    assert key.key(tuple_task(files), own) != key.key(tuple_task(changed), own)


def test_what_the_manifest_says_is_the_same_wherever_the_rows_were_made(files):
    note = tuple_task(files).note()
    assert note["robot"] == coman().tag and note["parameters"]["alpha"] == 0.2
    assert not {"code", "processor", "key"} & json.loads(json.dumps(note)).keys()


# --- refusals


@pytest.fixture(scope="module")
def first(files, tmp_path_factory):
    out = tmp_path_factory.mktemp("first") / "out"
    run.produce(pose_task(files), 700, out, run.Where(), lambda *_: 0, print, out.parent / "shelf")
    return out


@pytest.fixture
def made(first, tmp_path):
    """A table in shards that a test may spoil."""
    return shutil.copytree(first, tmp_path / "out")


def refusal(out: Path) -> str:
    with pytest.raises(TableError) as error:
        tables.read(POSES, out, coman().tag)
    text = str(error.value)
    assert "\n" not in text and text.endswith("write it with: dvc repro poses")
    return text


def rewrite(out: Path, change) -> None:
    manifest = json.loads((out / "manifest.json").read_text())
    change(manifest)
    (out / "manifest.json").write_text(json.dumps(manifest))


def lies_about_its_last_shard(manifest):
    manifest["shards"][-1]["rows"] = 10**15
    manifest["rows"] = sum(shard["rows"] for shard in manifest["shards"])


def test_an_edited_shard_is_refused(made):
    part = made / "part-000001.parquet"
    data = bytearray(part.read_bytes())
    data[len(data) // 2] ^= 1
    part.write_bytes(data)
    assert f"{part} is not what its manifest says (edited or damaged)" in refusal(made)


def test_a_missing_and_a_foreign_shard_are_refused(made):
    (made / "part-000001.parquet").rename(made / "part-000009.parquet")
    assert "part-000001.parquet is missing" in refusal(made)
    (made / "part-000009.parquet").rename(made / "part-000001.parquet")
    (made / "part-000007.parquet").write_bytes(b"x")
    assert "part-000007.parquet is not in the manifest" in refusal(made)


def test_shards_in_another_order_are_refused(made):
    rewrite(made, lambda manifest: manifest["shards"].reverse())
    assert "holds other rows than its manifest says" in refusal(made)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: m.update(robot="g1 123"), "was made for robot 'g1 123', this is 'coman"),
        (lambda m: m.update(table="index"), "is not about a 'robot_poses' table"),
        (lambda m: m.update(rows=701), "is no manifest of shards"),
        (lambda m: m.update(rows=700.0), "is no manifest of shards"),
        (lambda m: m["shards"][0].update(rows=300.0), "is no manifest of shards"),
        (lambda m: m["shards"][0].update(rows=float("inf")), "is no manifest of shards"),
        (lambda m: m["shards"][1].update(rows=-300), "is no manifest of shards"),
        (lies_about_its_last_shard, "do not fit into memory"),
        (lambda m: m.pop("shards"), "is no manifest of shards"),
        (lambda m: m["shards"][0].update(file="../x.parquet"), "is no manifest of shards"),
        (lambda m: m["shards"][0].pop("sha256"), "is no manifest of shards"),
    ],
    ids=["another robot", "another table", "rows", "rows no integer", "shard's rows no integer",
         "infinite rows", "negative rows", "rows beyond memory", "no shards", "path", "no hash"],
)  # fmt: skip
def test_a_manifest_of_something_else_is_refused(made, change, words):
    rewrite(made, change)
    assert words in refusal(made)


@pytest.mark.parametrize("text", ["", "{", "[]", "\x00"], ids=repr)
def test_a_manifest_that_is_none_is_refused(made, text):
    (made / "manifest.json").write_text(text)
    refusal(made)


def test_a_folder_without_a_manifest_is_refused(made):
    (made / "manifest.json").unlink()
    with pytest.raises(TableError, match=r"manifest.json is missing; write it with: dvc repro pos"):
        tables.read(POSES, made)


@pytest.mark.parametrize("alpha", [-0.1, np.nan, np.inf], ids=str)
def test_a_relaxation_that_is_none_is_refused(files, alpha):
    with pytest.raises(ParameterError, match="alpha must be finite and >= 0"):
        tuple_task(files, alpha=alpha).make(Job(0, 5))


def test_a_robot_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(TableError, match="write it with: dvc repro robot"):
        Robot.read(tmp_path)
    with pytest.raises(RobotError, match="not whole"):
        Robot.from_bytes(coman().to_bytes()[1:])
