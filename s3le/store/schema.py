"""What a table promises, and the check that holds it to its promise.

A rule is a polars expression that is true for a good row. NaN and null fail every rule: polars
orders NaN above all numbers, so a bare `> 0` would let it through, and null counts as failure.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import polars as pl

from s3le.errors import TableError


class Column(NamedTuple):
    """One column: its polars type, its unit ("-" for none) and a sentence."""

    dtype: pl.DataType
    unit: str
    doc: str


@dataclass(frozen=True, kw_only=True)
class Table:
    """Contract of one Parquet table, checked when it is written and when it is read."""

    name: str
    stage: str  # the stage that writes it
    grain: str  # what one row is
    key: tuple[str, ...]
    columns: dict[str, Column]
    rules: dict[str, pl.Expr] = field(default_factory=dict)
    robot: bool = True  # made for one robot; carries and checks its digest

    def check(self, frame: pl.DataFrame) -> None:
        """Hold a frame against the contract.

        Raises:
            TableError: columns or types differ, the key repeats or is null, there is no row, or
                a rule fails; says how many rows and where the first one is.
        """
        made = f"written by stage '{self.stage}'"
        want = {name: column.dtype for name, column in self.columns.items()}
        have = dict(frame.schema)
        if have != want:
            for name in want.keys() - have.keys():
                raise TableError(f"{self.name}: column '{name}' is missing; {made}")
            for name in have.keys() - want.keys():
                raise TableError(f"{self.name}: unknown column '{name}'; {made}")
            for name, dtype in want.items():
                if have[name] != dtype:
                    raise TableError(f"{self.name}: '{name}' is {have[name]}, not {dtype}; {made}")
            raise TableError(f"{self.name}: columns are in another order; {made}")
        if frame.is_empty():
            raise TableError(f"{self.name}: no rows; {made}")
        for column in self.key:
            if frame[column].null_count():
                raise TableError(f"{self.name}: key column '{column}' has nulls; {made}")
        if frame.select(self.key).is_duplicated().any():
            twice = (
                frame.filter(frame.select(self.key).is_duplicated())
                .select(self.key)
                .row(0, named=True)
            )
            raise TableError(f"{self.name}: key {twice} occurs more than once; {made}")
        for rule, good in self.rules.items():
            passed = frame.select(good.fill_null(False).alias("ok"))["ok"]
            if not passed.all():
                bad = frame.filter(~passed)
                first = bad.select(self.key).row(0, named=True)
                raise TableError(
                    f"{self.name}: rule '{rule}' fails on {len(bad)} of {len(frame)} rows, "
                    f"first at {first}; {made}"
                )


def vector(n: int) -> pl.Array:
    """Type of a fixed-size float64 vector."""
    return pl.Array(pl.Float64, n)


def finite(column: str) -> pl.Expr:
    """True where every number of the (vector) column is finite."""
    return pl.col(column).arr.eval(pl.element().is_finite(), as_list=True).list.all()


def unit_bones(column: str) -> pl.Expr:
    """True where each of the seven bones in a skeleton column has length 1 within 1e-9."""
    ok = pl.lit(True)
    for bone in range(7):
        square = pl.lit(0.0)
        for axis in range(3):
            square = square + pl.col(column).arr.get(3 * bone + axis).pow(2)
        ok = ok & ((square.sqrt() - 1.0).abs() <= 1e-9) & square.is_finite()
    return ok


def at_least(column: str, bound: float) -> pl.Expr:
    """True where the column is a finite number of at least bound."""
    return (pl.col(column) >= bound) & pl.col(column).is_finite()


def certified(margin: float) -> dict[str, pl.Expr]:
    """The two rules of every feasible pose, on columns limit_margin and clearance."""
    return {
        "within_limits": at_least("limit_margin", 0.0),
        "collision_free": at_least("clearance", margin),
    }


CERTIFICATE = {
    "clearance": Column(pl.Float64(), "m", "least signed distance over the watched pairs, by coal"),
    "limit_margin": Column(pl.Float64(), "rad", "least distance to a joint limit"),
}
FRAME_KEY = {
    "split": Column(pl.String(), "-", "train, test or heldout"),
    "clip": Column(pl.String(), "-", "name of the clip"),
    "frame": Column(pl.Int32(), "-", "number of the frame in its clip, from 0"),
}
