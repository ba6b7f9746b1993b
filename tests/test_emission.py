"""A motion at another rate lies on the certified path, and what cuts it is proven or not done."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import MARGIN, relaxed, write_arms

from s3le.errors import ParameterError
from s3le.kernels import batch
from s3le.motion.rates import as_given, at_rate
from s3le.robot.robot import Robot
from s3le.safety import paths
from s3le.safety.paths import CERTIFIED, UNDECIDED, certify

BETWEEN = 0.0005


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    return Robot.from_file(write_arms(tmp_path_factory.mktemp("arms")), MARGIN, "midpoint")


def walk(made, seed, rows=30, size=0.1):
    """A certified random walk, much of it close to a collision."""
    q = [batch.project(made.chain, made.anchor, relaxed(made, 1, seed), MARGIN).q[0]]
    rng = np.random.default_rng(seed)
    while len(q) < rows:
        want = q[-1] + rng.uniform(-size, size, made.n_dof)
        want = batch.project(made.chain, made.anchor, want[None], MARGIN).q[0]
        good = certify(made, np.array([q[-1], want]), BETWEEN).status[0] == CERTIFIED
        q.append(want if good else q[-1])
    return np.arange(rows) / 30.0, np.array(q)


def on_path(time, q, at):
    return np.stack([np.interp(at, time, q[:, j]) for j in range(q.shape[1])], axis=1)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), rate=st.floats(30.0, 1000.0), gap=st.integers(0, 28))
def test_every_row_lies_on_the_path_and_every_step_is_proven(arms, seed, rate, gap):
    time, q = walk(arms, seed)
    time = np.where(np.arange(len(time)) > gap, time + 0.217, time)  # frames were dropped
    made = at_rate(arms, time, q, rate, BETWEEN)
    assert made.q == pytest.approx(on_path(time, q, made.time), abs=1e-9)
    assert (certify(arms, made.q, BETWEEN).status == CERTIFIED).all()
    assert (np.diff(made.time) > 0).all() and np.diff(made.time).max() <= (1 + 1e-9) / rate
    low, high = arms.lower, arms.upper
    assert ((made.q >= low) & (made.q <= high)).all()
    on = made.corner >= 0
    assert (made.q[on] == q[made.corner[on]]).all()
    assert np.abs(made.time[on] - time[made.corner[on]]).max() <= 1e-7 / rate
    assert made.time[-1] > time[-1] - (1 + 1e-6) / rate
    speed, most = np.abs(np.diff(made.q, axis=0)), np.abs(np.diff(q, axis=0))
    step, frame = np.diff(made.time)[:, None], np.diff(time)[:, None]
    assert (speed / step).max() <= (most / frame).max() * (1 + 1e-6)


@pytest.mark.parametrize("times", [1, 2, 7, 20])
def test_a_whole_multiple_of_the_rate_keeps_every_pose(arms, times):
    time, q = walk(arms, 3)
    made = at_rate(arms, time, q, 30.0 * times, BETWEEN)
    assert made.q[::times] == pytest.approx(q, abs=0) and made.cut == made.kept == 0
    assert len(made.q) == (len(q) - 1) * times + 1


def test_without_the_proof_of_cut_corners_collisions_get_in(arms, monkeypatch):
    q = None
    rng = np.random.default_rng(0)
    for _ in range(4000):  # two certified steps whose chord collides
        three = relaxed(arms, 3, int(rng.integers(1 << 31)), 0.0)
        three[1] = three[0] + rng.uniform(-1, 1, 4)
        three[2] = three[1] + rng.uniform(-1, 1, 4)
        three = batch.project(arms.chain, arms.anchor, three, MARGIN).q
        if (certify(arms, three, BETWEEN).status == CERTIFIED).all() and (
            certify(arms, three[[0, 2]], BETWEEN).status[0] != CERTIFIED
        ):
            q = three
            break
    assert q is not None
    time = np.array([0.0, 1 / 60, 1 / 30])
    honest = at_rate(arms, time, q, 30.0, BETWEEN)
    assert honest.kept == 1 and honest.corner.tolist() == [0, 1, 2]
    monkeypatch.setattr(
        "s3le.motion.rates.paths.certify",
        lambda _, q, __: type("Blind", (), {"status": np.full(len(q) - 1, CERTIFIED)}),
    )
    blind = at_rate(arms, time, q, 30.0, BETWEEN)
    assert (certify(arms, blind.q, BETWEEN).status != CERTIFIED).any()


@pytest.mark.parametrize("rows", [1, 2])
def test_short_motions(arms, rows):
    time, q = walk(arms, 1, rows)
    made = at_rate(arms, time, q, 120.0, BETWEEN)
    assert len(made.q) == 4 * (rows - 1) + 1 and (made.q[0] == q[0]).all()


@pytest.mark.parametrize("rate", [0.0, 29.9, 1000.1, -30.0, float("nan"), float("inf")])
def test_rates_out_of_range_are_refused(arms, rate):
    with pytest.raises(ParameterError, match=r"rate must be in \[30, 1000\] Hz"):
        at_rate(arms, *walk(arms, 1, 2), rate, BETWEEN)


def test_a_motion_of_days_is_refused_before_memory_is_asked_for(arms):
    _, q = walk(arms, 1, 2)
    with pytest.raises(ParameterError, match="at most 10000000"):
        at_rate(arms, np.array([0.0, 1e9]), q, 1000.0, BETWEEN)


def test_a_motion_as_it_is(arms):
    time, q = walk(arms, 2, 4)
    made = as_given(time, q)
    assert (made.q == q).all() and made.corner.tolist() == made.next.tolist() == [0, 1, 2, 3]


def test_a_corner_whose_cut_is_not_decided_is_kept_as_one_that_collides_is(arms, monkeypatch):
    time, q = walk(arms, 3)
    free = at_rate(arms, time, q, 45.0, BETWEEN)
    assert free.cut > 0
    whole = paths.certify

    def spent(*given):
        found = whole(*given)
        found.status[:] = UNDECIDED
        return found

    monkeypatch.setattr(paths, "certify", spent)
    made = at_rate(arms, time, q, 45.0, BETWEEN)
    assert made.cut == 0 and made.kept == free.cut + free.kept
    # Every given pose but the end, which no row of this rate falls on, is one of the rows.
    assert set(range(len(q))) - set(made.corner.tolist()) <= {len(q) - 1}
