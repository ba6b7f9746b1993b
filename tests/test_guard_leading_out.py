"""A start in collision or beyond limits is led out, and limits of the robot file are kept."""

import numpy as np
import pytest
from guarded import AGREEMENT, BETWEEN, ROUNDED, adversary, begun, colliding, driven, shared
from worlds import MARGIN, coman, write_arms

import s3le
from s3le.errors import CertificateError, ParameterError, RobotError
from s3le.guard import Guard, out
from s3le.kernels import batch
from s3le.plan import limits
from s3le.robot.robot import Robot

# --- leading out


@pytest.mark.parametrize("name", ["coman", "g1"])
def test_a_start_in_collision_leads_out_and_says_so(name):
    guard = shared(name)
    robot, dt = guard.robot, 1.0 / 60.0
    speed = np.array([j.velocity for j in robot.joints])
    for q in colliding(name, 17, -0.03, 0.002)[:6]:
        guard.start(q)
        close = batch.pair_distances(robot.chain, q[None])[0] < MARGIN
        rows = []
        while guard.leading_out:
            rows.append(guard.step(robot.anchor, dt))
            assert len(rows) < 1000
        assert all(row.reason == "leading out" and not row.certified for row in rows)
        assert guard.led_out == len(rows) > 0
        path = np.vstack([q, [row.q for row in rows]])
        v = np.diff(path, axis=0) / dt
        assert (np.abs(v) <= speed * ROUNDED).all()
        a = np.diff(np.vstack([0.0 * v[:1], v]), axis=0) / dt
        assert (np.abs(a) <= 60.0 * ROUNDED).all()
        d = batch.pair_distances(robot.chain, path)
        assert (np.diff(np.minimum(d[:, close], MARGIN), axis=0) >= -1e-5).all()
        assert (d[:, ~close] >= BETWEEN - AGREEMENT).all()
        assert robot.certifier().one(path[-1])[0] >= MARGIN
        q_after, after = driven(guard, np.repeat(robot.anchor[None], 60, axis=0), np.full(60, dt))
        assert all(row.certified for row in after) and guard.led_out == len(rows)
        first = np.abs(q_after[0] - 2.0 * path[-1] + path[-2]).max() / dt**2
        assert first <= 60.0 * ROUNDED  # the hand-over keeps the acceleration


def test_a_start_beyond_limits_leads_back():
    robot = coman()
    q = robot.anchor.copy()
    q[3] = robot.upper[3] + 0.2
    guard = begun(q=q)
    beyond = []
    while guard.leading_out:
        beyond.append(float(guard.step(q, 0.02).q[3] - robot.upper[3]))
    assert guard.led_out > 1 and (np.diff(beyond) <= 0.0).all() and beyond[-1] <= 0.0
    assert guard.step(robot.anchor, 0.02).certified


def test_the_way_out_is_no_longer_than_the_projection_where_that_leads():
    guard = shared("coman")
    need = out.Need(MARGIN, guard.settings.target, BETWEEN)
    for q in colliding("coman", 18, -0.03, 0.0)[:5]:
        straight = np.stack([q, batch.project(guard.robot.chain, guard.robot.anchor, q[None],
                                              need.target).q[0]])  # fmt: skip
        if out.leads(guard.robot, straight, need):
            found = out.find(guard.robot, q, need)
            assert out.length(found) <= out.length(straight) + 1e-9


def test_where_no_way_leads_out_it_says_so_and_nothing_has_changed(monkeypatch):
    guard = begun()
    guard.step(guard.robot.anchor - 0.01, 0.02)
    q = guard.q
    monkeypatch.setattr(out._Search, "leads", lambda self, way: False)
    with pytest.raises(CertificateError, match="no way out was found: .* mm apart"):
        guard.start(colliding("coman", 17, -0.03, 0.0)[0])
    assert (guard.q == q).all() and not guard.leading_out


def test_a_stop_on_the_way_out_holds_there_and_a_release_leads_on():
    guard = begun(q=colliding("coman", 19, -0.05, -0.02)[0])
    for _ in range(5):
        guard.step(None, 0.01)
    guard.stop()
    rows = [guard.step(None, 0.01) for _ in range(100)]
    assert rows[-1].reason == "stopped" and not rows[-1].certified and not guard.v.any()
    state = guard.state()
    guard.release()
    while guard.leading_out:
        guard.step(None, 0.01)
    guard.restore(state)
    assert guard.leading_out and guard.stopped and (guard.q == rows[-1].q).all()
    assert guard.led_out == 105


# --- the robot file


def test_accelerations_come_from_the_robot_file(tmp_path):
    plain = Robot.from_file(write_arms(tmp_path / "a"))
    text = (tmp_path / "a" / "arms.yaml").read_text()
    assert (limits.limits(plain).acceleration == 60.0).all()

    def with_(line: str) -> Robot:
        return Robot.from_file(write_arms(tmp_path / "b", text + line))

    some, every = with_("acceleration: {r_elbow: 20}\n"), with_("acceleration: 25.5\n")
    assert dict(zip(some.joint_names, limits.limits(some).acceleration, strict=True)) == {
        "r_shoulder": 60.0, "r_elbow": 20.0, "l_shoulder": 60.0, "l_elbow": 60.0,
    }  # fmt: skip
    assert (limits.limits(every).acceleration == 25.5).all()
    assert (limits.limits(some, 5.0).acceleration == 5.0).all()
    # What says nothing is what it was; what says something is another robot.
    assert with_("acceleration: {}\n").digest == plain.digest
    assert len({plain.digest, some.digest, every.digest}) == 3
    sent = Robot.from_bytes(every.to_bytes())
    assert (limits.limits(sent).acceleration == 25.5).all() and sent.digest == every.digest
    for line, says in (
        ("acceleration: {elbow: 20}\n", "acceleration names 'elbow', which does not move"),
        ("acceleration: {r_elbow: 0}\n", "acceleration.r_elbow must be a number in"),
        ("acceleration: fast\n", r"must be a number \[rad/s\^2\], or a mapping"),
        ("acceleration: true\n", "must be a number"),
    ):
        with pytest.raises(RobotError, match=says):
            with_(line)


def test_digests_of_the_robots_that_come_with_the_package_stay():
    assert coman().digest == "332fb47b97d835af" and shared("g1").robot.digest == "f8c68a00c282e744"


def test_limits_of_the_call_are_kept():
    guard = Guard(coman(), acceleration=20.0, speed_factor=0.25)
    wanted = adversary(guard, 60, 30.0, 20)
    q, rows = driven(guard, wanted, np.full(60, 1.0 / 30.0))
    v = np.diff(np.vstack([coman().anchor, q]), axis=0) * 30.0
    assert np.abs(v).max() == pytest.approx(1.0, rel=1e-6)
    assert np.abs(np.diff(v, axis=0)).max() * 30.0 <= 20.0 * ROUNDED
    assert all(row.certified for row in rows)


@pytest.mark.parametrize("tolerance", [0.0, -1.0, np.nan, "far", [0.1, 0.2]])
def test_a_tolerance_must_be_one(tolerance):
    with pytest.raises(ParameterError, match="tolerance must be"):
        Guard(coman(), tolerance=tolerance)


def test_the_guard_is_handed_out_by_the_package():
    assert s3le.Guard is Guard
