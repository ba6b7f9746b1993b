"""Streams among joints that others move: known or bounded, proven, giving way, forced.

The judge is coal, all joints moving, at samples of what ours and the others did.
"""

import json
from functools import cache

import numpy as np
import pytest
from test_guard_live import sent
from test_wholebody import BETWEEN, LEGS, MARGIN, g1, hanging, legged, raised
from worlds import coman

from s3le.errors import CertificateError, ParameterError, RobotError, StateError
from s3le.guard.guard import Guard
from s3le.guard.live import LiveJoints
from s3le.kernels import batch
from s3le.plan import amid
from s3le.plan.amid import Amid
from s3le.retarget.propose import LookUp
from s3le.retarget.rows import Mode
from s3le.retarget.settings import Settings
from s3le.retarget.stream import Retargeter
from s3le.robot.wholebody import movable, whole_body
from s3le.safety.folded import Folded
from s3le.safety.segment import UNDECIDED
from s3le.search import neighbours

WAIST = ("waist_yaw_joint", "waist_roll_joint", "waist_pitch_joint")
RATE = 100.0


@cache
def guard() -> Guard:
    return Guard(g1(), given=LEGS)


@cache
def everything():
    return whole_body(g1(), movable(g1()))


def arms_only():
    """A robot that decides its arms; the waist is given, and carries them."""
    from dataclasses import replace

    from s3le.robot import model
    from s3le.robot.robot import Robot

    text = g1().description
    own = tuple(name for name in text.joints if name not in WAIST)
    anchor = {name: angle for name, angle in text.anchor.items() if name in own}
    made = model.from_description(
        replace(
            text,
            joints=own,
            anchor=anchor,
            hold=text.hold | dict.fromkeys(WAIST, 0.0),
            stand={},
            acceleration={},
        )
    )
    return Robot._settled(made, text.source, MARGIN, g1().neck)


def least(body, q, given, samples=12):
    """Least clearance that coal finds in each step of ours (m, n) among theirs (m, k) [m]."""
    whole = body.poses(q, given)
    share = np.linspace(0.0, 1.0, samples + 1)[:, None, None]
    poses = (1.0 - share) * whole[:-1] + share * whole[1:]
    flat = poses.reshape(-1, whole.shape[1])
    return body.robot.certifier().check(flat).clearance.reshape(samples + 1, -1).min(axis=0)


def streamed(wanted, legs, rate=RATE, speed=None, its=None):
    """Ours through a guard, legs known or no faster than `speed`; steps, and where ours went."""
    its = its or guard()
    its.start(wanted[0], legs[0])
    q, steps = [its.q], []
    for i in range(1, len(wanted)):
        said = {"given_next": legs[i]} if speed is None else {"given_speed": speed}
        steps.append(its.step(wanted[i], 1.0 / rate, given=legs[i - 1], **said))
        q.append(steps[-1].q)
    return steps, np.array(q)


@pytest.mark.parametrize("body", [everything, lambda: whole_body(arms_only(), WAIST + LEGS)])
def test_a_folded_chain_measures_what_the_whole_one_does(body):
    body, rng = body(), np.random.default_rng(4)
    made, base = Folded(body), body.base
    q = rng.uniform(base.lower, base.upper, (200, base.n_dof))
    held = body.robot.anchor[body.others]
    made.stand(held)
    np.testing.assert_allclose(
        batch.clearances(made.chain, q), batch.clearances(base.chain, q), atol=1e-12
    )
    low, high = body.robot.lower[body.others], body.robot.upper[body.others]
    for _ in range(4):
        given = rng.uniform(low, high)
        made.stand(given)
        whole = body.poses(q, np.tile(given, (len(q), 1)))
        there = batch.clearances(body.robot.chain, whole)
        np.testing.assert_allclose(batch.clearances(made.chain, q), there, atol=1e-12)
        np.testing.assert_allclose(
            batch.skeletons(made.chain, q), batch.skeletons(body.robot.chain, whole), atol=1e-9
        )


@pytest.mark.parametrize("body", [everything, lambda: whole_body(arms_only(), WAIST + LEGS)])
def test_thicker_bodies_contain_all_that_others_may_do(body):
    body, rng = body(), np.random.default_rng(5)
    made, base = Folded(body), body.base
    q = rng.uniform(base.lower, base.upper, (100, base.n_dof))
    low, high = body.robot.lower[body.others], body.robot.upper[body.others]
    tight = np.inf
    for _ in range(20):
        given, within = rng.uniform(low, high), rng.uniform(0.0, 0.1, len(low))
        made.stand(given, within)
        bound = batch.clearances(made.chain, q)
        for signs in rng.choice([-1.0, 0.3, 1.0], (20, len(low))):
            there = body.poses(q, np.tile(given + signs * within, (len(q), 1)))
            gap = batch.clearances(body.robot.chain, there) - bound
            assert gap.min() >= -1e-12
            tight = min(tight, gap[gap > 1e-9].min(initial=np.inf))
    assert tight < 1e-3  # it is no thicker than it has to be: somewhere it is nearly reached


def test_arms_alone_are_not_made_thicker_for_a_waist_that_carries_them():
    body = whole_body(arms_only(), WAIST)
    made = Folded(body)
    q, given = body.base.anchor[None], body.robot.anchor[body.others]
    made.stand(given)
    plain = batch.pair_distances(made.chain, q)[0]
    made.stand(given, np.full(len(given), 0.05))
    lost = plain - batch.pair_distances(made.chain, q)[0]
    links = [
        {body.base.bodies[one].link for one in pair} for pair in body.base.watched.tolist()
    ]  # fmt: skip
    trunk = [lost[i] for i, two in enumerate(links) if "torso_link" in two]
    legs = [lost[i] for i, two in enumerate(links) if any("hip" in one for one in two)]
    assert np.abs(trunk).max() < 1e-12 and min(legs) > 1e-3


def test_a_thigh_that_comes_up_is_given_way_to_and_every_certified_step_holds():
    wanted, legs = hanging(200), raised(200)
    steps, q = streamed(wanted, legs)
    good = np.array([step.certified for step in steps])
    found = least(legged(), q, legs)
    assert good.all() and found.min() >= BETWEEN
    assert legged().robot.certifier().check(legged().poses(q, legs)).clearance.min() >= MARGIN
    # Today's certificate, legs standing where they are held, is broken by the same motion.
    assert least(legged(), wanted, legs).min() < -0.01
    plain = Guard(g1())
    plain.start(wanted[0])
    alone = np.array([plain.step(row, 1.0 / RATE).q for row in wanted])
    assert least(legged(), alone, legs).min() < -0.01


def test_limits_speeds_and_accelerations_of_ours_hold_in_every_step():
    its = guard()
    for far in (1.5, 2.4):
        steps, q = streamed(hanging(60), raised(60, far), rate=60.0)
        v = np.diff(q, axis=0) * 60.0
        a = np.diff(np.concatenate([np.zeros((1, v.shape[1])), v]), axis=0) * 60.0
        assert (np.abs(v) <= its.most.speed * (1 + 1e-9)).all()
        assert (np.abs(a) <= its.most.acceleration * (1 + 1e-6)).all()
        assert (q >= its.most.lower).all() and (q <= its.most.upper).all()


@pytest.mark.parametrize("rate", [30.0, 100.0, 250.0])
def test_whatever_others_do_within_their_bounds_a_certified_step_holds(rate):
    rng, body = np.random.default_rng(int(rate)), legged()
    rows, speed = 150, 0.8
    low, high = body.robot.lower[body.others], body.robot.upper[body.others]
    wanted, legs = hanging(rows), np.zeros((rows, len(LEGS)))
    drift = rng.choice([-1.0, 1.0], len(LEGS))
    for i in range(1, rows):  # as fast as they may, turning now and then
        drift = np.where(rng.random(len(LEGS)) < 0.03, -drift, drift)
        legs[i] = np.clip(legs[i - 1] + drift * speed / rate, low, high)
    steps, q = streamed(wanted, legs, rate, speed)
    good = np.array([step.certified for step in steps])
    assert good.mean() > 0.7
    assert least(body, q, legs)[good].min() >= BETWEEN
    # Not only on the way that they took: anywhere that they could have got to in the step.
    for i in np.flatnonzero(good)[::7]:
        for signs in rng.choice([-1.0, 1.0], (10, len(LEGS))):
            there = legs[i] + signs * speed / rate
            assert least(body, q[i : i + 2], np.stack([legs[i], there])).min() >= BETWEEN


def test_what_is_not_decided_is_never_certified(monkeypatch):
    its = guard()
    its.start(None, np.zeros(len(LEGS)))
    monkeypatch.setattr(amid, "prove", lambda *_: (UNDECIDED, np.nan, 0.0, np.nan, -1, np.nan, 0))
    step = its.step(g1().anchor, 0.01, given_next=np.zeros(len(LEGS)))
    assert not step.certified and step.reason.startswith("forced") and np.isnan(step.bound)


def test_a_pose_that_coal_refuses_is_never_certified(monkeypatch):
    its = guard()
    its.start(None, np.zeros(len(LEGS)))
    for coal in (its._walker._coal, its._walker._coal_all):
        monkeypatch.setattr(coal, "one", lambda q: (MARGIN - 1e-9, 1.0))
    step = its.step(g1().anchor, 0.01, given_next=np.zeros(len(LEGS)))
    assert not step.certified and step.reason.startswith("forced")


def test_where_nothing_is_left_the_step_is_forced_with_the_pair_and_how_deep():
    """A thigh at 40 rad/s; and no arm pose that can be reached would have a proven path."""
    wanted, legs = hanging(12), raised(12)
    steps, q = streamed(wanted, legs, rate=120.0)
    bad = [i for i, step in enumerate(steps) if not step.certified]
    assert bad and all(
        steps[i].reason.startswith("forced: ") and " and " in steps[i].reason for i in bad
    )
    assert any("overlap by" in steps[i].reason for i in bad)
    rng, body, its = np.random.default_rng(0), legged(), guard()
    prover = Amid(body, its.most, its.settings, q=g1().anchor, given=legs[0])
    open_ways = 0
    for i in bad:
        v = (q[i] - q[i - 1]) * 120.0 if i else np.zeros(q.shape[1])
        reach = its.most.acceleration / 120.0
        low = np.maximum(q[i] + (v - reach) / 120.0, its.most.lower)
        high = np.minimum(q[i] + (v + reach) / 120.0, its.most.upper)
        prover.others(legs[i], then=legs[i + 1])
        prover.see()
        drawn = rng.uniform(low, high, (1000, len(low)))
        whole = body.poses(drawn, np.tile(legs[i + 1], (1000, 1)))
        clear = drawn[batch.clearances(body.robot.chain, whole) >= MARGIN]
        open_ways += any(prover._clear_path(q[i], one) for one in clear)
    assert open_ways <= 0.05 * len(bad)


def test_a_start_in_collision_is_forced_until_it_is_clear():
    legs = np.repeat(raised()[30:31], 100, axis=0)
    steps, q = streamed(hanging(100), legs)
    good = np.array([step.certified for step in steps])
    first = int(np.argmax(good))
    assert 0 < first < 60 and not good[:first].any() and good[first:].all()
    assert steps[0].reason.startswith("forced: ") and "overlap by" in steps[0].reason


def test_bodies_that_given_joints_alone_move_are_named_and_not_certified():
    legs = np.zeros((40, len(LEGS)))
    ramp = np.linspace(0.0, 0.4, 40)
    legs[:, 2], legs[:, 5] = -ramp, ramp
    steps, _ = streamed(np.repeat(g1().anchor[None], 40, axis=0), legs)
    assert steps[0].certified and not steps[-1].certified
    assert steps[-1].reason.startswith("forced, not ours to change: left_")


def test_others_who_do_not_keep_their_word_are_named_with_the_next_step():
    its, still = guard(), np.zeros(len(LEGS))
    its.start(None, still)
    assert its.step(g1().anchor, 0.01, given=still, given_speed=1.0).given == ""
    off = still.copy()
    off[1] = 0.05
    said = its.step(g1().anchor, 0.01, given=off, given_speed=1.0).given
    assert "left_knee_joint is 0.0500 rad from where it was, 0.0100 rad were allowed" in said
    assert its.step(g1().anchor, 0.01, given=off, given_next=off).given == ""
    off[1] = 0.3
    assert "said to be" in its.step(g1().anchor, 0.01, given=off, given_next=off).given


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({}, "given_next (where they will be) or given_speed"),
        ({"given_speed": 1.0}, "given (where they are) is missing"),
        ({"given_next": np.zeros(6), "given_speed": 1.0}, "not both"),
        ({"given_next": np.zeros(5)}, "must have shape (6,)"),
        ({"given_next": np.full(6, np.nan)}, "is not finite"),
        ({"given_next": np.full(6, 40.0)}, "give radians"),
        ({"given_next": {"left_knee_joint": 0.1}}, "lacks left_hip_pitch_joint"),
        ({"given": np.zeros(6), "given_speed": -1.0}, "at least 0"),
        ({"given": np.zeros(6), "given_speed": "fast"}, "must be a number"),
        ({"given": "there", "given_next": np.zeros(6)}, "must hold numbers"),
    ],
)
def test_what_is_said_of_given_joints_must_be_enough_and_a_pose(said, words):
    its = guard()
    its.start(None, np.zeros(6))
    before = its.state()
    with pytest.raises(ParameterError) as refused:
        its.step(g1().anchor + 0.1, 0.01, **said)
    assert words in str(refused.value)
    after = its.state()
    assert all(np.array_equal(before[key], after[key], equal_nan=True) for key in before
               if before[key].dtype.kind != "U")  # fmt: skip


def test_a_start_beyond_limits_is_refused_and_nothing_has_changed():
    its, far = guard(), g1().anchor.copy()
    its.start(hanging()[0], np.zeros(6))
    far[0] = its.most.upper[0] + 0.3
    with pytest.raises(CertificateError, match=r"0\.3000 rad beyond its limits"):
        its.start(far, np.zeros(6))
    np.testing.assert_array_equal(its.q, hanging()[0])


def test_in_a_step_of_many_seconds_others_may_get_as_far_as_they_say():
    """Ours are moved as in one second; where the others may be counts all of them."""
    its, still = guard(), np.zeros(6)
    its.start(g1().anchor, still)
    assert its.step(None, 1.0, given=still, given_speed=0.01).certified
    its.step(None, 9.0, given=still, given_speed=0.01)
    np.testing.assert_allclose(its._walker._within, 0.09)
    its.start(g1().anchor, still)
    its.chunk(g1().anchor[None].repeat(3, axis=0), 4.0, given=still, given_speed=0.01, advance=True)
    assert (
        "0.1200 rad were allowed"
        in its.step(None, 0.01, given=still + 0.2, given_next=still + 0.2).given
    )


def test_a_chunk_that_is_only_asked_for_takes_nobody_from_his_word():
    its, still = guard(), np.zeros(6)
    its.start(g1().anchor, still)
    its.step(None, 0.01, given=still, given_speed=1.0)
    its.chunk(g1().anchor[None], 0.01, given=still, given_next=still[None])
    assert (
        "0.0100 rad were allowed"
        in its.step(None, 0.01, given=still + 0.05, given_next=still + 0.05).given
    )


def test_given_joints_by_name_may_be_among_all_joints_of_the_robot():
    its, every = guard(), dict.fromkeys([*g1().joint_names, *movable(g1())], 0.0)
    its.start(None, every)
    assert its.step(g1().anchor, 0.01, given=every, given_next=every).certified


def test_a_guard_without_given_joints_takes_nothing_of_them():
    its = Guard(coman())
    with pytest.raises(ParameterError, match="no joint of the robot is given"):
        its.step(coman().anchor, 0.01, given_next=np.zeros(3))
    with pytest.raises(ParameterError, match="no joint of the robot is given"):
        Guard(coman(), given_speed=1.0)
    with pytest.raises(ParameterError, match="names of joints"):
        Guard(coman(), given="some")
    with pytest.raises(RobotError, match="no_such"):
        Guard(g1(), given=["no_such"])


def test_a_chunk_is_what_so_many_steps_are():
    its, legs = guard(), raised(60)[20:40]
    wanted = hanging(20)
    its.start(wanted[0], legs[0])
    chunk = its.chunk(wanted[1:], 0.02, given=legs[0], given_next=legs[1:])
    asked = its.state()
    steps, q = streamed(wanted, legs, rate=50.0)
    np.testing.assert_array_equal(chunk.q, q[1:])
    assert chunk.reason == tuple(step.reason for step in steps)
    np.testing.assert_array_equal(asked["q"], wanted[0])  # nothing was driven


def test_in_a_chunk_what_others_may_do_grows_with_time():
    its, still = guard(), np.zeros(len(LEGS))
    its.start(hanging()[0], still)
    chunk = its.chunk(hanging(30), 0.02, given=still, given_speed=1.0)
    body = legged()
    good = np.flatnonzero(chunk.certified)
    assert len(good) > 3
    q = np.concatenate([hanging()[:1], chunk.q])
    rng = np.random.default_rng(2)
    for i in good:
        for signs in rng.choice([-1.0, 1.0], (20, len(LEGS))):
            there = np.tile(signs * 0.02 * (i + 1), (2, 1))
            assert least(body, q[i : i + 2], there, samples=4).min() >= BETWEEN


def test_a_state_goes_on_where_it_was_and_another_robots_is_refused():
    its, legs = guard(), raised(40)
    streamed(hanging(20), legs[:20])
    state = its.state()
    on = [its.step(hanging()[0], 0.01, given_next=row).q for row in legs[20:]]
    its.restore(state)
    again = [its.step(hanging()[0], 0.01, given_next=row).q for row in legs[20:]]
    np.testing.assert_array_equal(on, again)
    with pytest.raises(StateError, match="is of"):
        Guard(g1(), given=LEGS[:3]).restore(state | {"given": np.zeros(3)})
    with pytest.raises(CertificateError, match="beyond the robot's limits"):
        its.restore(state | {"q": state["q"] + 9.0})


def test_lines_say_what_given_joints_do_and_the_greeting_names_them():
    live = LiveJoints(guard(), 100.0)
    guard().start()
    assert json.loads(live.greeting())["given"] == list(LEGS)
    still = [0.0] * len(LEGS)
    line = {"q": g1().anchor.tolist(), "given": still, "given_next": still}
    assert sent(live, line)["certified"]
    assert "given_next" in sent(live, {"q": g1().anchor.tolist()})["error"]
    assert "is not finite" in sent(live, line | {"given_next": [np.nan] * 6})["error"]


def test_a_human_is_followed_among_legs_that_move():
    pose = hanging(1)[0]
    rows = np.stack([g1().anchor, pose])
    seen = batch.skeletons(g1().chain, rows)
    look = LookUp(rows, neighbours.build(seen.astype(np.float32), "l2"), 2, None)
    stream = Retargeter(g1(), look, Settings()).start(pose, given=LEGS)
    legs, q, modes = raised(150), [pose], []
    for i in range(1, len(legs)):
        step = stream.step(seen[1], 0.01, given=legs[i - 1], given_next=legs[i])
        q.append(step.q)
        modes.append(step.mode)
    assert Mode.FORCED not in modes
    assert least(legged(), np.array(q), legs).min() >= BETWEEN
    with pytest.raises(ParameterError, match="given_next"):
        stream.step(seen[1], 0.01)
    assert stream.step(seen[1], np.nan).mode is Mode.HELD  # no time: nothing is asked of others
    still = np.zeros(len(LEGS))
    said = stream.step(seen[1], 0.01, given=still + 0.3, given_next=still + 0.3)
    assert "said to be" in said.given


def test_a_frame_that_is_dropped_before_a_human_is_seen_may_be_forced_too():
    seen = batch.skeletons(g1().chain, g1().anchor[None]).astype(np.float32)
    look = LookUp(g1().anchor[None], neighbours.build(seen, "l2"), 1, None)
    stream = Retargeter(g1(), look, Settings()).start(hanging()[0], given=LEGS)
    up = raised()[30]
    assert stream.step(None, 0.01, given=up, given_next=up).mode is Mode.FORCED
    with pytest.raises(CertificateError, match="beyond its limits"):
        stream.reset(hanging()[0] + 9.0)
