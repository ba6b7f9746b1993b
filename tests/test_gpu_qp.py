"""The batched interior-point method against the compiled active-set method and daqp."""

import daqp
import numpy as np
import pytest
import torch

from s3le.gpu.qp import PRICE, Program, solve
from s3le.kernels.qp import SOLVED
from s3le.kernels.qp import solve as solve_one

SOLUTION = 1e-6  # [-], on s of size one, at worst; nine in ten are within 1e-8
SHAPES = [(1, 1), (3, 40), (5, 10), (11, 32)]


def programs(rows, n, k, seed, shift=0.0):
    """Random programs with H = I, bounds and rows often active; shift > 0 closes some of them."""
    rng = np.random.default_rng(seed)
    inside = rng.uniform(-0.5, 0.5, (rows, n))
    lower, upper = inside - rng.uniform(0, 1, (rows, n)), inside + rng.uniform(0, 1, (rows, n))
    G = rng.normal(size=(rows, k, n))
    h = np.einsum("bkn,bn->bk", G, inside) - rng.uniform(0, 0.4, (rows, k))
    return 3.0 * rng.normal(size=(rows, n)), lower, upper, G, h + shift * rng.random((rows, 1))


def ours(given):
    return solve(Program(*(torch.tensor(part, dtype=torch.float64) for part in given)))


def compiled(g, lower, upper, G, h):
    """Status, solution and the largest multiplier."""
    n, s, most = len(g), np.empty(len(g)), np.zeros(1)
    status = solve_one(np.eye(n), g, lower, upper, G, h, len(h), s, most)
    return status, s, most[0]


def one(g, lower, upper, G, h):
    """A batch of one program."""
    return ours([np.array([part], float) for part in (g, lower, upper, G, h)])


@pytest.mark.parametrize(("n", "k"), SHAPES)
def test_random_programs_are_solved_as_the_compiled_kernel_solves_them(n, k):
    given = programs(300, n, k, 10 * n)
    found = ours(given)
    assert found.solved.all()
    off = []
    for row in range(300):
        status, want, most = compiled(*(part[row] for part in given))
        assert status == SOLVED
        off.append(np.abs(found.s[row].numpy() - want).max())
        assert found.most[row] == pytest.approx(most, abs=1e-5)
    assert max(off) < SOLUTION and np.quantile(off, 0.9) < 1e-8


def test_random_programs_are_solved_as_daqp_solves_them():
    given = programs(60, 11, 32, 7)
    found = ours(given)
    for row in range(60):
        g, lower, upper, G, h = (part[row] for part in given)
        above = np.concatenate([upper, np.full(len(h), 1e30)])
        below = np.concatenate([lower, h])
        want, _, flag, _ = daqp.solve(np.eye(11), g, G, above, below, primal_tol=1e-11)
        assert flag == 1
        assert np.allclose(found.s[row], want, rtol=0, atol=SOLUTION)


def test_solutions_are_within_their_bounds_to_the_bit():
    given = programs(200, 11, 32, 8)
    s = ours(given).s.numpy()
    assert (s >= given[1]).all() and (s <= given[2]).all()


def test_programs_without_a_solution_do_not_disturb_the_others_and_say_what_they_miss():
    given = programs(200, 6, 15, 9, shift=1.0)
    found = ours(given)
    solvable = np.array([compiled(*(p[row] for p in given))[0] == SOLVED for row in range(200)])
    assert 20 < solvable.sum() < 180
    assert (found.missed[torch.tensor(~solvable)] > 1e-7).all()
    assert (found.missed[torch.tensor(solvable)] < 1e-7).all()
    for row in np.flatnonzero(solvable):
        want = compiled(*(part[row] for part in given))[1]
        assert np.allclose(found.s[row], want, rtol=0, atol=SOLUTION)


def test_what_cannot_be_met_is_missed_as_little_as_the_price_asks():
    # s >= 2 within a box that ends at 1, and two rows that ask for s >= 0.5 and s <= 0.25.
    assert one([0.0], [-1.0], [1.0], [[1.0]], [2.0]).s.item() == pytest.approx(1.0, abs=1e-9)
    torn = one([0.0], [-1.0], [1.0], [[1.0], [-1.0]], [0.5, -0.25])
    assert torn.missed.item() == pytest.approx(0.25, abs=1e-9)
    assert 0.25 - 1e-9 <= torn.s.item() <= 0.5 + 1e-9


@pytest.mark.parametrize(("slope", "want"), [(0.1, 0.5), (1e-3, -1.0 + 2e-3 * PRICE)])
def test_rows_dearer_than_their_price_are_missed(slope, want):
    # minimise 1/2 s's + s_x; two rows that nearly oppose each other ask for s_x >= 1/2, at
    # multipliers of 3 / (4 slope), beyond the price for the second slope.
    rows, sides = np.array([[slope, 1.0], [slope, -1.0]]), [0.5 * slope, 0.5 * slope]
    found = one([1.0, 0.0], [-1.0, -1.0], [1.0, 1.0], rows, sides)
    assert found.s[0].tolist() == pytest.approx([want, 0.0], abs=1e-6)
    assert (found.missed.item() > 1e-6) == (want != 0.5)


def test_a_program_that_is_not_a_number_is_marked_and_harms_no_other():
    given = programs(20, 5, 10, 11)
    clean = ours(given)
    given[0][3, 2], given[3][7, 4, 1], given[4][9, 0] = np.nan, np.inf, np.nan
    found = ours(given)
    bad = np.isin(np.arange(20), [3, 7, 9])
    assert np.array_equal(found.solved.numpy(), ~bad)
    assert np.allclose(found.s[~bad], clean.s[~bad], rtol=0, atol=1e-12)
    assert torch.isfinite(found.s).all()


def test_the_nearest_point_of_a_box_is_the_clipped_point():
    want = np.array([-3.0, -0.2, 0.0, 0.4, 9.0])
    found = one(-want, -np.ones(5), np.ones(5), np.zeros((2, 5)), [-1.0, -1.0])
    assert np.allclose(found.s[0], np.clip(want, -1, 1), rtol=0, atol=1e-9)
    assert found.most.item() == 0.0


def test_bounds_that_meet_leave_no_choice():
    g, lower, upper, G, h = (part[0] for part in programs(1, 6, 4, 12))
    lower[2] = upper[2] = 0.5 * (lower[2] + upper[2])
    found = one(g, lower, upper, G, np.minimum(h, G @ ((lower + upper) / 2)))
    assert found.s[0, 2].item() == lower[2]


@pytest.mark.parametrize("tilt", [0.0, 1e-12, 1e-8, 1e-4])
def test_rows_that_say_nearly_the_same_change_nothing(tilt):
    g, lower, upper, G, h = programs(100, 11, 12, 13)
    rng = np.random.default_rng(14)
    twice = np.concatenate([G, G + tilt * rng.normal(size=G.shape)], axis=1)
    once = ours((g, lower, upper, G, h)).s
    both = ours((g, lower, upper, twice, np.concatenate([h, h - 10 * tilt], axis=1))).s
    assert np.allclose(once, both, rtol=0, atol=SOLUTION)


def test_the_size_of_the_objective_does_not_matter():
    g, lower, upper, G, h = programs(50, 5, 8, 15)
    found = ours((1e9 * g, lower, upper, G, h))
    assert found.solved.all() and (found.missed < 1e-7).all()
    for row in range(50):
        want = compiled(1e9 * g[row], lower[row], upper[row], G[row], h[row])[1]
        assert np.allclose(found.s[row], want, rtol=0, atol=1e-5)


def test_the_multiplier_is_what_a_row_costs():
    # minimise 1/2 s^2 subject to 2 s >= 6: s = 3, and the row's multiplier is 3/2.
    found = one([0.0], [-9.0], [9.0], [[2.0]], [6.0])
    assert found.s.item() == pytest.approx(3.0, abs=1e-9)
    assert found.most.item() == pytest.approx(1.5, abs=1e-8)
