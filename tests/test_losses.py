"""Each loss against a slow, independent computation in numpy, and its gradient."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from s3le.errors import ParameterError
from s3le.learn import losses


def rows(seed, n, d, scale=1.0):
    return np.random.default_rng(seed).normal(scale=scale, size=(n, d))


def tensors(*arrays):
    return [torch.tensor(a, dtype=torch.float64) for a in arrays]


def sigmoid(a):
    return 1.0 / (1.0 + math.exp(-a))


def cosine(a, b):
    return float(a @ b / np.sqrt((a @ a) * (b @ b)))


def slow_nt_xent(a, b, tau):
    """The paper's sums, literally: z_1 = a_1, z_2 = b_1, z_3 = a_2, ..."""
    z = [v for pair in zip(a, b, strict=True) for v in pair]
    n = len(a)

    def pull(i, j):  # one-based, as printed
        below = sum(
            math.exp(cosine(z[i - 1], z[m - 1]) / tau) for m in range(1, 2 * n + 1) if m != i
        )
        return -math.log(math.exp(cosine(z[i - 1], z[j - 1]) / tau) / below)

    both = sum(pull(2 * m - 1, 2 * m) + pull(2 * m, 2 * m - 1) for m in range(1, n + 1))
    return both / (2 * n)


@settings(max_examples=25, deadline=None)
@given(n=st.integers(1, 7), d=st.integers(1, 6), tau=st.floats(0.1, 3.0), seed=st.integers(0, 99))
def test_nt_xent_equals_the_double_loop(n, d, tau, seed):
    a, b = rows(seed, n, d), rows(seed + 1000, n, d)
    assert losses.nt_xent(*tensors(a, b), tau).item() == pytest.approx(
        slow_nt_xent(a, b, tau), abs=1e-10
    )


def test_nt_xent_of_one_pair_is_zero_for_the_positive_is_all_there_is():
    a, b = tensors(rows(0, 1, 4), rows(1, 1, 4))
    assert losses.nt_xent(a, b, 1.0).item() == pytest.approx(0.0, abs=1e-12)


def test_nt_xent_of_collapsed_latents_is_the_log_of_all_candidates():
    z = torch.ones(6, 3, dtype=torch.float64)
    assert losses.nt_xent(z, z, 1.0).item() == pytest.approx(math.log(11), abs=1e-12)


def test_nt_xent_vanishes_for_perfect_pairs_as_tau_falls():
    z = torch.eye(4, dtype=torch.float64)
    values = [losses.nt_xent(z, z, tau).item() for tau in (1.0, 0.3, 0.1, 0.02)]
    assert values == sorted(values, reverse=True)
    assert values[-1] == pytest.approx(0.0, abs=1e-12)
    assert values[0] == pytest.approx(math.log(1 + 6 * math.exp(-1.0)), abs=1e-12)


def test_nt_xent_is_finite_where_the_exponentials_overflow():
    a, b = tensors(rows(0, 5, 3), rows(1, 5, 3))
    value = losses.nt_xent(a, -a, 1e-4) + losses.nt_xent(a.float(), b.float(), 1e-4)
    assert torch.isfinite(value)


def test_nt_xent_ignores_length_and_order_of_pairs():
    a, b = tensors(rows(2, 6, 4), rows(3, 6, 4))
    value = losses.nt_xent(a, b, 0.5)
    order = torch.tensor([3, 1, 5, 0, 2, 4])
    assert losses.nt_xent(7.0 * a, 0.2 * b, 0.5).item() == pytest.approx(value.item(), abs=1e-12)
    assert losses.nt_xent(b[order], a[order], 0.5).item() == pytest.approx(value.item(), abs=1e-12)


@pytest.mark.parametrize("tau", [0.0, -1.0, float("nan")])
def test_nt_xent_refuses_a_temperature_that_is_not_positive(tau):
    with pytest.raises(ParameterError, match="tau must be above 0"):
        losses.nt_xent(torch.ones(2, 2), torch.ones(2, 2), tau)


def test_reconstruction_sums_over_dimensions_and_averages_over_rows():
    a, b = rows(0, 5, 3), rows(1, 5, 3)
    slow = sum((a[i, k] - b[i, k]) ** 2 for i in range(5) for k in range(3)) / 5
    assert losses.reconstruction(*tensors(a, b)).item() == pytest.approx(slow, abs=1e-12)


def test_prior_fitting_equals_the_printed_logs():
    prior, encoded = rows(0, 6, 1), rows(1, 8, 1)
    beta = 0.7
    judge = (
        sum(math.log(sigmoid(v)) for v in prior[:, 0]) / 6
        + sum(math.log(1.0 - sigmoid(v)) for v in encoded[:, 0]) / 8
    )
    p, e = tensors(prior, encoded)
    assert losses.prior_discriminator(p, e, beta).item() == pytest.approx(
        -beta / 2 * judge, abs=1e-12
    )
    fool = sum(math.log(sigmoid(v)) for v in encoded[:, 0]) / 8
    assert losses.prior_encoder(e, beta).item() == pytest.approx(-beta * fool, abs=1e-12)


def test_prior_fitting_is_finite_for_a_certain_discriminator():
    sure = torch.tensor([[1e4]])
    assert losses.prior_discriminator(-sure, sure, 1.0).item() == pytest.approx(1e4)
    assert losses.prior_encoder(-sure, 1.0).item() == pytest.approx(1e4)
    assert losses.prior_encoder(sure, 1.0).item() == 0.0


def test_an_undecided_discriminator_costs_log_two():
    blind = torch.zeros(4, 1, dtype=torch.float64)
    assert losses.prior_discriminator(blind, blind, 1.0).item() == pytest.approx(math.log(2))
    assert losses.prior_encoder(blind, 1.0).item() == pytest.approx(math.log(2))


def slow_mmd(e, p, spread):
    def k(a, b):
        gap = float(np.sum((a - b) ** 2))
        return sum(s * spread / (s * spread + gap) for s in losses.MMD_SCALES)

    n, m = len(e), len(p)
    within = sum(k(e[i], e[j]) for i in range(n) for j in range(n) if i != j) / (n * (n - 1))
    among = sum(k(p[i], p[j]) for i in range(m) for j in range(m) if i != j) / (m * (m - 1))
    across = sum(k(e[i], p[j]) for i in range(n) for j in range(m)) / (n * m)
    return within + among - 2 * across


def test_mmd_equals_the_double_loop():
    e, p = rows(0, 7, 4, 2.0), rows(1, 5, 4)
    value = losses.mmd(*tensors(e, p), spread=8.0, beta=0.3).item()
    assert value == pytest.approx(0.3 * slow_mmd(e, p, 8.0), abs=1e-12)


def test_mmd_tells_another_distribution_from_the_prior():
    same = losses.mmd(*tensors(rows(0, 400, 3), rows(1, 400, 3)), spread=6.0, beta=1.0).item()
    other = losses.mmd(*tensors(rows(0, 400, 3) + 1, rows(1, 400, 3)), spread=6.0, beta=1.0).item()
    assert abs(same) < 0.02 < 0.3 < other


def test_mmd_refuses_a_single_row():
    with pytest.raises(ParameterError, match="at least 2 rows on each side, got 1 and 3"):
        losses.mmd(torch.ones(1, 2), torch.ones(3, 2), 1.0, 1.0)


def test_consensus_equals_the_loop():
    a, b = rows(0, 6, 4), rows(1, 6, 4)
    slow = sum(np.linalg.norm(u - v) ** 2 for u, v in zip(a, b, strict=True)) / 6
    assert losses.consensus(*tensors(a, b)).item() == pytest.approx(slow, abs=1e-12)


def test_normalised_consensus_equals_the_loop():
    a, b = rows(0, 6, 4), rows(1, 6, 4)
    slow = 0.0
    for u, v in zip(a, b, strict=True):
        gap = u - v
        slow += (np.abs(gap).sum() + 5 * gap @ gap) / (u @ u + v @ v + 0.1) / 6
    assert losses.consensus_normalised(*tensors(a, b)).item() == pytest.approx(slow, abs=1e-12)


def test_normalised_consensus_gains_nothing_from_shrinking():
    a, b = tensors(rows(0, 50, 4, 10.0), rows(1, 50, 4, 10.0))
    shrunk = losses.consensus_normalised(a / 5, b / 5)
    assert losses.consensus(a / 5, b / 5) < losses.consensus(a, b) / 20
    assert shrunk > losses.consensus_normalised(a, b)


def test_divergence_equals_the_loop_and_is_zero_at_the_prior():
    mean, logvar = rows(0, 5, 3), rows(1, 5, 3)
    slow = sum(
        0.5 * (mean[i, k] ** 2 + math.exp(logvar[i, k]) - 1 - logvar[i, k])
        for i in range(5)
        for k in range(3)
    )
    value = losses.kl_to_standard_normal(*tensors(mean, logvar)).item()
    assert value == pytest.approx(slow / 5, abs=1e-12)
    zero = torch.zeros(5, 3)
    assert losses.kl_to_standard_normal(zero, zero).item() == 0.0


GRADED = {
    "reconstruction": lambda a, b: losses.reconstruction(a, b),
    "prior_discriminator": lambda a, b: losses.prior_discriminator(a, b, 0.5),
    "prior_encoder": lambda a, b: losses.prior_encoder(a + b, 0.5),
    "mmd": lambda a, b: losses.mmd(a, b, 6.0, 1.0),
    "consensus": lambda a, b: losses.consensus(a, b),
    "consensus_normalised": lambda a, b: losses.consensus_normalised(a, b),
    "nt_xent": lambda a, b: losses.nt_xent(a, b, 0.3),
    "kl_to_standard_normal": lambda a, b: losses.kl_to_standard_normal(a, b),
}


@pytest.mark.parametrize("name", GRADED)
def test_gradients_match_finite_differences(name):
    a, b = (t.requires_grad_(True) for t in tensors(rows(4, 4, 3), rows(5, 4, 3)))
    assert torch.autograd.gradcheck(GRADED[name], (a, b), eps=1e-6, atol=1e-6)


# --- laws for any rows

ROWS = {"n": st.integers(2, 6), "d": st.integers(1, 5), "seed": st.integers(0, 2**31)}
OF_PAIRS = {name: f for name, f in GRADED.items() if not name.startswith(("prior", "kl", "mmd"))}


def turn(seed, d):
    return np.linalg.qr(rows(seed, d, d))[0]


@pytest.mark.parametrize("name", [n for n in GRADED if n != "mmd"])  # unbiased: may be negative
@settings(max_examples=15, deadline=None)
@given(**ROWS, scale=st.floats(0, 1e3))
def test_no_loss_is_negative_or_infinite(name, n, d, seed, scale):
    a, b = rows(seed, n, d, scale), rows(seed + 1, n, d, min(scale, 30.0))  # b: log-variances too
    value = GRADED[name](*tensors(a, b)).item()
    assert -1e-12 <= value < math.inf


@pytest.mark.parametrize("name", OF_PAIRS)
@settings(max_examples=15, deadline=None)
@given(**ROWS)
def test_losses_of_pairs_care_neither_which_side_is_first_nor_in_which_order_pairs_come(
    name, n, d, seed
):
    a, b = rows(seed, n, d), rows(seed + 1, n, d)
    order = np.random.default_rng(seed).permutation(n)
    sides = ((a, b), (b, a), (a[order], b[order]))
    values = [OF_PAIRS[name](*tensors(*pair)).item() for pair in sides]
    assert values == pytest.approx([values[0]] * 3, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", ["reconstruction", "mmd", "consensus", "nt_xent"])
@settings(max_examples=15, deadline=None)
@given(**ROWS)
def test_a_turn_of_all_latents_changes_no_loss_of_distances_or_angles(name, n, d, seed):
    a, b = rows(seed, n, d), rows(seed + 1, n, d)
    turned = [v @ turn(seed, d) for v in (a, b)]
    here, there = (GRADED[name](*tensors(*pair)).item() for pair in ((a, b), turned))
    assert there == pytest.approx(here, rel=1e-9, abs=1e-9)


@settings(max_examples=25, deadline=None)
@given(**ROWS, tau=st.floats(0.05, 3.0))
def test_nt_xent_lies_between_perfect_and_perverse(n, d, seed, tau):
    value = losses.nt_xent(*tensors(rows(seed, n, d), rows(seed + 1, n, d)), tau).item()
    assert math.log1p((2 * n - 2) * math.exp(-2 / tau)) - 1e-12 <= value
    assert value <= math.log1p((2 * n - 2) * math.exp(2 / tau)) + 1e-12


@pytest.mark.parametrize("name", ["reconstruction", "consensus", "consensus_normalised"])
@settings(max_examples=15, deadline=None)
@given(**ROWS, share=st.floats(0.01, 0.99))
def test_equal_pairs_cost_nothing_and_nearer_ones_less(name, n, d, seed, share):
    a, b = rows(seed, n, d), rows(seed + 1, n, d)
    nearer = (1 - share) * b + share * a
    same, near, far = (GRADED[name](*tensors(a, other)).item() for other in (a, nearer, b))
    assert same == 0.0
    if name != "consensus_normalised":  # there the size of the latents counts too
        assert near == pytest.approx((1 - share) ** 2 * far, rel=1e-9)
    assert near > 0.0


@settings(max_examples=15, deadline=None)
@given(**ROWS, tau=st.floats(0.05, 3.0), sizes=st.tuples(*[st.floats(1e-3, 1e3)] * 2))
def test_nt_xent_sees_directions_alone(n, d, seed, tau, sizes):
    a, b = rows(seed, n, d), rows(seed + 1, n, d)
    here, there = (
        losses.nt_xent(*tensors(s * a, t * b), tau).item() for s, t in ((1.0, 1.0), sizes)
    )
    assert there == pytest.approx(here, rel=1e-9, abs=1e-12)


@settings(max_examples=15, deadline=None)
@given(**ROWS, beta=st.floats(0, 100))
def test_beta_scales_what_it_weighs(n, d, seed, beta):
    a, b = tensors(rows(seed, n, d), rows(seed + 1, n, d))
    for loss in (losses.prior_discriminator, lambda p, e, beta: losses.mmd(e, p, 6.0, beta)):
        want = beta * loss(a, b, 1.0).item()
        assert loss(a, b, beta).item() == pytest.approx(want, rel=1e-12, abs=1e-12)
