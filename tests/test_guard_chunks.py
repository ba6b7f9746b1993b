"""Chunks are as many steps, a state goes on to the bit, and what was guarded stays as it is."""

import numpy as np
import pytest
from guarded import RATES, adversary, begun, driven, shared
from worlds import coman

from s3le.errors import CertificateError, ParameterError, StateError
from s3le.plan.whole import Planner


def test_a_chunk_is_as_many_steps_and_moves_nothing_unless_told():
    wanted, dt = adversary(shared("coman"), 20, 30.0, 8), 1.0 / 30.0
    alone, rows = driven(begun(), wanted, np.full(20, dt))
    guard = begun()
    for _ in range(2):
        made = guard.chunk(wanted, dt)
        assert made.q.tobytes() == alone.tobytes()
        assert made.reason == tuple(row.reason for row in rows)
        assert made.certified.all() and (made.bound == [row.bound for row in rows]).all()
        assert (guard.q == guard.robot.anchor).all() and not guard.v.any()
    guard.chunk(wanted, dt, advance=8)
    assert (guard.q == alone[7]).all()
    made = guard.chunk(wanted[8:], dt, advance=True)
    assert made.q.tobytes() == alone[8:].tobytes() and (guard.q == alone[-1]).all()


def test_a_chunk_takes_uneven_times_names_and_mappings():
    guard = begun()
    wanted, names = adversary(guard, 6, 30.0, 9), guard.robot.joint_names
    dt = np.linspace(0.01, 0.04, 6)
    first = guard.chunk(wanted, dt)
    assert guard.chunk({n: wanted[:, i] for i, n in enumerate(names)}, dt).q.tobytes() == (
        first.q.tobytes()
    )
    mappings = [dict(zip(names, row, strict=True)) for row in wanted.tolist()]
    assert guard.chunk(mappings, list(dt)).q.tobytes() == first.q.tobytes()


def test_a_state_is_plain_arrays_and_the_stream_goes_on_to_the_bit(tmp_path):
    guard = begun()
    wanted, dt = adversary(guard, 80, 30.0, 10), np.full(80, 1.0 / 30.0)
    whole, _ = driven(guard, wanted, dt)
    begun()
    driven(guard, wanted[:37], dt[:37])
    np.savez(tmp_path / "state.npz", **guard.state())
    driven(guard, wanted[37:], dt[37:])
    with np.load(tmp_path / "state.npz", allow_pickle=False) as kept:
        guard.restore(kept)
    rest, _ = driven(guard, wanted[37:], dt[37:])
    assert rest.tobytes() == whole[37:].tobytes()


@pytest.mark.parametrize(
    ("spoil", "error", "says"),
    [
        (lambda s: s.pop("v"), StateError, "lacks 'v'"),
        (lambda s: s.update(q=s["q"][:-1]), StateError, "'q' is of another kind"),
        (lambda s: s.update(q=s["q"] * np.nan), StateError, "'q' is not finite"),
        (lambda s: s.update(robot=np.array("g1")), StateError, "the state is of g1"),
        (lambda s: s.update(q=s["q"] + 50.0), CertificateError, "outside"),
        (lambda s: s.update(v=s["v"] + 3.9), CertificateError, "can brake"),
        (lambda s: s.update(before=np.array(-1.0)), ParameterError, "must last"),
    ],
)
def test_a_state_from_which_nothing_is_proven_is_refused(spoil, error, says):
    guard = begun()
    driven(guard, adversary(guard, 20, 30.0, 11), np.full(20, 1.0 / 30.0))
    state, q = guard.state(), guard.q
    spoil(state)
    with pytest.raises(error, match=says):
        guard.restore(state)
    assert (guard.q == q).all() and guard.step(q, 0.03).certified


def test_guarding_straight_what_is_guarded_straight_changes_nothing():
    for name, rate in (("coman", 30.0), ("coman", 250.0), ("g1", 100.0)):
        guard = begun(name, straight=True)
        m = int(3 * rate)
        dt = np.full(m, 1.0 / rate)
        once, _ = driven(guard, adversary(guard, m, rate, 12), dt)
        twice, rows = driven(begun(name, straight=True), once, dt)
        assert twice.tobytes() == once.tobytes()
        assert {row.reason for row in rows} == {"as wanted"}


def test_a_planned_motion_that_could_brake_comes_back_to_the_bit():
    robot, guard = coman(), shared("coman", straight=True)
    still, poses = np.repeat(robot.anchor[None], 40, axis=0), adversary(guard, 90, 30.0, 13)
    wanted = np.vstack([still, 0.7 * robot.anchor + 0.3 * poses, still])
    made = Planner(robot).plan(np.arange(len(wanted)) / 30.0, wanted).q
    again, rows = driven(
        begun(q=made[0], straight=True), made[1:], np.full(len(made) - 1, 1.0 / 30.0)
    )
    assert {row.reason for row in rows} == {"as wanted"}
    assert again.tobytes() == made[1:].tobytes()


@pytest.mark.parametrize("rate", RATES)
def test_a_robot_comes_onto_a_motion_that_it_can_follow_and_does_not_shake(rate):
    guard, dt = begun(), 1.0 / rate
    i = guard.robot.joint_names.index("LElbj")
    wanted = np.repeat(guard.robot.anchor[None], int(rate), axis=0)
    wanted[:, i] -= 1.0 * dt * np.arange(len(wanted))  # 1 rad/s, at once
    q, rows = driven(guard, wanted, np.full(len(wanted), dt))
    assert {row.reason for row in rows[len(rows) // 2 :]} == {"as wanted"}
    a = np.diff(q[:, i], n=2) / dt**2
    assert (np.diff(np.sign(np.where(np.abs(a) > 1.0, a, 0.0))) != 0.0).sum() <= 8
    # And a joint that comes to a standing goal turns round at most once.
    begun()
    goal = guard.robot.anchor.copy()
    goal[i] -= 0.7
    q, rows = driven(guard, np.repeat(goal[None], int(rate), axis=0), np.full(int(rate), dt))
    a = np.diff(q[:, i], n=2) / dt**2
    assert (np.diff(np.sign(np.where(np.abs(a) > 1.0, a, 0.0))) != 0.0).sum() <= 8
    assert (q[-1] == goal).all()
