"""The paper's clamp world: its maps, its trainings, and what is said about them."""

import dataclasses

import numpy as np
import pytest
import torch

from s3le.errors import ParameterError
from s3le.learn.artifact import encode_x
from s3le.learn.models import Sizes, build
from s3le.study import synthetic
from s3le.study.synthetic import LOWER, UPPER, Settings, invariant, project, run, to_y

SMALL = Settings(
    seed=0, seeds=2, points=500, glue=10, glue_side=1.0, steps=40, batch=32, latent=4, hidden=16,
    layers=3, learning_rate=3e-3, adversary_rate=1e-3, beta=0.1, tau=1.0, weight_consensus=100.0,
    weight_nt_xent=10.0, grid=5,
)  # fmt: skip


@pytest.fixture(scope="module")
def outcomes():
    return run(SMALL)


def test_projection_clamps_is_idempotent_and_leaves_feasible_points_alone():
    x = np.random.default_rng(0).uniform(0, 2, size=(100, 2))
    assert np.array_equal(project(np.array([[0.5, 1.5], [2.0, 1.0]])), [[0.5, 1.0], [1.0, 1.0]])
    assert np.array_equal(project(project(x)), project(x))
    inside = x / 2
    assert np.array_equal(project(inside), inside)
    assert np.array_equal(invariant(x), (project(x) != x).any(axis=1))


def test_the_map_has_the_corners_computed_by_hand_and_stays_in_its_box():
    corners = to_y(np.array([[0.0, 0.0], [1.0, 1.0], [0.75, 0.0]]))
    assert np.allclose(corners, [[1.75, 0.5], [0.25, 1.25], [0.625, 0.8]], atol=1e-12)
    y = to_y(np.random.default_rng(1).uniform(0, 1, size=(20000, 2)))
    assert np.all((y >= LOWER - 1e-9) & (y <= UPPER + 1e-9))
    assert np.allclose([y.min(0), y.max(0)], [LOWER, UPPER], atol=0.02)


def test_a_run_answers_with_stored_points_and_repeats_itself(outcomes):
    threads = torch.get_num_threads()
    again = run(SMALL)
    assert torch.get_num_threads() == threads
    assert [(o.nt_xent, o.seed) for o in outcomes] == [
        (False, 0), (False, 1), (True, 0), (True, 1)
    ]  # fmt: skip
    for one, two in zip(outcomes, again, strict=True):
        assert one.x.shape == one.answer.shape == (25 + 10, 2)
        assert np.array_equal(one.answer, to_y(one.world.feasible)[one.row])
        assert np.array_equal(one.row, two.row)
        assert np.array_equal(one.x[one.glue], one.world.glue)


def test_errors_are_means_over_the_grid_alone(outcomes):
    one = outcomes[0]
    gap = np.abs(one.answer - one.truth)[:25]
    inside = np.array([a <= 1 and b <= 1 for a, b in one.x[:25]])
    assert one.error() == pytest.approx(gap.mean(), abs=1e-12)
    assert one.error(~invariant(one.x)) == pytest.approx(gap[inside].mean(), abs=1e-12)
    assert inside.sum() == 9  # of 5 x 5, spacing 0.5


def test_both_variants_of_a_seed_see_the_same_data_and_seeds_differ(outcomes):
    first, second, first_with, _ = outcomes
    for a, b in zip(first.world, first_with.world, strict=True):
        assert np.array_equal(a, b)
    assert not np.array_equal(first.world.x, second.world.x)
    assert not np.array_equal(encode_x(first.model, first.x), encode_x(first_with.model, first.x))


def test_without_its_weight_nt_xent_changes_nothing():
    steps = []
    settings = dataclasses.replace(SMALL, weight_nt_xent=0.0)
    out = run(settings, on_step=lambda done, of, terms: steps.append((done, of, set(terms))))
    assert np.array_equal(out[0].row, out[2].row)
    assert steps[0][:2] == (1, 40) and "nt_xent" not in steps[0][2]
    assert steps[-1][0] == 40


def test_a_training_does_not_depend_on_those_beside_it(outcomes):
    alone = run(dataclasses.replace(SMALL, seed=1, seeds=1))
    for one, beside in zip(alone, outcomes[1::2], strict=True):
        z, z_beside = encode_x(one.model, one.x), encode_x(beside.model, one.x)
        np.testing.assert_allclose(z, z_beside, atol=1e-4)  # rounding grows over the steps


def test_a_stack_of_networks_computes_what_each_does_alone():
    box = torch.tensor([-1.0, -1.0]), torch.tensor([1.0, 1.0])
    sizes = Sizes(dim_q=2, dim_x=2, latent=3, hidden=8, layers=2)
    nets = [
        build("s3le", sizes, *box, torch.Generator().manual_seed(seed)).encoder_x for seed in (1, 2)
    ]
    x = torch.randn(2, 5, 2, generator=torch.Generator().manual_seed(3))
    stack = synthetic._stack(nets)
    for r in (0, 1):
        torch.testing.assert_close(synthetic._forward(stack, x)[r], nets[r](x[r]))
    synthetic._unstack(stack, 0, nets[1])
    torch.testing.assert_close(nets[1](x[0]), nets[0](x[0]), rtol=0, atol=0)


def test_training_beats_chance():
    settings = dataclasses.replace(SMALL, seeds=1, steps=400, glue=40, points=2000, grid=11)
    for outcome in run(settings):
        chance = np.abs(outcome.truth - to_y(outcome.world.feasible).mean(axis=0)).mean()
        assert outcome.error() < 0.6 * chance


def test_figures_are_means_over_seeds_and_the_seed_shown_is_no_extreme(outcomes):
    tree = synthetic.figures(outcomes)
    errors = [o.error(invariant(o.x)) for o in outcomes]
    found = tree["with_nt_xent"]["error_invariant"]
    assert found["mean"] == pytest.approx(np.mean(errors[2:]), abs=1e-12)
    assert found["sd"] == pytest.approx(abs(errors[2] - errors[3]) / 2**0.5, abs=1e-12)
    assert tree["better"] == (errors[2] < errors[0]) + (errors[3] < errors[1])
    gains = {0: errors[0] - errors[2], 1: errors[1] - errors[3]}
    assert tree["shown"] == min(gains, key=gains.get)  # of two the lower one
    assert synthetic.figures([outcomes[0], outcomes[2]])["with_nt_xent"]["error_all"]["sd"] == 0.0


def test_columns_hold_both_variants_of_one_seed(outcomes):
    columns = synthetic.columns(outcomes, 1)
    assert {len(values) for values in columns.values()} == {2 * 35}
    assert np.array_equal(columns["y_answer"], to_y(columns["x_answer"]))
    assert np.array_equal(columns["y_true"], to_y(columns["x_true"]))
    assert np.array_equal(columns["y_answer"][:35], outcomes[1].answer)
    assert np.array_equal(columns["y_answer"][35:], outcomes[3].answer)


@pytest.mark.parametrize(
    ("name", "value"),
    [("points", 0), ("tau", 0.0), ("beta", -1.0), ("glue_side", float("nan")), ("grid", 1)],
)
def test_settings_out_of_range_are_refused(name, value):
    with pytest.raises(ParameterError, match=f"synthetic {name} must be at least"):
        dataclasses.replace(SMALL, **{name: value})
