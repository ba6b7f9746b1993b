"""Near neighbours by a walk: held to the exact search, to equal bytes, to its refusals."""

import hashlib
import json
import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from handmade import SHARED, broken
from hypothesis import given, settings
from hypothesis import strategies as st

from s3le.errors import ModelError, ParameterError
from s3le.human import dataset
from s3le.human.read import read_clip
from s3le.kernels import batch
from s3le.kernels.threads import use_threads
from s3le.learn import artifact
from s3le.learn.table import index as index_table
from s3le.robot.robot import Robot
from s3le.search import neighbours
from s3le.search.metrics import METRICS, look_up
from s3le.store import tables
from s3le.tuples.sampling import relaxed_limits

ROOT = Path(__file__).parents[1]
NEAR = 1.01  # a found distance within 1 % of the true one counts as found
RECALL = 0.99


def cloud(n: int, d: int, seed: int = 0, curved: int = 4) -> np.ndarray:
    """Points on a curved surface of few dimensions, as latents of poses are."""
    rng = np.random.default_rng(seed)
    flat = rng.uniform(-1.0, 1.0, (n, curved))
    turn = np.random.default_rng(99).normal(size=(curved, d))
    return np.tanh(flat @ turn).astype(np.float32)


@pytest.fixture(scope="module")
def built():
    return neighbours.build(cloud(4000, 21))


@st.composite
def worlds(draw):
    """Few stored rows and queries, with everything that distances dislike."""
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    n, d = draw(st.integers(1, 400)), draw(st.integers(1, 40))
    z = rng.normal(size=(n, d))
    kind = draw(st.sampled_from(["plain", "doubles", "line", "one point", "ends", "grid"]))
    if kind == "doubles":
        z = z[rng.integers(max(n // 10, 1), size=n)]
    elif kind == "line":
        z = z[:, :1] * np.ones(d)
    elif kind == "one point":
        z[:] = z[0]
    elif kind == "ends":
        z[: n // 2, 0] += 1e6
    elif kind == "grid":
        z = np.rint(z)
    z = (z * draw(st.sampled_from([1e-20, 1e-3, 1.0, 1e15]))).astype(np.float32)
    far = draw(st.sampled_from([0.0, 1.0, 1e4]))
    queries = z[rng.integers(n, size=20)] + far * z.astype(float).std() * rng.normal(size=(20, d))
    return z, queries.astype(np.float32), draw(st.integers(1, min(n, 10)))


@given(worlds())
@settings(max_examples=60, deadline=None)
def test_what_is_found_is_stored_sorted_and_at_its_true_distance(world):
    z, queries, k = world
    found = neighbours.build(z).query(queries, k)
    apart = z[found.rows].astype(float) - queries[:, None].astype(float)
    np.testing.assert_allclose(found.distances, np.linalg.norm(apart, axis=2), rtol=1e-6)
    assert (np.diff(found.distances, axis=1) >= 0.0).all()
    assert all(len(set(rows)) == k for rows in found.rows.tolist())


@given(worlds())
@settings(max_examples=60, deadline=None)
def test_few_rows_are_searched_as_well_as_by_looking_at_all(world):
    z, queries, _ = world
    found = neighbours.build(z).query(queries, 1).distances[:, 0]
    _, true = look_up(z, queries, "l2")
    size = max(float(np.ptp(z.astype(float), axis=0).max()), 1e-30)
    # Codes tell rows apart to 1e-4 of the whole.
    assert (found <= NEAR * true + 1e-3 * size).mean() >= 0.9


@pytest.mark.parametrize(("n", "d"), [(4000, 21), (4000, 32), (3000, 3)])
def test_a_walk_finds_the_nearest_of_queries_off_the_surface(n, d):
    z = cloud(n, d)
    queries = cloud(500, d, seed=1) + np.random.default_rng(2).normal(0.0, 0.2, (500, d))
    queries = queries.astype(np.float32)
    found = neighbours.build(z).query(queries, 8)
    _, true = look_up(z, queries, "l2")
    assert (found.distances[:, 0] <= NEAR * true).mean() >= RECALL


def test_every_stored_row_finds_itself(built):
    z = cloud(4000, 21)
    found = built.query(z, 1)
    assert (found.distances[:, 0] == 0.0).mean() >= RECALL


@pytest.mark.parametrize("metric", METRICS)
def test_exact_is_the_exact_look_up_to_the_row(metric):
    z, queries = cloud(700, 5), cloud(50, 5, seed=1)
    z[100:200] = z[:100]  # ties go to the lowest row
    index = neighbours.build(z, metric, exact=True)
    assert "exact" in str(index)
    found = index.query(queries, 7)
    row, distance = look_up(z, queries, metric)
    np.testing.assert_array_equal(found.rows[:, 0], row)
    np.testing.assert_array_equal(found.distances[:, 0], distance)
    assert (np.diff(found.distances, axis=1) >= 0.0).all()


def test_l1_has_no_graph_and_says_so():
    index = neighbours.build(cloud(50, 4), "l1")
    assert index.graph is None and "l1, exact" in str(index)


def test_cosine_is_the_walk_among_unit_vectors():
    z, queries = cloud(3000, 8), 5.0 * cloud(300, 8, seed=1)
    index = neighbours.build(z, "cosine")
    assert "cosine, a walk" in str(index)
    found = index.query(queries, 4)
    _, true = look_up(z, queries, "cosine")
    assert (found.distances[:, 0] <= NEAR * true + 1e-6).mean() >= RECALL


def test_a_rebuild_gives_equal_bytes_on_any_number_of_threads(tmp_path):
    z = cloud(20_000, 8)  # so many that batches are shared out
    try:
        for threads in (1, 3):
            use_threads(threads)
            neighbours.build(z).save(tmp_path / f"{threads}")
    finally:
        use_threads(0)
    neighbours.load(tmp_path / "1").save(tmp_path / "again")
    first = (tmp_path / "1").read_bytes()
    assert first == (tmp_path / "3").read_bytes() == (tmp_path / "again").read_bytes()


@pytest.mark.parametrize(("metric", "exact"), [("l2", False), ("l2", True), ("l1", True),
                                               ("cosine", False), ("cosine", True)])  # fmt: skip
def test_a_loaded_index_answers_as_the_built_one(metric, exact, tmp_path):
    built = neighbours.build(cloud(900, 21), metric, exact)
    built.save(tmp_path / "index")
    again = neighbours.load(tmp_path / "index")
    assert str(again) == str(built)
    queries = cloud(100, 21, seed=1)
    was, now = built.query(queries, 5), again.query(queries, 5)
    np.testing.assert_array_equal(was.rows, now.rows)
    np.testing.assert_array_equal(was.distances, now.distances)


def test_threads_with_a_seeker_each_do_not_disturb_each_other(built):
    queries = cloud(2000, 21, seed=3)

    def work(part: np.ndarray) -> list[list[int]]:
        seek = built.seeker(6)
        return [seek(z)[0].tolist() for z in part]

    with ThreadPoolExecutor(4) as pool:
        rows = sum(pool.map(work, np.array_split(queries, 8)), [])
    assert rows == built.query(queries, 6).rows.tolist()


def test_a_seeker_answers_in_place_and_goes_on_after_a_refusal(built):
    seek = built.seeker(3)
    z = cloud(1, 21)[0]
    rows, distances = seek(z)
    assert rows is seek.rows and distances is seek.distances and rows[0] == 0
    with pytest.raises(ParameterError, match="query latent is not finite"):
        seek(np.full(21, np.nan))
    assert (rows == -1).all() and np.isinf(distances).all()
    assert seek(z)[0][0] == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("exact", [False, True], ids=["walk", "exact"])
def test_a_query_that_is_not_finite_in_float32_is_refused(bad, metric, exact):
    index = neighbours.build(cloud(50, 4), metric, exact)
    queries = cloud(3, 4).astype(float)
    queries[1, 2] = bad
    with pytest.raises(ParameterError, match="^query latent 1 is not finite$"):
        index.query(queries, 2)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda index: index.seeker(0), "k must be in 1..4000"),
        (lambda index: index.seeker(4001), "k must be in 1..4000"),
        (lambda index: index.seeker(9, width=8), "width must be in k..4096"),
        (lambda index: index.seeker(9, width=5000), "width must be in k..4096"),
        (lambda index: index.query(np.zeros((2, 20)), 1), "cannot search"),
        (lambda index: index.seeker(1)(np.zeros(20)), "query has shape"),
        (lambda index: neighbours.build(np.zeros((0, 3))), "cannot index"),
        (lambda index: neighbours.build(np.zeros(3)), "cannot index"),
        (lambda index: neighbours.build(np.full((2, 2), np.nan)), "stored latent 0 is not finite"),
        (lambda index: neighbours.build(np.zeros((2, 2)), "l3"), "metric must be one of"),
    ],
)
def test_what_cannot_be_searched_is_refused(built, call, words):
    with pytest.raises(ParameterError, match=words):
        call(built)


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    path = tmp_path_factory.mktemp("index") / "index"
    neighbours.build(cloud(60, 3)).save(path)
    return path.read_bytes()


def refused(path: Path, data: bytes) -> str:
    path.write_bytes(data)
    with pytest.raises(ModelError) as caught:
        neighbours.load(path)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)
    return str(caught.value)


def test_a_damaged_file_is_refused_in_one_line(stored, tmp_path):
    for data in broken(stored, 300, seed=5):
        if data != stored:
            refused(tmp_path / "index", data)
    for at in range(0, len(stored), 97):
        refused(tmp_path / "index", stored[:at])


@pytest.mark.parametrize(
    "data",
    [b"", b"PAR1 and so on", pickle.dumps([1, 2]), bytes(1000), b"s3le neighbours 2\n{}\n"],
    ids=["empty", "parquet", "pickle", "zeros", "a later format"],
)
def test_a_foreign_file_is_refused(data, tmp_path):
    assert "is no index of neighbours" in refused(tmp_path / "index", data)


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    with pytest.raises(ModelError, match="is missing; build it again"):
        neighbours.load(tmp_path / "none")
    with pytest.raises(ModelError, match="cannot be read"):
        neighbours.load(tmp_path)


@pytest.mark.parametrize(
    ("array", "value", "words"),
    [
        ("links", 60, "a link leads nowhere"),
        ("links", -2, "a link leads nowhere"),
        ("stored", np.nan, "not finite"),
    ],
)
def test_numbers_that_would_lead_a_walk_astray_are_refused_whatever_the_checksum(
    stored, tmp_path, array, value, words
):
    magic, head, body = stored.split(b"\n", 2)
    head = json.loads(head)
    numbers = np.frombuffer(body, np.float32 if array == "stored" else np.int32).copy()
    numbers[5 if array == "links" else -5] = value
    head["sha256"] = hashlib.sha256(numbers.tobytes()).hexdigest()
    forged = magic + b"\n" + json.dumps(head).encode() + b"\n" + numbers.tobytes()
    assert words in refused(tmp_path / "index", forged)


def test_a_head_of_brackets_is_refused(stored, tmp_path):
    assert "cannot be read" in refused(tmp_path / "index", b"s3le neighbours 1\n" + b"[" * 9000)


@pytest.mark.parametrize("shape", [[10**12, 10**12], [-60, 3], [60, -3], [60.0, 3], "60", [60]])
def test_a_head_that_promises_other_numbers_is_refused(stored, tmp_path, shape):
    magic, head, body = stored.split(b"\n", 2)
    head = json.dumps(json.loads(head) | {"shape": shape}).encode()
    assert "cannot be read" in refused(tmp_path / "index", b"\n".join((magic, head, body)))


def people() -> np.ndarray:
    """Skeletons of real motion at 4 Hz, or a skip."""
    files = sorted((SHARED / "cmu").glob("*/*.amc.gz"))
    if not files:
        pytest.skip("no recorded motion at hand")
    parts = [
        dataset.skeletons(read_clip(path).points[::30], "midpoint", np.radians(60.0)).x
        for path in files[::5]
    ]
    return np.concatenate(parts).astype(np.float32)


def test_people_find_the_nearest_pose_in_skeleton_space():
    x = people()
    it = Robot.from_file(ROOT / "s3le" / "robots" / "coman.yaml", 0.002, "midpoint")
    low, high = relaxed_limits(it.lower, it.upper, 0.2)
    q = np.random.default_rng(0).uniform(low, high, (10_000, it.n_dof))
    poses = batch.skeletons(it.chain, q).astype(np.float32)
    found = neighbours.build(poses).query(x, 8)
    _, true = look_up(poses, x, "l2")
    assert (found.distances[:, 0] <= NEAR * true).mean() >= RECALL


def test_people_find_the_nearest_pose_in_a_trained_latent_space():
    x = people()
    model, table = ROOT / "data" / "model-s3le.safetensors", ROOT / "data" / "index-s3le.parquet"
    if not model.is_file() or not table.is_file():
        pytest.skip("nothing trained at hand; dvc repro index@s3le")
    net, _ = artifact.load_model(model)
    z = artifact.encode_x(net, x)
    contract = index_table(net.sizes.dim_q, 0.002, net.sizes.latent)
    poses = tables.read(contract, table, columns=["z"])["z"][::4].astype(np.float32)
    found = neighbours.build(poses).query(z, 8)
    _, true = look_up(poses, z, "l2")
    assert (found.distances[:, 0] <= NEAR * true).mean() >= RECALL
