"""Coverage: equal to a double loop, monotone in rows, deterministic, and loud about bad input."""

import numpy as np
import pytest
from worlds import coman, inside_limits, relaxed

from s3le.errors import ParameterError
from s3le.kernels import batch
from s3le.study import coverage
from s3le.study.coverage import compare, distances, draw_pool
from s3le.tuples.samplers import SAMPLERS

NONE = np.empty((0, 21))
FLOAT32 = 1e-6  # [-], the nearest row is found in single precision


def skeletons(n, seed):
    made = coman()
    return batch.skeletons(made.chain, inside_limits(made, n, seed))


def by_hand(x, humans):
    """Mean over bones of 1 - cos, for every pair, then the least: a double loop."""
    best = []
    for human in humans.reshape(-1, 7, 3):
        every = [np.mean([1 - a @ b for a, b in zip(row, human, strict=True)]) for row in
                 x.reshape(-1, 7, 3)]  # fmt: skip
        best.append(min(every))
    return np.array(best)


@pytest.mark.parametrize(("n", "m"), [(1, 1), (1, 5), (60, 1), (200, 40)])
def test_distances_equal_a_double_loop(n, m):
    x, humans = skeletons(n, 1), skeletons(m, 2)
    np.testing.assert_allclose(distances(x, humans), by_hand(x, humans), rtol=0, atol=FLOAT32)


def test_the_squared_distance_in_r21_is_fourteen_times_the_cosine_distance():
    x, humans = skeletons(1, 3), skeletons(50, 4)
    square = ((x - humans) ** 2).sum(axis=1)
    np.testing.assert_allclose(square / 14, distances(x, humans), rtol=0, atol=1e-12)


def test_a_stored_human_is_at_distance_zero():
    humans = skeletons(30, 5)
    found = distances(np.concatenate([skeletons(100, 6), humans]), humans)
    assert found.max() <= 1e-12


def test_more_rows_never_take_a_human_farther():
    x, humans = skeletons(400, 7), skeletons(50, 8)
    far = [distances(x[:n], humans) for n in (1, 20, 400)]
    assert (far[0] >= far[1] - FLOAT32).all() and (far[1] >= far[2] - FLOAT32).all()


@pytest.mark.parametrize("side", ["stored", "human"])
@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda x: x[:0], r"skeletons must have shape \(n, 21\), n > 0, got \(0, 21\)"),
        (lambda x: x[:, :18], r"skeletons must have shape \(n, 21\), n > 0, got \(9, 18\)"),
        (lambda x: x[0], r"skeletons must have shape \(n, 21\), n > 0, got \(21,\)"),
        (lambda x: np.where(np.arange(9)[:, None] == 4, np.nan, x), "skeleton 4 has not"),
        (lambda x: x * np.where(np.arange(9)[:, None] == 3, 2.0, 1.0), "skeleton 3 has not"),
    ],
    ids=["empty", "width", "vector", "nan", "length"],
)
def test_skeletons_that_cannot_be_compared_are_refused(side, damage, words):
    good = skeletons(9, 9)
    given = (damage(good), good) if side == "stored" else (good, damage(good))
    with pytest.raises(ParameterError, match=f"{side}.*{words}|{words}"):
        distances(*given)


def test_a_pool_is_certified_and_says_how_each_row_came_about():
    made = coman()
    pool = draw_pool(made, "uniform", 400, 0.2, 3)
    made.certifier().require(pool.q, made.margin)
    assert np.array_equal(pool.x, batch.skeletons(made.chain, pool.q))
    assert set(np.unique(pool.how)) <= {batch.SAME, batch.SOLVED, batch.FALLBACK}


def test_a_smaller_pool_is_the_beginning_of_a_larger_one():
    small, large = (draw_pool(coman(), "human", n, 0.2, 3) for n in (50, 200))
    assert all(np.array_equal(a, b[:50]) for a, b in zip(small, large, strict=True))


def test_the_comparison_has_a_row_for_every_sampler_split_and_size():
    humans = {"a": skeletons(20, 10), "b": skeletons(5, 11)}
    done = []
    table = compare(coman(), humans, ["uniform", "rest"], [100, 30], 0.2, 5, NONE, done.append)
    keys = [(row["sampler"], row["rows"], row["split"]) for row in table]
    want = [(s, n, p) for s in ("uniform", "rest") for n in (30, 100) for p in ("a", "b")]
    assert keys == want and sum(done) == 2 * 2 * 100
    pool = draw_pool(coman(), "rest", 100, 0.2, 5)
    found = by_hand(pool.x[:30], humans["b"])
    row = table[want.index(("rest", 30, "b"))]
    assert list(row) == [
        "sampler", "rows", "seed", "feasible", "fallback", "split", "mean", "p90"
    ]  # fmt: skip
    assert row["mean"] == pytest.approx(found.mean(), abs=FLOAT32)
    assert row["p90"] == pytest.approx(np.percentile(found, 90), abs=FLOAT32)
    assert row["feasible"] == (pool.how[:30] == batch.SAME).mean()
    assert row["fallback"] == (pool.how[:30] == batch.FALLBACK).mean()


def test_the_comparison_is_repeatable_by_seed_and_independent_of_threads(monkeypatch):
    asked = ({"a": skeletons(20, 12)}, ["arms", "human"], [150], 0.2)
    one = compare(coman(), *asked, 1, NONE)
    assert compare(coman(), *asked, 2, NONE) != one
    monkeypatch.setattr(batch, "workers", lambda: 3)
    monkeypatch.setattr(batch, "CHUNK", 64)
    assert compare(coman(), *asked, 1, NONE) == one


def test_skeletons_stored_beside_the_rows_count():
    humans = {"a": skeletons(20, 13)}
    row = compare(coman(), humans, ["uniform"], [30], 0.2, 1, humans["a"])[0]
    assert row["mean"] <= 1e-12 and row["rows"] == 30


def test_pools_of_one_seed_share_no_pose():
    one, two = (draw_pool(coman(), name, 50, 0.0, 1) for name in ("uniform", "rest"))
    assert not np.isin(one.q, two.q).all(axis=1).any()


@pytest.mark.parametrize(
    ("humans", "names", "sizes", "alpha", "words"),
    [
        ({}, ["uniform"], [10], 0.2, "there is no split to measure; give human skeletons"),
        ({"a": NONE}, ["uniform"], [10], 0.2, "human skeletons must have shape"),
        ("some", ["uniform"], [], 0.2, "row counts must be at least 1, got "),
        ("some", ["uniform"], [0, 10], 0.2, "row counts must be at least 1, got "),
        ("some", ["unifrom"], [10], 0.2, "did you mean uniform"),
        ("some", ["uniform"], [10], np.nan, "alpha must be finite"),
    ],
    ids=["no split", "no human", "no size", "size 0", "name", "alpha"],
)
def test_what_cannot_be_compared_is_refused(humans, names, sizes, alpha, words):
    humans = {"a": skeletons(3, 14)} if humans == "some" else humans
    with pytest.raises(ParameterError, match=words):
        compare(coman(), humans, names, sizes, alpha, 1, NONE)


def test_a_summary_is_mean_and_ninetieth_percentile():
    assert coverage.summary(np.arange(11.0)) == {"mean": 5.0, "p90": 9.0}


def test_relaxed_rows_take_no_part_only_their_projections():
    made = coman()
    pool = draw_pool(made, "uniform", 200, 2.0, 3)
    assert (pool.q >= made.lower).all() and (pool.q <= made.upper).all()
    assert not (relaxed(made, 200, 1, 2.0) <= made.upper).all()


def test_the_table_of_a_run_has_every_sampler_with_and_without_pairs_and_the_pairs_alone():
    frames = {
        "split": np.repeat(np.array(["train", "test", "heldout"], object), 20),
        "x": skeletons(60, 13),
    }
    pairs = skeletons(7, 14)
    rows = coverage.table(coman(), frames, pairs, 50, 0.2, 5)
    assert len(rows) == 2 * (2 * len(SAMPLERS) + 1)
    assert {row["split"] for row in rows} == {"test", "heldout"}  # nothing that was trained on
    by = {(row["split"], row["sampler"], row["pairs"]): row for row in rows}
    for split in ("test", "heldout"):
        for name in SAMPLERS:
            alone, both = by[split, name, 0], by[split, name, 7]
            assert both["mean"] <= min(alone["mean"], by[split, "none", 7]["mean"]) + FLOAT32
    want = distances(pairs, frames["x"][20:40]).mean()
    assert by["test", "none", 7]["mean"] == pytest.approx(want)
