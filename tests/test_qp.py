"""The quadratic program solver against two others, and in the corners of its job."""

import daqp
import numpy as np
import pytest
from scipy.optimize import minimize, nnls

from s3le.kernels.qp import INFEASIBLE, SOLVED, inverse_factor, solve

SOLUTION = 1e-8  # [-], on s of size one
ALGEBRA = 1e-10  # [-], what the solver itself calls satisfied
BIG = 1e30


def ours(H, g, lower, upper, G, h):
    """Status, solution and the largest multiplier of a row."""
    n, m = len(g), len(h)
    J, s, most = np.empty((n, n)), np.full(n, np.nan), np.zeros(1)
    assert inverse_factor(np.ascontiguousarray(H, float), J)
    g, lower, upper, h = (np.ascontiguousarray(v, float) for v in (g, lower, upper, h))
    rows = np.ascontiguousarray(G, float).reshape(m, n)
    return solve(J, g, lower, upper, rows, h, m, s, most), s, most[0]


def by_daqp(H, g, lower, upper, G, h):
    """Exit flag (1: solved, -1: infeasible) and solution."""
    s, _, flag, _ = daqp.solve(
        H.copy(),
        g.copy(),
        np.ascontiguousarray(G),
        np.concatenate([upper, np.full(len(h), BIG)]),
        np.concatenate([lower, h]),
        primal_tol=1e-11,
    )
    return flag, np.array(s)


def by_scipy(H, g, lower, upper, G, h):
    rows = {"type": "ineq", "fun": lambda s: G @ s - h, "jac": lambda s: G}
    return minimize(
        lambda s: 0.5 * s @ H @ s + g @ s,
        (lower + upper) / 2,
        jac=lambda s: H @ s + g,
        bounds=np.stack([lower, upper], axis=1),
        constraints=[rows] if len(h) else [],
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 300},
    ).x


def program(seed, n=None, m=None):
    """A random program with a feasible point, bounds and rows often active."""
    rng = np.random.default_rng(seed)
    n = n or int(rng.integers(1, 14))
    m = int(rng.integers(0, 30)) if m is None else m
    half = rng.normal(size=(n, n))
    H = half @ half.T + 10.0 ** rng.uniform(-2, 1) * np.eye(n)
    inside = rng.uniform(-0.5, 0.5, n)
    lower, upper = inside - rng.uniform(0.05, 1, n), inside + rng.uniform(0.05, 1, n)
    G = rng.normal(size=(m, n))
    return H, 3.0 * rng.normal(size=n), lower, upper, G, G @ inside - rng.uniform(0.0, 0.4, m)


def assert_optimal(H, g, lower, upper, G, h, s):
    """Karush-Kuhn-Tucker: feasible, and the slope is a non-negative mix of active normals."""
    assert (s >= lower - ALGEBRA).all() and (s <= upper + ALGEBRA).all()
    assert (G @ s - h >= -1e-9).all()
    eye = np.eye(len(g))
    active = [eye[s <= lower + SOLUTION], -eye[s >= upper - SOLUTION], G[G @ s - h <= 1e-7]]
    normals, slope = np.concatenate(active), H @ s + g
    rest = nnls(normals.T, slope)[1] if len(normals) else np.linalg.norm(slope)
    assert rest < 1e-6 * (1.0 + np.linalg.norm(slope))


@pytest.mark.parametrize("seed", range(60))
def test_random_programs_are_solved_as_daqp_solves_them(seed):
    given = program(seed)
    status, s, _ = ours(*given)
    flag, theirs = by_daqp(*given)
    assert status == SOLVED and flag == 1
    assert np.allclose(s, theirs, rtol=0, atol=SOLUTION)
    assert_optimal(*given, s)


@pytest.mark.parametrize("seed", range(100, 115))
def test_random_programs_are_solved_no_worse_than_scipy_solves_them(seed):
    H, g, *rest = program(seed)
    _, s, _ = ours(H, g, *rest)
    theirs = by_scipy(H, g, *rest)
    cost = [0.5 * v @ H @ v + g @ v for v in (s, theirs)]
    assert cost[0] <= cost[1] + SOLUTION
    assert np.allclose(s, theirs, rtol=0, atol=1e-4)  # SLSQP's own accuracy


def test_a_program_without_active_constraints_is_a_linear_solve():
    H, g, *_ = program(1, n=8, m=0)
    far, none = np.full(8, BIG), (np.empty((0, 8)), np.empty(0))
    status, s, most = ours(H, g, -far, far, *none)
    assert status == SOLVED and most == 0.0
    assert np.allclose(s, -np.linalg.solve(H, g), rtol=0, atol=SOLUTION)


def test_infinite_bounds_are_no_bounds():
    H, g, *_ = program(2, n=5, m=0)
    far = np.full(5, np.inf)
    status, s, _ = ours(H, g, -far, far, np.empty((0, 5)), np.empty(0))
    assert status == SOLVED
    assert np.allclose(s, -np.linalg.solve(H, g), rtol=0, atol=SOLUTION)


def test_the_nearest_point_of_a_box_is_the_clipped_point():
    want = np.array([-3.0, -0.2, 0.0, 0.4, 9.0])
    one = np.ones(5)
    status, s, _ = ours(np.eye(5), -want, -one, one, np.empty((0, 5)), np.empty(0))
    assert status == SOLVED
    assert np.array_equal(s, np.clip(want, -1, 1))


def test_bounds_that_meet_leave_no_choice():
    H, g, lower, upper, G, h = program(3, n=6, m=0)
    lower[2] = upper[2] = 0.125
    status, s, _ = ours(H, g, lower, upper, G, h)
    assert status == SOLVED
    assert s[2] == pytest.approx(0.125, abs=ALGEBRA)
    assert_optimal(H, g, lower, upper, G, h, s)


@pytest.mark.parametrize("seed", range(200, 212))
@pytest.mark.parametrize(
    "again",
    [lambda G, h: (G, h), lambda G, h: (3.0 * G, 3.0 * h), lambda G, h: (1e-6 * G, 1e-6 * h),
     lambda G, h: (G, h - 0.1), lambda G, h: (G * (1 + 1e-15), h)],
    ids=["the same", "scaled up", "scaled down", "looser", "one rounding away"],
)  # fmt: skip
def test_rows_that_say_the_same_twice_change_nothing(seed, again):
    H, g, lower, upper, G, h = program(seed, m=12)
    _, once, _ = ours(H, g, lower, upper, G, h)
    G2, h2 = again(G, h)
    status, twice, _ = ours(H, g, lower, upper, np.vstack([G, G2, G]), np.concatenate([h, h2, h]))
    assert status == SOLVED
    assert np.allclose(once, twice, rtol=0, atol=SOLUTION)


@pytest.mark.parametrize("seed", range(300, 306))
def test_rows_that_repeat_a_bound_change_nothing(seed):
    H, g, lower, upper, G, h = program(seed, m=5)
    _, want, _ = ours(H, g, lower, upper, G, h)
    eye = np.eye(len(g))
    rows, sides = np.vstack([G, eye, -eye]), np.concatenate([h, lower, -upper])
    status, s, _ = ours(H, g, lower, upper, rows, sides)
    assert status == SOLVED
    assert np.allclose(s, want, rtol=0, atol=SOLUTION)


@pytest.mark.parametrize("tilt", [1e-4, 1e-6, 1e-8, 1e-10, 1e-12])
@pytest.mark.parametrize("seed", range(400, 406))
def test_rows_that_are_nearly_the_same_are_all_kept(seed, tilt):
    H, g, lower, upper, G, h = program(seed, n=11, m=6)
    rng = np.random.default_rng(seed)
    rows = np.vstack([G, G + tilt * rng.normal(size=G.shape)])
    inside = (lower + upper) / 2
    sides = np.minimum(np.concatenate([h, h]), rows @ inside)
    status, s, _ = ours(H, g, lower, upper, rows, sides)
    assert status == SOLVED
    assert_optimal(H, g, lower, upper, rows, sides, s)


@pytest.mark.parametrize("seed", range(500, 510))
def test_more_active_constraints_than_unknowns_meet_in_one_point(seed):
    rng = np.random.default_rng(seed)
    corner = rng.normal(size=4)
    G = rng.normal(size=(20, 4))
    H, g = np.eye(4), -(corner - 5 * G.sum(axis=0))  # pulled against all the rows at once
    far = np.full(4, 100.0)
    status, s, _ = ours(H, g, -far, far, G, G @ corner)
    assert status == SOLVED
    assert_optimal(H, g, -far, far, G, G @ corner, s)


@pytest.mark.parametrize(
    ("lower", "upper", "G", "h"),
    [
        ((-1, -1), (1, 1), [(1, 0)], [1.5]),
        ((-1, -1), (1, 1), [(1, 1), (-1, -1)], [0.5, 0.0]),
        ((-1, -1), (1, 1), [(0, 0)], [0.1]),
        ((1, -1), (-1, 1), np.empty((0, 2)), []),
        ((-9, -9), (9, 9), [(1, 0), (0, 1), (-1, -1)], [1.0, 1.0, -1.9]),
        ((-1, -1), (1, 1), [(1, 0), (1, 1e-9), (-1, 0)], [0.2, 0.2, -0.1]),
    ],
    ids=["row against bound", "row against row", "empty row", "bounds reversed", "three rows",
         "near duplicates"],
)  # fmt: skip
def test_a_program_without_a_solution_is_called_infeasible(lower, upper, G, h):
    status, _, _ = ours(np.eye(2), np.zeros(2), lower, upper, G, h)
    assert status == INFEASIBLE


@pytest.mark.parametrize("seed", range(600, 620))
def test_infeasible_programs_are_told_from_feasible_ones_as_daqp_tells_them(seed):
    H, g, lower, upper, G, h = program(seed, n=6, m=15)
    h = h + np.random.default_rng(seed).uniform(0.0, 0.8)
    status, s, _ = ours(H, g, lower, upper, G, h)
    flag, theirs = by_daqp(H, g, lower, upper, G, h)
    assert (status == SOLVED) == (flag == 1)
    assert (status == INFEASIBLE) == (flag == -1)
    if status == SOLVED:
        assert np.allclose(s, theirs, rtol=0, atol=1e-7)


def test_infeasible_programs_were_among_them():
    found = set()
    for seed in range(600, 620):
        H, g, lower, upper, G, h = program(seed, n=6, m=15)
        h = h + np.random.default_rng(seed).uniform(0.0, 0.8)
        found.add(ours(H, g, lower, upper, G, h)[0])
    assert found == {SOLVED, INFEASIBLE}


def test_rows_beyond_the_count_do_not_exist():
    H, g, lower, upper, G, h = program(4, n=5, m=6)
    J, s, most = np.empty((5, 5)), np.empty(5), np.zeros(1)
    inverse_factor(H, J)
    assert solve(J, g, lower, upper, G, np.full(6, np.nan), 0, s, most) == SOLVED
    want = ours(H, g, lower, upper, np.empty((0, 5)), np.empty(0))[1]
    assert np.array_equal(s, want)


def test_the_multiplier_is_what_a_row_costs():
    # minimise 1/2 s^2 subject to 2 s >= 6: s = 3, and the row's multiplier is 3/2.
    _, s, most = ours(np.eye(1), np.zeros(1), [-9.0], [9.0], [[2.0]], [6.0])
    assert s[0] == pytest.approx(3.0, abs=ALGEBRA)
    assert most == pytest.approx(1.5, abs=ALGEBRA)


def test_the_program_is_left_as_it_was():
    given = program(5, n=7, m=9)
    before = [part.copy() for part in given]
    ours(*given)
    assert all(np.array_equal(a, b) for a, b in zip(given, before, strict=True))


@pytest.mark.parametrize("n", [1, 2, 11])
def test_the_inverse_factor_is_one(n):
    H = program(6, n=n)[0]
    J = np.empty((n, n))
    assert inverse_factor(H, J)
    assert np.allclose(J @ J.T @ H, np.eye(n), rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "H", [np.diag([1.0, -1.0]), np.zeros((2, 2)), np.full((2, 2), np.nan)],
    ids=["indefinite", "zero", "NaN"],
)  # fmt: skip
def test_what_is_not_positive_definite_has_no_factor(H):
    assert not inverse_factor(H, np.empty((2, 2)))
