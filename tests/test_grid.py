"""The grid of pools and metrics: its cells are the look-ups of the rows that they stand for."""

import numpy as np
import pytest
from test_bundle import a_model, an_index
from test_retarget import motion, stored
from worlds import coman

from s3le.errors import TableError
from s3le.learn import artifact, methods
from s3le.skeleton import cosine_distance
from s3le.study import comparison, grid


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """Stored poses of three sources under two models, and 30 frames of which 20 are heldout's."""
    q, x = stored()
    nets = {name: a_model(tmp_path_factory.mktemp(name), name) for name in ("lwl2", "s3le")}
    tables = np.array(methods.POOLS["all"])
    source = tables[np.minimum(np.arange(len(q)) // 20, 2)]
    held = {
        name: an_index(artifact.encode_q(net, q)) | {"source": source}
        for name, (_, net) in nets.items()
    }
    n = 30
    frames = {
        "split": np.repeat(["test", "heldout"], [10, 20]).astype(object),
        "clip": np.full(n, "a", object), "frame": np.arange(n), "x": motion()[:n],
    }  # fmt: skip
    truth = {"clip": frames["clip"], "frame": frames["frame"], "x": x[:n]}
    return frames, truth, held, {name: path for name, (path, _) in nets.items()}


def test_every_cell_is_there_once_for_each_split(world):
    rows = grid.table(coman(), *world)
    assert len(rows) == 2 * len(grid.CELLS) == 2 * (3 + 2 * 3 * 5)
    keys = [(row["split"], row["model"], row["pool"], row["metric"]) for row in rows]
    assert len(set(keys)) == len(keys)
    assert {row["frames"] for row in rows if row["split"] == "heldout"} == {20}
    whole = len(world[2]["s3le"]["q"])
    assert {(row["pool"], row["stored"]) for row in rows} == {
        ("pairs", 20), ("poses", 40), ("all", whole)
    }  # fmt: skip


@pytest.mark.parametrize(("name", "pool"), [("lwl2_pairs", "pairs"), ("lwl2_all", "all")])
@pytest.mark.parametrize("metric", ["l2", "mahalanobis"])
def test_a_cell_is_what_its_row_of_the_comparison_returns(world, name, pool, metric):
    frames, truth, held, paths = world
    at = np.isin(held["lwl2"]["source"], methods.POOLS[pool])
    part = {column: values[at] for column, values in held["lwl2"].items()}
    entry = methods.entry(name)
    assert entry.pool == methods.POOLS[pool]
    answered = comparison.stored(coman(), entry, frames["x"], part, paths["lwl2"], metric)
    far = cosine_distance(part["x"][answered.row], truth["x"])
    for row in grid.table(coman(), *world):
        if (row["model"], row["pool"], row["metric"]) == ("lwl2", pool, metric):
            own = frames["split"] == row["split"]
            assert row["to_truth"] == pytest.approx(far[own].mean(), abs=1e-12)


def test_brute_force_looks_among_skeletons(world):
    frames, _, held, _ = world
    x = held["s3le"]["x"]
    best = np.array([cosine_distance(x, np.tile(h, (len(x), 1))).min() for h in frames["x"]])
    found = {
        row["split"]: row["to_human"]
        for row in grid.table(coman(), *world)
        if (row["model"], row["pool"]) == ("skeleton", "all")
    }
    for split, value in found.items():
        assert value == pytest.approx(best[frames["split"] == split].mean(), abs=1e-6)


def test_a_pool_that_is_not_stored_has_no_row(world):
    frames, truth, held, paths = world
    left = {
        name: {c: v[columns["source"] != "mocap_pairs"] for c, v in columns.items()}
        for name, columns in held.items()
    }
    rows = grid.table(coman(), frames, truth, left, paths)
    assert {row["pool"] for row in rows} == {"poses", "all"}


def test_another_order_of_frames_is_refused(world):
    frames, truth, held, paths = world
    with pytest.raises(TableError, match="hold different frames"):
        grid.table(coman(), frames, truth | {"frame": truth["frame"][::-1]}, held, paths)
