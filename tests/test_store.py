"""Tables on disk: whole or not at all, self-explaining, and refused when they break a promise."""

import os
from pathlib import Path

import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from s3le.errors import TableError
from s3le.store import documents, tables
from s3le.tuples.tables import robot_poses

TABLE = robot_poses(n_dof=3, margin=0.002)
TAG = "arm 0123 margin=0.002 neck=midpoint"


def columns(n=3, **changes):
    up = np.tile([0.0, 0.0, 1.0], 7)
    base = {
        "row": np.arange(n, dtype=np.int32),
        "q": np.zeros((n, 3)),
        "x": np.tile(up, (n, 1)),
        "clearance": np.full(n, 0.01),
        "limit_margin": np.full(n, 0.1),
    }
    return base | changes


def test_what_is_written_is_read(tmp_path):
    path = tmp_path / "poses.parquet"
    tables.write(columns(), TABLE, path, TAG)
    for name, values in tables.read(TABLE, path, TAG).items():
        np.testing.assert_array_equal(values, columns()[name])
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_explains_itself(tmp_path):
    path = tmp_path / "poses.parquet"
    tables.write(columns(), TABLE, path, TAG)
    schema = pq.read_schema(path)
    assert schema.metadata[b"s3le.robot"].decode() == TAG
    assert schema.metadata[b"s3le.grain"] == b"one feasible pose, uniform over the feasible set"
    assert schema.field("clearance").metadata[b"unit"] == b"m"
    assert schema.field("q").metadata[b"doc"] == b"joint angles"


def test_the_same_rows_give_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        tables.write(columns(2000), TABLE, tmp_path / name, TAG)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@pytest.mark.parametrize("bad", [-0.1, 0.0, 0.0019, np.nan, -np.inf, np.inf])
@pytest.mark.parametrize("row", [0, 2])
def test_an_uncertified_clearance_is_refused_and_leaves_nothing(tmp_path, bad, row):
    clearance = np.full(3, 0.01)
    clearance[row] = bad
    with pytest.raises(TableError, match="rule 'collision_free' fails on 1 of 3 rows"):
        tables.write(columns(clearance=clearance), TABLE, tmp_path / "p", TAG)
    assert list(tmp_path.iterdir()) == []


def test_null_fails_a_safety_rule():
    frame = pl.DataFrame({k: pl.Series(v) for k, v in columns().items()}).with_columns(
        pl.Series("limit_margin", [0.1, None, 0.1])
    )
    with pytest.raises(TableError, match=r"rule 'within_limits' fails on 1 of 3 .*\{'row': 1\}"):
        TABLE.check(frame)


def test_a_pose_that_is_not_finite_is_refused(tmp_path):
    q = np.zeros((3, 3))
    q[1, 2] = np.nan
    with pytest.raises(TableError, match="rule 'pose_is_finite' fails on 1 of 3 rows"):
        tables.write(columns(q=q), TABLE, tmp_path / "p", TAG)


def test_bones_must_have_unit_length(tmp_path):
    x = columns()["x"] * (1 + 1e-8)
    with pytest.raises(TableError, match="rule 'unit_vectors' fails on 3 of 3 rows"):
        tables.write(columns(x=x), TABLE, tmp_path / "p", TAG)


def test_a_key_that_repeats_is_refused(tmp_path):
    with pytest.raises(TableError, match=r"key \{'row': 1\} occurs more than once"):
        tables.write(columns(row=np.array([0, 1, 1], np.int32)), TABLE, tmp_path / "p", TAG)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"q": np.zeros((3, 4))}, r"'q' has rows of \(4,\), not 3"),
        ({"extra": np.zeros(3)}, "columns row, q, x, clearance, limit_margin, extra given"),
        ({"row": np.zeros(0, np.int32)}, "."),
    ],
    ids=["width", "unknown column", "lengths differ"],
)
def test_another_shape_is_refused(tmp_path, change, words):
    with pytest.raises((TableError, pl.exceptions.ShapeError), match=words):
        tables.write(columns(**change), TABLE, tmp_path / "p", TAG)


def test_an_empty_table_is_refused(tmp_path):
    with pytest.raises(TableError, match="robot_poses: no rows; written by stage 'poses'"):
        tables.write(columns(0), TABLE, tmp_path / "p", TAG)


def test_a_table_of_another_robot_is_refused(tmp_path):
    path = tmp_path / "poses.parquet"
    tables.write(columns(), TABLE, path, TAG)
    with pytest.raises(TableError) as refusal:
        tables.read(TABLE, path, "g1 9876")
    assert str(refusal.value) == (
        f"{path} was made for robot '{TAG}', this is 'g1 9876'; write it with: dvc repro poses"
    )


def test_a_table_cannot_be_written_without_its_robot(tmp_path):
    with pytest.raises(TableError, match="cannot be written without naming its robot"):
        tables.write(columns(), TABLE, tmp_path / "p")


def test_a_missing_table_says_which_command_writes_it(tmp_path):
    with pytest.raises(TableError, match="is missing; write it with: dvc repro poses"):
        tables.read(TABLE, tmp_path / "none.parquet", TAG)


@pytest.mark.parametrize("damage", [b"", b"PAR1", b"not parquet at all"], ids=repr)
def test_a_damaged_file_is_refused(tmp_path, damage):
    path = tmp_path / "p.parquet"
    path.write_bytes(damage)
    with pytest.raises(TableError, match="not readable as Parquet"):
        tables.read(TABLE, path, TAG)


def test_a_truncated_file_is_refused(tmp_path):
    path = tmp_path / "p.parquet"
    tables.write(columns(500), TABLE, path, TAG)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(TableError, match="not readable as Parquet"):
        tables.read(TABLE, path, TAG)


def test_a_table_edited_by_hand_is_refused_when_read(tmp_path):
    path = tmp_path / "p.parquet"
    tables.write(columns(), TABLE, path, TAG)
    rows = pq.read_table(path)
    at = rows.schema.get_field_index("clearance")
    edited = rows.set_column(at, rows.schema.field(at), [[0.01, float("nan"), 0.01]])
    pq.write_table(edited, path)
    with pytest.raises(TableError, match="rule 'collision_free' fails on 1 of 3 rows"):
        tables.read(TABLE, path, TAG)


def test_no_flipped_bit_of_the_rows_goes_unseen(tmp_path):
    path = tmp_path / "p.parquet"
    q = np.random.default_rng(0).normal(size=(40, 3))
    tables.write(columns(40, q=q), TABLE, path, TAG)
    data = path.read_bytes()
    at = next(i for i in range(len(data)) if data[i : i + 8] == q[0, 0].tobytes())
    for bit in range(64):
        damaged = bytearray(data)
        damaged[at + bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        with pytest.raises(TableError, match="not readable as Parquet .*(CRC|checksum)"):
            tables.read(TABLE, path, TAG)


def test_a_rule_that_fails_in_a_file_names_the_file(tmp_path):
    path = tmp_path / "p.parquet"
    tables.write(columns(), TABLE, path, TAG)
    with pytest.raises(TableError) as refusal:
        tables.read(robot_poses(n_dof=3, margin=0.02), path, TAG)
    assert str(refusal.value).startswith(f"{path}: robot_poses: rule 'collision_free' fails on 3")


def test_words_about_a_column_that_are_no_text_do_no_harm(tmp_path):
    path = tmp_path / "p.parquet"
    tables.write(columns(), TABLE, path, TAG)
    rows = pq.read_table(path)
    fields = [field.with_metadata({b"unit": b"\xff\xfe"}) for field in rows.schema]
    pq.write_table(rows.cast(pa.schema(fields, rows.schema.metadata)), path)
    assert tables.read(TABLE, path, TAG).keys() == columns().keys()


def test_a_full_disk_keeps_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "p.parquet"
    tables.write(columns(3), TABLE, path, TAG)
    before = path.read_bytes()

    def full(*_args, **_kw):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        tables.write(columns(4), TABLE, path, TAG)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("value", [float("nan"), float("inf"), {1, 2}], ids=str)
def test_json_takes_only_finite_numbers(tmp_path, value):
    with pytest.raises(TableError, match="not writable as JSON"):
        documents.write_json({"a": value}, tmp_path / "m.json")


@pytest.mark.parametrize(
    "text", ["", "[1]", "{", '{"a": 1, "a": 2}', "[" * 100_000, '{"a": ' + "9" * 5000 + "}"],
    ids=["empty", "list", "open", "twice", "deep", "endless"],
)  # fmt: skip
def test_damaged_json_is_refused(tmp_path, text):
    path = tmp_path / "m.json"
    path.write_text(text)
    with pytest.raises(TableError, match="JSON"):
        documents.read_json(path, "metrics")


def test_csv_comes_back(tmp_path):
    rows = [{"step": 50, "loss": 1.5}, {"step": 100, "loss": 0.25}]
    documents.write_csv(rows, tmp_path / "h.csv")
    assert documents.read_csv(tmp_path / "h.csv", "train@s3le") == rows
    with pytest.raises(TableError, match="dvc repro train@s3le"):
        documents.read_csv(Path("none.csv"), "train@s3le")
