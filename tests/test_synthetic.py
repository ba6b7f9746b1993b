"""The paper's clamp world: its maps, and the gain from NT-Xent on a small budget."""

import dataclasses

import numpy as np
import pytest
import torch

from s3le.errors import ParameterError
from s3le.synthetic import LOWER, UPPER, Settings, project, run, to_y

SMALL = Settings(points=500, glue=10, steps=40, batch=32, hidden=16)


def test_projection_clamps_is_idempotent_and_leaves_feasible_points_alone():
    x = np.random.default_rng(0).uniform(0, 2, size=(100, 2))
    assert np.array_equal(project(np.array([[0.5, 1.5], [2.0, 1.0]])), [[0.5, 1.0], [1.0, 1.0]])
    assert np.array_equal(project(project(x)), project(x))
    inside = x / 2
    assert np.array_equal(project(inside), inside)


def test_the_map_has_the_corners_computed_by_hand_and_stays_in_its_box():
    corners = to_y(np.array([[0.0, 0.0], [1.0, 1.0], [0.75, 0.0]]))
    assert np.allclose(corners, [[1.75, 0.5], [0.25, 1.25], [0.625, 0.8]], atol=1e-12)
    y = to_y(np.random.default_rng(1).uniform(0, 1, size=(20000, 2)))
    assert np.all((y >= LOWER - 1e-9) & (y <= UPPER + 1e-9))
    assert np.allclose([y.min(0), y.max(0)], [LOWER, UPPER], atol=0.02)


def test_a_run_answers_with_stored_points_and_repeats_itself():
    threads = torch.get_num_threads()
    one, two = run(SMALL, grid=5), run(SMALL, grid=5)
    assert torch.get_num_threads() == threads
    assert one.x.shape == one.answer.shape == (25, 2)
    stored = {tuple(row) for row in one.stored}
    assert all(tuple(row) in stored for row in one.answer)
    assert one.error == two.error
    assert np.array_equal(one.answer, two.answer)
    assert one.error == pytest.approx(np.abs(one.answer - one.truth).mean(), abs=1e-12)
    assert len(one.glue) == 10


def test_runs_with_and_without_nt_xent_see_the_same_data():
    terms = []
    with_it = run(SMALL, grid=3, on_step=lambda s, n, t: terms.append(set(t)))
    without = run(dataclasses.replace(SMALL, weight_nt_xent=0.0), grid=3)
    assert np.array_equal(with_it.stored, without.stored)
    assert np.array_equal(with_it.glue, without.glue)
    assert "nt_xent" in terms[0]
    assert len(terms) == SMALL.steps


def test_training_beats_chance():
    settings = dataclasses.replace(SMALL, steps=400, glue=40, points=2000)
    outcome = run(settings, grid=11)
    chance = np.abs(outcome.truth - outcome.stored.mean(axis=0)).mean()
    assert outcome.error < 0.6 * chance


@pytest.mark.parametrize(
    ("name", "value"), [("points", 0), ("tau", 0.0), ("beta", -1.0), ("glue_side", float("nan"))]
)
def test_settings_out_of_range_are_refused(name, value):
    with pytest.raises(ParameterError, match=f"synthetic {name} must be at least"):
        Settings(**{name: value})
