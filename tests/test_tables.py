"""The data dictionary: rendered page, stages that write what they should, rules both ways."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from s3le.errors import TableError
from s3le.store.schema import Column, Table, at_least, finite, unit_bones, vector
from s3le.study.book import page, tables

ROOT = Path(__file__).parents[1]
ALL = tables(n_dof=11, margin=0.002, latent=32)


def test_the_page_of_tables_is_up_to_date():
    """Render it anew with: python -c "from s3le.study.book import *; print(page(tables(...)))"."""
    assert (ROOT / "docs" / "tables.md").read_text(encoding="utf-8") == page(ALL)


@pytest.mark.parametrize("table", ALL, ids=lambda t: t.name)
def test_every_column_has_a_unit_and_a_sentence(table):
    for column in table.columns.values():
        assert column.unit
        assert column.doc
    assert set(table.key) <= table.columns.keys()


def test_a_naive_rule_would_let_nan_through_and_ours_does_not():
    frame = pl.DataFrame({"clearance": [0.1, float("nan"), None, -0.1]})
    naive = frame.select(pl.col("clearance") > 0)["clearance"].to_list()
    ours = frame.select(at_least("clearance", 0.0).fill_null(False))["clearance"].to_list()
    assert naive == [True, True, None, False]  # polars orders NaN above every number
    assert ours == [True, False, False, False]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_finite_looks_at_every_number_of_a_vector(bad):
    values = np.zeros((3, 4))
    values[1, 3] = bad
    frame = pl.DataFrame({"q": pl.Series(values, dtype=vector(4))})
    assert frame.select(finite("q"))["q"].to_list() == [True, False, True]


def test_unit_bones_looks_at_every_bone():
    x = np.tile([0.0, 0.6, 0.8], (2, 7))
    x[1, 20] = 0.0
    frame = pl.DataFrame({"x": pl.Series(x, dtype=vector(21))})
    assert frame.select(unit_bones("x").alias("ok"))["ok"].to_list() == [True, False]


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        ({"a": [1]}, "column 'b' is missing"),
        ({"a": [1], "b": [1.0], "c": [1]}, "unknown column 'c'"),
        ({"a": [1.5], "b": [1.0]}, "'a' is Float64, not Int64"),
        ({"a": [None], "b": [1.0]}, "."),
    ],
    ids=["missing", "unknown", "type", "null key"],
)
def test_another_schema_is_refused(frame, words):
    table = Table(
        name="t",
        stage="s",
        grain="a row",
        key=("a",),
        columns={"a": Column(pl.Int64(), "-", "a"), "b": Column(pl.Float64(), "-", "b")},
    )
    with pytest.raises(TableError, match=words):
        table.check(pl.DataFrame(frame))
