"""The guard in a program: whatever is wanted, every row holds, and a stop stays a stop."""

from functools import cache

import numpy as np
import pytest
from worlds import MARGIN, coman, inside_limits, write_arms

import s3le
from s3le.errors import CertificateError, ParameterError, RobotError, StateError
from s3le.guard import Guard, out
from s3le.kernels import batch
from s3le.plan import causal, limits
from s3le.plan.whole import Planner
from s3le.robot.robot import Robot
from s3le.safety.judge import Judge
from s3le.safety.paths import CERTIFIED, certify

BETWEEN = 0.0005  # [m]
AGREEMENT = 1e-7  # [m], of kernels and coal (test_distance.py)
ROUNDED = 1.0 + 1e-9
RATES = (30.0, 100.0, 250.0)


@cache
def shared(name: str) -> Guard:
    return Guard.load(name)


def begun(name: str = "coman", q=None) -> Guard:
    guard = shared(name)
    guard.start(q)
    return guard


def adversary(guard: Guard, m: int, rate: float, seed: int) -> np.ndarray:
    """Jumps to any pose and beyond limits, swings through the body, and poses that stand still."""
    robot, rng = guard.robot, np.random.default_rng(seed)
    n, t = robot.n_dof, np.arange(m)[:, None] / rate
    middle, half = 0.5 * (robot.lower + robot.upper), 0.5 * (robot.upper - robot.lower)
    swings = middle + 1.1 * half * np.sin(
        2.0 * np.pi * rng.uniform(0.1, 1.5, n) * t + rng.uniform(0.0, 6.28, n)
    )
    jumps = rng.uniform(robot.lower - 0.5, robot.upper + 0.5, (m, n))
    hold = max(int(rate / 4), 1)
    jumps = np.repeat(jumps[::hold], hold, axis=0)[:m]
    return np.where((np.arange(m) // (2 * hold) % 2 == 0)[:, None], jumps, swings)


def driven(guard: Guard, wanted: np.ndarray, dt: np.ndarray) -> tuple[np.ndarray, list]:
    rows = [guard.step(q, one) for q, one in zip(wanted, dt, strict=True)]
    return np.array([row.q for row in rows]), rows


def assert_rows_hold(
    robot: Robot, start: np.ndarray, q: np.ndarray, dt: np.ndarray, certified: np.ndarray
) -> None:
    """By differences, coal and the proof; nothing that the guard computed is used.

    Speed and acceleration of a row are those of the step that ends there, from rest before row 0.
    """
    q = np.vstack([start, q])
    speed = np.array([j.velocity for j in robot.joints])
    v = np.diff(q, axis=0) / dt[:, None]
    before = np.concatenate([dt[:1], dt[:-1]])
    a = np.diff(np.vstack([np.zeros(len(start)), v]), axis=0) / (0.5 * (before + dt))[:, None]
    assert (np.abs(v) <= speed * ROUNDED)[certified].all()
    assert (np.abs(a) <= limits.limits(robot).acceleration * ROUNDED)[certified].all()
    report = robot.certifier().check(q[1:])
    assert (report.clearance >= robot.margin).all() and (report.limit_margin >= 0.0).all()
    assert (certify(robot, q, BETWEEN).status == CERTIFIED).all()


@pytest.mark.parametrize("name", ["coman", "g1"])
@pytest.mark.parametrize("rate", RATES)
def test_whatever_is_wanted_every_row_holds(name, rate):
    guard = begun(name)
    m = int(4.0 * rate)
    dt = np.full(m, 1.0 / rate)
    q, rows = driven(guard, adversary(guard, m, rate, 1), dt)
    assert all(row.certified for row in rows)
    assert_rows_hold(guard.robot, guard.robot.anchor, q, dt, np.ones(m, bool))
    assert all(row.clearance >= MARGIN and row.bound >= BETWEEN for row in rows)
    assert np.abs(np.diff(q, axis=0)).max() > 0.01  # and it moves


@pytest.mark.parametrize("name", ["coman", "g1"])
@pytest.mark.parametrize("spread", [(0.0036, 0.0044), (0.03, 0.0367), (0.002, 0.08)])
def test_uneven_steps_hold_too_and_what_does_not_says_so(name, spread):
    guard, m = begun(name), 600
    dt = np.random.default_rng(2).uniform(*spread, m)
    q, rows = driven(guard, adversary(guard, m, 30.0, 3), dt)
    certified = np.array([row.certified for row in rows])
    assert_rows_hold(guard.robot, guard.robot.anchor, q, dt, certified)
    # Where no row can be certified the robot stands still at once.
    still = np.array([(row.v == 0.0).all() for row in rows])
    assert still[~certified].all()
    assert (~certified).mean() <= {0.0044: 0.0, 0.0367: 0.005, 0.08: 0.01}[spread[1]]


def test_the_densest_paths_are_clear_by_sampling_too():
    guard, m = begun(), 240
    dt = np.full(m, 1.0 / 30.0)
    q, rows = driven(guard, adversary(guard, m, 30.0, 4), dt)
    judge = Judge(guard.robot.certifier())
    for row in np.argsort([row.bound for row in rows])[:6]:
        before = guard.robot.anchor if row == 0 else q[row - 1]
        assert judge.path(before, q[row]).clearance >= BETWEEN - AGREEMENT


def brakes_from_every_row(guard: Guard, wanted: np.ndarray, dt: float) -> bool:
    """Stop after each row, in turn: is every row until rest certified?"""
    for row in wanted:
        guard.step(row, dt)
        kept = guard.state()
        guard.stop()
        for _ in range(400):
            made = guard.step(None, dt)
            if not made.certified:
                return False
            if made.reason == "stopped":
                break
        else:
            return False
        guard.restore(kept)
    return True


def test_from_every_row_the_robot_can_stop_within_its_limits():
    assert brakes_from_every_row(begun(), adversary(shared("coman"), 150, 30.0, 5), 1.0 / 30.0)


def test_without_the_proof_of_braking_it_could_not(monkeypatch):
    """What the test above is worth: with steps that are proven alone it fails."""

    def ahead(chain, swept, s, memory, q, v, before, dt, bounds, care, want, *rest):
        to, found = rest[-2:]
        step = np.clip(want - q, -bounds.speed * dt, bounds.speed * dt)
        mean = 0.5 * (before + dt) * bounds.acceleration * (1.0 - 1e-7)
        to[:] = np.clip(q + np.clip(step, (v - mean) * dt, (v + mean) * dt),
                        bounds.lower, bounds.upper)  # fmt: skip
        if causal.clear(chain, swept, s, q, to, care, found):
            return causal.LIMITED
        causal.brake(q, v, 0.5 * (before + dt), dt, bounds, to)
        return causal.BRAKED if causal.clear(chain, swept, s, q, to, care, found) else causal.HELD

    guard = begun()
    monkeypatch.setattr("s3le.plan.steps.pursue.pursue", ahead)
    monkeypatch.setattr("s3le.plan.steps.direct.direct", lambda c, w, s, *rest: ahead(
        c, w, s, None, *rest))  # fmt: skip
    failed = False
    try:
        failed = not brakes_from_every_row(guard, adversary(guard, 150, 30.0, 5), 1.0 / 30.0)
    except CertificateError:  # a state from which braking is not proven is not restored
        failed = True
    assert failed


# --- stops


def test_a_stop_is_latched_until_it_is_released():
    guard, dt = begun(), 0.01
    wanted = guard.robot.anchor.copy()
    wanted[5] += 0.8 if wanted[5] < 0 else -0.8
    for _ in range(15):
        guard.step(wanted, dt)
    assert np.abs(guard.v).max() > 1.0
    guard.stop()
    reasons = [guard.step(wanted, dt).reason for _ in range(60)]
    first = reasons.index("stopped")
    assert set(reasons[:first]) == {"braked"} and set(reasons[first:]) == {"stopped"}
    at = guard.q
    for q in (wanted, None, np.full(guard.robot.n_dof, np.nan), "nonsense"):
        made = guard.step(q, dt)  # a stop does not depend on what else is said
        assert made.reason == "stopped" and made.certified and (made.q == at).all()
    assert guard.stopped
    guard.release()
    assert guard.step(wanted, dt).reason != "stopped" and (guard.step(wanted, dt).q != at).any()


def test_a_stop_brakes_as_hard_as_it_may():
    guard, dt = begun(), 0.004
    wanted = guard.robot.anchor.copy()
    wanted[5] += 1.0 if wanted[5] < 0 else -1.0
    for _ in range(60):
        guard.step(wanted, dt)
    v = np.abs(guard.v).max()
    guard.stop()
    rows = 0
    while guard.v.any():
        guard.step(wanted, dt)
        rows += 1
    assert rows == pytest.approx(v / (60.0 * dt), abs=1.01)


def test_a_measured_pose_that_is_far_off_stops_the_robot():
    guard, dt = begun(), 0.01
    wanted = guard.robot.anchor.copy()
    wanted[5] += 0.5 if wanted[5] < 0 else -0.5
    for _ in range(10):
        guard.step(wanted, dt, measured=guard.q)
    joint = guard.robot.joint_names[2]
    off = guard.q
    off[2] += 0.3
    before = guard.q, guard.v
    with pytest.raises(StateError, match=f"{joint} is measured .* 0.3000 rad from where"):
        guard.step(wanted, dt, measured=off)
    assert guard.stopped and (guard.q == before[0]).all() and (guard.v == before[1]).all()
    assert guard.step(wanted, dt).reason == "braked"
    guard.release()
    with pytest.raises(StateError):
        guard.step(wanted, dt, measured=off)
    with pytest.raises(ParameterError, match="not finite"):
        begun().step(wanted, dt, measured=np.full(guard.robot.n_dof, np.nan))
    assert guard.stopped


def test_a_measured_pose_within_the_tolerance_changes_no_row():
    wanted = adversary(shared("coman"), 60, 30.0, 6)
    alone, _ = driven(begun(), wanted, np.full(60, 1.0 / 30.0))
    guard, rng = begun(), np.random.default_rng(7)
    came = guard.q
    for row, q in zip(wanted, alone, strict=True):
        # A robot lags by a part of the last step, and its encoders are off.
        lag = guard.q + rng.uniform() * (came - guard.q) + rng.uniform(-0.09, 0.09, len(came))
        came = guard.q
        assert guard.step(row, 1.0 / 30.0, measured=lag).q.tobytes() == q.tobytes()


# --- chunks and states


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


def test_guarding_what_is_guarded_changes_nothing():
    for name, rate in (("coman", 30.0), ("coman", 250.0), ("g1", 100.0)):
        guard = begun(name)
        m = int(3 * rate)
        dt = np.full(m, 1.0 / rate)
        once, _ = driven(guard, adversary(guard, m, rate, 12), dt)
        twice, rows = driven(begun(name), once, dt)
        assert twice.tobytes() == once.tobytes()
        assert {row.reason for row in rows} == {"as wanted"}


def test_a_planned_motion_that_could_brake_comes_back_to_the_bit():
    robot, guard = coman(), shared("coman")
    still, poses = np.repeat(robot.anchor[None], 40, axis=0), adversary(guard, 90, 30.0, 13)
    wanted = np.vstack([still, 0.7 * robot.anchor + 0.3 * poses, still])
    made = Planner(robot).plan(np.arange(len(wanted)) / 30.0, wanted).q
    again, rows = driven(begun(q=made[0]), made[1:], np.full(len(made) - 1, 1.0 / 30.0))
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


# --- reasons


def test_a_slow_joint_is_named():
    guard = begun()
    i = guard.robot.joint_names.index("LElbj")
    wanted = guard.robot.anchor.copy()
    wanted[i] += 0.7 if wanted[i] < -1.0 else -0.7
    reasons = [guard.step(wanted, 0.02).reason for _ in range(40)]
    assert reasons[0] == "slowed by LElbj" and reasons[-1] == "as wanted"
    assert (guard.q == wanted).all()


def test_a_joint_that_is_wanted_beyond_its_limits_is_held_there():
    guard = begun()
    i = guard.robot.joint_names.index("WaistYaw")
    wanted = guard.robot.anchor.copy()
    wanted[i] = guard.robot.upper[i] + 0.2
    reasons = [guard.step(wanted, 0.02).reason for _ in range(60)]
    assert reasons[0] == "slowed by WaistYaw" and reasons[-1] == "held by limits of WaistYaw"
    assert guard.q[i] == guard.robot.upper[i]


def colliding(name: str, seed: int, least: float, most: float) -> np.ndarray:
    """Poses within limits whose clearance lies between two numbers [m]."""
    robot = shared(name).robot
    q = inside_limits(robot, 3000, seed)
    d = batch.clearances(robot.chain, q)
    return q[(d > least) & (d < most)]


def test_bodies_in_the_way_are_named():
    guard = begun()
    wanted = colliding("coman", 14, -0.06, -0.03)[0]
    reasons = [guard.step(wanted, 0.02).reason for _ in range(200)]
    names = {body.name for body in guard.robot.bodies}
    kind, pair = reasons[-1].split(" by ")
    a, b = pair.split(" against ")
    assert kind == "held" and {a, b} <= names
    d = batch.pair_distances(guard.robot.chain, guard.q[None])[0]
    assert sorted([a, b]) == sorted(guard.robot.pair_name(int(d.argmin())).split(" and "))
    assert any(reason.startswith("moved away from ") for reason in reasons)
    assert not any(guard.step(wanted, 0.02).v.any() for _ in range(50))  # it stands, unshaken


# --- what is refused


@pytest.mark.parametrize(
    ("wanted", "says"),
    [
        (lambda r: np.where(np.arange(r.n_dof) == 3, np.nan, r.anchor), "{3} is not finite"),
        (lambda r: np.where(np.arange(r.n_dof) == 0, -np.inf, r.anchor), "{0} is not finite"),
        (lambda r: r.anchor[:-1], "must have shape"),
        (lambda r: r.anchor[None], "must have shape"),
        (lambda r: ["a"] * r.n_dof, "must hold numbers"),
        (lambda r: [1.0, [2.0]], "rows of one length"),
        (lambda r: dict(zip(r.joint_names[1:], r.anchor[1:], strict=True)), "lacks {0}"),
        (lambda r: dict(zip(r.joint_names, r.anchor, strict=True)) | {"LElbow": 1.0},
         "'LElbow', which is no joint of the robot; did you mean LElbj?"),
        (lambda r: np.degrees(0.5 * (r.lower + r.upper) + 0.4), "as degrees it would be"),
        (lambda r: np.where(np.arange(r.n_dof) == 4, 1e300, r.anchor), "beyond its limits"),
    ],
)  # fmt: skip
def test_what_is_no_pose_is_refused_and_the_guard_goes_on(wanted, says):
    guard = begun()
    driven(guard, adversary(guard, 10, 30.0, 15), np.full(10, 1.0 / 30.0))
    state = guard.state()
    for name in guard.robot.joint_names:
        says = says.replace(f"{{{guard.robot.joint_names.index(name)}}}", name)
    with pytest.raises(ParameterError, match=says.replace("?", r"\?")):
        guard.step(wanted(guard.robot), 1.0 / 30.0)
    assert all((guard.state()[key] == value).all() for key, value in state.items()
               if key != "before") and guard.state()["before"] == state["before"]  # fmt: skip
    assert guard.step(guard.robot.anchor, 1.0 / 30.0).certified


@pytest.mark.parametrize("dt", [0.0, -1.0, np.nan, np.inf, 1e-9, "1", True, None])
def test_what_is_no_time_is_refused(dt):
    guard = begun()
    with pytest.raises(ParameterError, match="dt must be"):
        guard.step(guard.robot.anchor, dt)


def test_a_chunk_names_its_row():
    guard = begun()
    wanted = np.repeat(guard.robot.anchor[None], 5, axis=0)
    wanted[3, 2] = np.nan
    with pytest.raises(ParameterError, match=f"row 3: {guard.robot.joint_names[2]} is not finite"):
        guard.chunk(wanted, 0.02)
    for bad, says in (
        ({"dt": [0.1, 0.2]}, "dt must be"), ({"dt": -1.0}, "dt must be"),
        ({"dt": 0.1, "advance": 6}, "advance"), ({"dt": 0.1, "advance": -1}, "advance"),
        ({"dt": 0.1, "advance": "all"}, "advance"),
    ):  # fmt: skip
        with pytest.raises(ParameterError, match=says):
            guard.chunk(np.nan_to_num(wanted), **bad)
    with pytest.raises(ParameterError, match="shape"):
        guard.chunk(wanted[:0], 0.02)


def test_joints_that_the_robot_holds_may_be_named():
    guard = begun("g1")
    named = dict(zip(guard.robot.joint_names, guard.robot.anchor, strict=True))
    assert guard.step(named | {"left_knee_joint": 0.3}, 0.02).reason == "as wanted"
    assert list(guard.robot.anchor) == list(guard.q)


def test_a_jump_is_driven_as_far_as_the_joints_can():
    guard = begun()
    far = colliding("coman", 16, 0.004, 1.0)[0]
    made = guard.step(far, 0.02)
    assert made.certified and np.abs(made.v).max() <= 60.0 * 0.02 * ROUNDED


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
    assert coman().digest == "332fb47b97d835af" and shared("g1").robot.digest == "dc65956c4e5c5e32"


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
