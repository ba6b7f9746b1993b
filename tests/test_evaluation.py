"""Figures of a comparison, by hand; what could not be measured counts against the method."""

import numpy as np
import pytest

from s3le.evaluation import Scored, score, summary
from s3le.robot.certificate import Report

UP = np.tile([0.0, 0.0, 1.0], 7)
FORWARD = np.tile([1.0, 0.0, 0.0], 7)


def test_scores_are_mean_cosine_distances():
    x = np.stack([UP, UP, np.r_[FORWARD[:3], UP[3:]]])
    scored = score(x, np.stack([UP, FORWARD, UP]), np.stack([-UP, UP, UP]))
    np.testing.assert_allclose(scored.to_truth, [0.0, 1.0, 1 / 7], atol=1e-12)
    np.testing.assert_allclose(scored.to_human, [2.0, 0.0, 1 / 7], atol=1e-12)


def test_motions_count_the_same_whatever_their_length():
    clips = ["a", "a", "a", "b"]
    scored = Scored(np.array([0.1, 0.1, 0.1, 0.5]), np.zeros(4))
    report = Report(np.full(4, 0.01), np.zeros(4, int), np.full(4, 0.1))
    found = summary(clips, scored, report, 0.002)
    assert found["all"]["to_truth"] == pytest.approx(0.2)
    assert found["all"]["to_truth_motions"] == pytest.approx(0.3)
    assert found["motions"]["b"]["frames"] == 1
    assert list(found["motions"]) == ["a", "b"]


def test_a_pose_that_was_not_measured_counts_as_unsafe():
    report = Report(
        np.array([0.01, np.nan, -0.01, 0.001]),
        np.zeros(4, int),
        np.array([0.1, np.nan, 0.1, -0.1]),
    )
    found = summary(["a"] * 4, Scored(np.zeros(4), np.zeros(4)), report, 0.002)["all"]
    assert found["collision_rate"] == 0.5
    assert found["below_margin_rate"] == 0.75
    assert found["limit_rate"] == 0.5
