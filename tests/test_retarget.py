"""The retargeter: never an unproven pose or step, whatever comes in; and near the human."""

from threading import Thread

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import OneByOne
from streaming import BETWEEN, DT, SPEED, held_to_its_word, motion, retargeter, stored
from worlds import MARGIN, coman

from s3le.errors import CertificateError, ParameterError
from s3le.kernels import batch
from s3le.retarget.calm import calm, middle
from s3le.retarget.follow import follow
from s3le.retarget.refine import refine
from s3le.retarget.rows import Mode
from s3le.robot.certificate import Certifier
from s3le.safety.paths import CERTIFIED, COLLIDES, certify
from s3le.safety.swept import swept
from s3le.skeleton import cosine_distance

# --- safe, whatever comes in


BAD = {
    "nan": lambda x, rng: np.where(rng.random(21) < 0.1, np.nan, x),
    "inf": lambda x, rng: np.where(rng.random(21) < 0.1, np.inf, x),
    "zero": lambda x, rng: np.zeros(21),
    "zero vector": lambda x, rng: np.r_[np.zeros(3), x[3:]],
    "huge": lambda x, rng: x * 1e300,
    "tiny": lambda x, rng: x * 1e-7,
    "none": lambda x, rng: None,
    "noise": lambda x, rng: x + rng.normal(0.0, 0.15, 21),
    "teleport": lambda x, rng: rng.normal(size=21),
    "inside out": lambda x, rng: -x,
    "swapped": lambda x, rng: np.r_[x[:3], x[12:], x[3:12]],
    "as it is": lambda x, rng: x,
}
TIMES = {
    "30 Hz": 1.0 / 30.0, "10 kHz": 1e-4, "1 s": 1.0, "an hour": 3600.0, "none": 0.0,
    "negative": -0.1, "nan": np.nan, "inf": np.inf, "minus inf": -np.inf, "1e-300": 1e-300,
}  # fmt: skip


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    script=st.lists(
        st.tuples(st.sampled_from(sorted(BAD)), st.sampled_from(sorted(TIMES))),
        min_size=1,
        max_size=25,
    ),
    share=st.sampled_from([1.0, 0.2]),
    delay=st.booleans(),
)
def test_no_input_leads_to_an_unproven_pose_or_step(seed, script, share, delay):
    rng = np.random.default_rng(seed)
    stream = retargeter(acceleration_factor=share, delay=delay, cutoff=1.0).start()
    human = motion()
    first = int(rng.integers(len(human)))
    q, v, dts, via = [stream.step(human[first], DT).q], [stream.v], [], []
    for i, (what, when) in enumerate(script):
        dt = TIMES[when]
        with np.errstate(over="ignore"):
            x = BAD[what](human[(first + i) % len(human)], rng)
        step = stream.step(x, dt)
        q.append(step.q)
        v.append(step.v)
        via.append(step.via)
        dts.append(min(dt, 1.0) if dt >= 1e-6 else 0.0)
        assert isinstance(step.mode, Mode) and step.clearance >= MARGIN and step.bound >= BETWEEN
        assert dts[-1] or (step.mode is Mode.HELD and (step.q == q[-2]).all())
    held_to_its_word(q, v, dts, via, judged=1)


@pytest.mark.parametrize("look_ahead", [False, True])
def test_a_motion_through_the_body_is_followed_around_it(look_ahead):
    human, it = motion(240, seed=3), retargeter()
    found = follow(it, human, np.arange(len(human)) * DT, look_ahead=look_ahead)
    held_to_its_word(found.q, found.v, np.full(len(human) - 1, DT), judged=6)
    bent = np.abs(np.diff(found.v, axis=0)) / DT
    assert (bent <= it.most.acceleration * (1.0 + 1e-6)).all()
    assert (found.bound >= BETWEEN).all()
    assert {Mode.START, Mode.PLANNED if look_ahead else Mode.LIMITED} <= set(found.mode)
    assert found.mode[0] == Mode.START


def test_a_motion_that_is_known_is_followed_nearer_than_one_that_is_not():
    human, times = motion(240, seed=1), np.arange(240) * DT
    far = [
        follow(retargeter(), human, times, look_ahead=ahead).distance.mean()
        for ahead in (False, True)
    ]
    assert far[1] < 0.5 * far[0]


def test_without_the_guard_the_same_motion_breaks_every_promise():
    """Poses as refined, frame by frame: certified each, and not what lies between them."""
    made, human = coman(), motion(240, seed=3)
    balls, it, q = swept(made.chain).balls, retargeter(), []
    memory = np.zeros((2, made.n_dof))
    for i, x in enumerate(human):
        refine(
            made.chain, balls, x, it.propose(x), memory[0], memory[0], i > 0, it.rule,
            memory[1], np.zeros(3),
        )  # fmt: skip
        memory[0] = memory[1]
        q.append(memory[1].copy())
    q = np.array(q)
    assert (made.certifier().check(q).clearance >= MARGIN).all()
    assert (certify(made, q, BETWEEN).status == COLLIDES).any()
    assert (np.abs(np.diff(q, axis=0)) > SPEED * DT).any()


def test_with_no_budget_for_a_proof_it_only_does_what_the_whole_proof_allows():
    """An undecided path is none: without a second look many are, and none of them is gone."""
    it = retargeter(budget=0)
    steps, modes = 0, set()
    for seed in (1, 3, 7):
        found = follow(it, motion(240, seed=seed), np.arange(240) * DT, look_ahead=False)
        proven = certify(coman(), found.q, BETWEEN, budget=0)
        assert (proven.status == CERTIFIED).all()
        assert (certify(coman(), found.q, BETWEEN).status == CERTIFIED).all()
        assert (found.bound[1:] >= BETWEEN).all()
        steps, modes = steps + len(proven.status), modes | set(found.mode)
    assert steps == 717 and {Mode.BRAKED, Mode.SHORTENED} & modes


@pytest.mark.parametrize(
    "clearance, room, taken",
    [
        (0.0, 0.1, False), (MARGIN - 1e-12, 0.1, False), (MARGIN, 0.0, True), (MARGIN, 0.1, True),
        (np.nan, 0.1, False), (0.1, np.nan, False), (0.1, -1e-12, False), (np.nan, np.nan, False),
    ],
)  # fmt: skip
def test_a_pose_that_only_the_independent_check_refuses_is_not_taken(
    monkeypatch, clearance, room, taken
):
    stream = retargeter().start()
    first = stream.step(motion()[0], DT)
    monkeypatch.setattr(stream._walker._certifier, "one", lambda q: (clearance, room))
    second = stream.step(motion()[40], DT)
    if taken:
        assert second.mode is not Mode.HELD and (second.q != first.q).any()
        assert second.clearance == clearance
    else:
        assert second.mode is Mode.HELD and (second.q == first.q).all()
        assert second.clearance == first.clearance == second.bound


def refusing(monkeypatch, clearance, room, row):
    """Let the independent check say this of one row of whatever it is shown."""
    check = Certifier.check

    def seen(self, q, progress=None):
        report = check(self, q, progress)
        if len(q) <= row:
            return report
        report.clearance[row], report.limit_margin[row] = clearance, room
        return report

    monkeypatch.setattr(Certifier, "check", seen)


BAD_REPORTS = [(0.0, 0.1), (0.0019, 0.1), (np.nan, 0.1), (0.1, np.nan), (0.1, -1e-9)]


@pytest.mark.parametrize("clearance, room", BAD_REPORTS)
def test_a_first_pose_that_the_independent_check_refuses_is_none(monkeypatch, clearance, room):
    stream = retargeter().start()
    refusing(monkeypatch, clearance, room, 0)
    with pytest.raises(CertificateError):
        stream.step(motion()[0], DT)
    assert stream.q is None


@pytest.mark.parametrize("clearance, room", BAD_REPORTS)
def test_of_a_stream_a_pose_that_the_independent_check_refuses_is_not_taken(
    monkeypatch, clearance, room
):
    one, calls = Certifier.one, []

    def seen(self, q):
        calls.append(q.copy())
        return (clearance, room) if len(calls) == 4 else one(self, q)

    it = retargeter()
    it.start()
    monkeypatch.setattr(Certifier, "one", seen)
    found = follow(it, motion()[:10], np.arange(10) * DT, look_ahead=False)
    assert len(calls) > 4 and found.mode[4] in (Mode.BRAKED, Mode.HALTED)
    assert not (found.q == calls[3]).all(axis=1).any()


@pytest.mark.parametrize("clearance, room", BAD_REPORTS)
def test_a_motion_with_a_pose_that_the_independent_check_refuses_is_none(
    monkeypatch, clearance, room
):
    it = retargeter()
    refusing(monkeypatch, clearance, room, 6)
    with pytest.raises(CertificateError):
        follow(it, motion()[:10], np.arange(10) * DT)


# --- near the human


def test_refining_comes_near_the_best_there_is_and_never_falls_behind_the_look_up():
    """The best is that of 20 starts by a solver that shares no line with ours."""
    made, it = coman(), retargeter()
    other = OneByOne(made, MARGIN)
    starts = np.concatenate([made.anchor[None], stored()[0][:19]])
    x = motion(240, seed=7)[5::80]
    last, q, out, apart = np.zeros(11), np.zeros(11), np.zeros(3), []
    for row in x:
        proposed = it.propose(row)
        it.refine(row, proposed, last, last, False, q, out)
        assert out[0] <= out[1] < np.inf
        mine = batch.skeletons(made.chain, q[None])
        best = batch.skeletons(made.chain, other.optimum(row, starts)[None])
        apart.append(cosine_distance(mine, best)[0])
    assert np.mean(apart) <= 0.01


def test_a_still_human_is_reached_and_then_nothing_moves():
    x = motion()[0]
    stream = retargeter().start(coman().anchor)
    steps = [stream.step(x, DT) for _ in range(90)]
    assert {Mode.LEAD_IN, Mode.REFINED} <= {step.mode for step in steps}
    assert steps[-1].distance == pytest.approx(steps[-1].wanted, abs=1e-6)
    assert np.abs(steps[-1].q - steps[-2].q).max() < 1e-3  # [rad]


# --- calm


@pytest.mark.parametrize("look_ahead", [False, True])
def test_no_joint_changes_its_speed_faster_than_it_may(look_ahead):
    it, x = retargeter(acceleration_factor=1.0 / 3.0), motion()
    human = np.array([x[i // 10 * 10] for i in range(60)])
    found = follow(it, human, np.arange(60) * DT, look_ahead=look_ahead)
    change = np.abs(np.diff(found.q, n=2, axis=0)) / DT**2
    assert 19.0 < change.max() <= 20.0 * (1 + 1e-9)  # [rad/s^2]


def test_one_odd_frame_goes_unseen_with_a_frame_of_delay():
    x = motion()[10]
    odd = np.r_[x[:3], x[12:], x[3:12]]  # left and right swapped
    for delay in (False, True):
        stream = retargeter(delay=delay).start()
        for _ in range(40):
            before = stream.step(x, DT).q
        moved = max(np.abs(stream.step(v, DT).q - before).max() for v in (odd, x, x))
        assert (moved < 1e-3) == delay  # [rad]


def test_the_middle_of_three_frames_is_one_of_them():
    a, b, c = (np.tile(v, 7) for v in np.eye(3))
    out = np.empty(21)
    middle(a, a, c, out)
    assert (out == a).all()
    middle(a, c, a, out)
    assert (out == a).all()
    middle(c, a, a, out)
    assert (out == a).all()
    near = a + 0.1 * b
    middle(a, b, near, out)
    assert (out == near).all()


def test_the_filter_lets_nothing_through_that_is_not_a_direction():
    rng = np.random.default_rng(3)
    kept, rate = np.tile([1.0, 0.0, 0.0], 7), np.zeros(21)
    for _ in range(200):
        x = rng.normal(size=(7, 3))
        x /= np.linalg.norm(x, axis=1, keepdims=True)
        calm(x.ravel(), 10.0 ** rng.uniform(-6, 0), 1.0, 0.5, kept, rate)
        assert np.abs(np.linalg.norm(kept.reshape(7, 3), axis=1) - 1.0).max() < 1e-12
    calm(-kept, 1.0, 1e3, 0.0, kept, rate)
    assert np.isfinite(kept).all()


# --- streams


def test_a_motion_is_followed_as_a_stream_would():
    x = motion()[:40].copy()
    x[7] = np.nan
    times = np.cumsum(np.full(40, DT))
    found = follow(retargeter(), x, times, look_ahead=False)
    stream = retargeter().start()
    for i in range(40):
        step = stream.step(x[i], times[i] - times[i - 1] if i else DT)
        assert (step.q == found.q[i]).all() and step.mode == found.mode[i]
    assert found.mode[7] == Mode.DROPPED


@pytest.mark.parametrize("look_ahead", [False, True])
def test_a_motion_may_begin_with_frames_that_cannot_be_used(look_ahead):
    x, times, it = motion()[5:30].copy(), np.arange(25) * DT, retargeter()
    x[:3] = np.nan
    found = follow(it, x, times, look_ahead=look_ahead)
    assert (found.mode[:3] == Mode.DROPPED).all() and found.mode[3] == Mode.START
    assert np.isnan(found.distance[:3]).all() and np.isfinite(found.distance[3:]).all()
    held_to_its_word(found.q, found.v, np.diff(times))
    # It does not start at speed where it is first seen, though the human moves by then.
    bent = np.abs(np.diff(found.v, axis=0)) / DT
    assert (bent <= it.most.acceleration * (1.0 + 1e-6)).all()
    assert look_ahead or not found.v[:4].any()


@pytest.mark.parametrize("look_ahead", [False, True])
def test_a_lead_in_goes_from_the_given_pose_to_the_first_frame(look_ahead):
    x, anchor, it = motion()[:20], coman().anchor, retargeter()
    times = np.arange(20) * DT
    found = follow(it, x, times, start=anchor, lead_in=1.0, look_ahead=look_ahead)
    assert len(found.q) == 51 and found.time[0] == 0.0 and found.clip_from == 31
    assert found.offset == pytest.approx(31 * DT)
    assert found.mode[0] == Mode.START and set(found.mode[1:31]) == {Mode.LEAD_IN}
    assert (found.q[0] == anchor).all()
    assert not found.v[0].any()
    held_to_its_word(found.q, found.v, np.full(50, DT))
    bent = np.abs(np.diff(found.v, axis=0)) / DT
    assert (bent <= it.most.acceleration * (1.0 + 1e-6)).all()


def test_the_lead_in_is_no_frame_to_the_bar():
    told = []
    for look_ahead in (False, True):
        follow(
            retargeter(), motion()[:20], np.arange(20) * DT, lead_in=0.5, look_ahead=look_ahead,
            progress=told.append,
        )  # fmt: skip
    assert sum(told) == 40


def test_streams_do_not_disturb_each_other():
    it, human = retargeter(), motion()

    def run(shift):
        stream = it.start()
        return np.array([stream.step(x, DT).q for x in human[shift:]])

    alone = [run(shift) for shift in (0, 10)]
    together = [None, None]

    def work(i):
        together[i] = run(10 * i)

    threads = [Thread(target=work, args=(i,)) for i in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all((a == b).all() for a, b in zip(alone, together, strict=True))


def test_a_stream_can_be_reset():
    stream, x = retargeter().start(), motion()
    first = [stream.step(v, DT).q for v in x[:5]]
    stream.reset()
    again = [stream.step(v, DT).q for v in x[:5]]
    assert (np.array(first) == np.array(again)).all()


def test_what_is_not_a_frame_is_refused_and_the_stream_goes_on():
    stream = retargeter().start()
    with pytest.raises(ParameterError, match="first frame of a stream has no seven finite vectors"):
        stream.step(np.full(21, np.nan), DT)
    stream.step(motion()[0], DT)
    for bad, words in ((np.zeros(20), r"shape \(21,\) or \(7, 3\), got \(20,\)"), ("x", "numbers")):
        with pytest.raises(ParameterError, match=words):
            stream.step(bad, DT)
    with pytest.raises(ParameterError, match="dt must be a number, got 'soon'"):
        stream.step(motion()[1], "soon")
    assert stream.step(motion()[1], DT).clearance >= MARGIN


def test_a_robot_that_collides_cannot_start():
    with pytest.raises(CertificateError, match="apart, wanted at least 2.0000 mm"):
        retargeter().start(np.zeros(11))


@pytest.mark.parametrize(
    "changed, words",
    [
        ({"target": 0.001}, "ordered between <= margin <= target"),
        ({"between": 0.003}, "ordered between <= margin <= target"),
        ({"k": 0}, r"k must be in \[1, 1000\]"),
        ({"k": 2.5}, "k must be a whole number"),
        ({"speed_factor": float("nan")}, "speed_factor must be in"),
        ({"check": 1}, "check must be true or false"),
    ],
)
def test_settings_that_make_no_sense_are_refused(changed, words):
    with pytest.raises(ParameterError, match=words):
        retargeter(**changed)
