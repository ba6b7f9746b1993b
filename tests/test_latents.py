"""Latent spaces brought to a plane."""

import numpy as np
import pytest

from s3le.study.latents import principal


@pytest.mark.parametrize("used", [1, 3, 6])
def test_rank_counts_the_directions_in_use(used):
    z = np.zeros((4000, 8))
    z[:, :used] = np.random.default_rng(1).normal(size=(4000, used))
    plane, rank = principal(z)
    assert rank == pytest.approx(used, rel=0.02)
    np.testing.assert_allclose(plane.T @ plane, np.eye(2), atol=1e-12)


def test_the_plane_holds_the_two_widest_directions():
    rng = np.random.default_rng(2)
    turn, _ = np.linalg.qr(rng.normal(size=(5, 5)))
    z = rng.normal(size=(5000, 5)) * [0.1, 3.0, 0.2, 2.0, 0.1] @ turn.T
    plane, _ = principal(z)
    assert abs(plane[:, 0] @ turn[:, 1]) > 0.999
    assert abs(plane[:, 1] @ turn[:, 3]) > 0.999
    assert (plane[np.abs(plane).argmax(axis=0), [0, 1]] > 0).all()
