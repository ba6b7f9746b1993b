"""The tree of numbers that a run is compared by: what each means, and that NaN counts as broken."""

import numpy as np
import pytest
from worlds import coman

from s3le.learn.methods import ENTRIES
from s3le.study import metrics

N = 4


def merged(**truth):
    figures = {"all": {"frames": N, "to_truth": 0.1, "proposed_by": "s3le"},
               "motions": {"a": {"to_truth": 0.1}}}  # fmt: skip
    columns = {
        "split": np.full(N, "test"), "clip": np.full(N, "a"), "to_human": np.arange(N) / 10.0,
        "clearance": np.full(N, 0.01), "limit_margin": np.full(N, 0.1),
    }  # fmt: skip
    stages = ("skeletons", "pair", "sample", "poses")
    counts = {name: {"clips": {}, "domain": {}} for name in stages}
    return metrics.merge(
        coman(), "cmu", counts, columns | truth, {name: {"test": figures} for name in ENTRIES}, [],
        {},
    )  # fmt: skip


@pytest.mark.parametrize("column, rate", [("clearance", "collision_rate"),
                                          ("limit_margin", "limit_rate")])  # fmt: skip
@pytest.mark.parametrize("value, share", [(-1e-9, 0.25), (-0.004, 0.25), (np.nan, 0.25), (0.0, 0)])
def test_a_truth_that_breaks_anything_by_any_amount_is_counted(column, rate, value, share):
    values = np.full(N, 0.01)
    values[1] = value
    tree, _, _ = merged(**{column: values})
    found = tree["splits"]["test"]["truth"]
    other = {"collision_rate": "limit_rate", "limit_rate": "collision_rate"}[rate]
    assert found[rate] == share and found[other] == 0.0
    assert found["to_human"] == pytest.approx(0.15)


def test_every_entry_has_its_row_in_every_table():
    tree, table, motions = merged()
    assert list(tree["splits"]["test"]["methods"]) == list(ENTRIES)
    assert [row["method"] for row in table] == [row["method"] for row in motions] == list(ENTRIES)
    assert tree["splits"]["test"]["frames"] == N and tree["splits"]["test"]["clips"] == 1
    assert tree["run"]["vectors"] == 7 and tree["run"]["margin_mm"] == 2.0
