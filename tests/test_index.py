"""Exact look-up: equal to a plain argmin, ties to the lowest row, every metric."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from s3le.errors import ParameterError
from s3le.search.metrics import METRICS, look_up, to_skeletons


def plain(stored, queries, metric):
    stored, queries = stored.astype(float), queries.astype(float)
    if metric == "cosine":
        stored = stored / np.linalg.norm(stored, axis=1, keepdims=True)
        queries = queries / np.linalg.norm(queries, axis=1, keepdims=True)
    diff = queries[:, None] - stored[None]
    order = 1 if metric == "l1" else 2
    return np.linalg.norm(diff, ord=order, axis=2)


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize(("n", "m", "d"), [(1, 1, 1), (7, 40, 3), (3000, 50, 14)])
def test_the_row_is_the_nearest_one(metric, n, m, d):
    rng = np.random.default_rng(n)
    stored = rng.normal(size=(n, d)).astype(np.float32)
    queries = rng.normal(size=(m, d)).astype(np.float32)
    row, distance = look_up(stored, queries, metric)
    every = plain(stored, queries, metric)
    np.testing.assert_allclose(distance, every.min(axis=1), atol=1e-6)
    np.testing.assert_allclose(every[np.arange(m), row], every.min(axis=1), atol=1e-6)


@given(st.integers(0, 2**31), st.sampled_from(METRICS))
@settings(max_examples=30, deadline=None)
def test_ties_go_to_the_lowest_row(seed, metric):
    rng = np.random.default_rng(seed)
    few = rng.integers(-2, 3, size=(4, 3)).astype(np.float32) + 0.5
    stored = few[rng.integers(4, size=200)]
    row, _ = look_up(stored, few, metric)
    for query, found in zip(few, row, strict=True):
        same = np.flatnonzero((stored == stored[found]).all(axis=1))
        assert found == same[0]
        if (stored == query).all(axis=1).any() and metric != "cosine":
            assert (stored[found] == query).all()


@pytest.mark.parametrize("where", ["stored", "query"])
def test_a_latent_that_is_not_finite_is_refused(where):
    stored, queries = np.zeros((3, 2), np.float32), np.zeros((2, 2), np.float32)
    (stored if where == "stored" else queries)[1, 0] = np.nan
    with pytest.raises(ParameterError, match=f"{where} latent 1 is not finite"):
        look_up(stored, queries, "l2")


@pytest.mark.parametrize(
    ("stored", "queries", "metric", "words"),
    [
        (np.zeros((0, 2)), np.zeros((1, 2)), "l2", "cannot search"),
        (np.zeros((3, 2)), np.zeros((1, 3)), "l2", "cannot search"),
        (np.zeros((3, 2)), np.zeros((1, 2)), "l3", "metric must be one of l2, l1, cosine"),
    ],
    ids=["nothing stored", "another length", "unknown metric"],
)
def test_what_cannot_be_searched_is_refused(stored, queries, metric, words):
    with pytest.raises(ParameterError, match=words):
        look_up(stored, queries, metric)


def test_to_skeletons_finds_what_the_latents_tell_of_the_skeleton():
    rng = np.random.default_rng(3)
    z = rng.normal(size=(2000, 6)) * [1, 5, 1, 1, 1, 40]
    onto = np.vstack([rng.normal(size=(5, 21)), np.zeros((1, 21))])  # the widest says nothing
    x = z @ onto + 0.3
    found = to_skeletons(z.astype(np.float32), x)
    np.testing.assert_allclose(found[:5], onto[:5], rtol=0.05, atol=0.05)
    assert np.abs(found[5]).max() < 1e-3
    stored, query = z[:-1], z[-1:] + [0, 0, 0, 0, 0, 30.0]
    row, _ = look_up(*(v @ found for v in (stored, query)), "l2")
    true, _ = look_up(*(v @ onto for v in (stored, query)), "l2")
    assert row == true


@pytest.mark.parametrize("value", [0.0, 2.5])
def test_to_skeletons_of_latents_that_do_not_vary_is_zero(value):
    found = to_skeletons(np.full((10, 3), value), np.random.default_rng(0).normal(size=(10, 21)))
    assert np.isfinite(found).all() and np.abs(found).max() == 0.0
