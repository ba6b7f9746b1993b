"""The independent judge: it sees what is wrong, and in what is certified it sees nothing."""

import json
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from streaming import motion, retargeter, stored
from worlds import MARGIN, coman, inside_limits

from s3le.errors import ParameterError
from s3le.robot.certificate import placements
from s3le.safety.paths import CERTIFIED, certify

ROOT = Path(__file__).parents[1]
NAMES = (
    "engines", "continuous", "judging", "streams", "plans", "joints", "shards", "hunt", "run",
    "among",
)  # fmt: skip
STEPS, STEPS_BY_MUJOCO, STEPS_BY_HPP, STEPS_UNGUARDED = 3000, 500, 150, 250
SAME = 1e-9  # [m], two engines on the same capsules


@pytest.fixture(scope="module")
def rooms():
    """The modules of benchmarks/judge."""
    for name in NAMES:
        sys.modules.pop(name, None)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "benchmarks/judge"))
        yield SimpleNamespace(**{name: __import__(name) for name in NAMES})
    for name in NAMES:
        sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def coal(rooms):
    promise = rooms.judging.promise_of(retargeter())
    return rooms.judging.Judge(coman(), promise, rooms.engines.Coal(coman(), promise.between))


@pytest.fixture(scope="module")
def mujoco(rooms):
    pytest.importorskip("mujoco")
    promise = rooms.judging.promise_of(retargeter())
    return rooms.judging.Judge(coman(), promise, rooms.engines.Mujoco(coman(), promise.between))


@pytest.fixture(scope="module")
def hpp(rooms):
    pytest.importorskip("pyhpp")
    return rooms.continuous.Continuous(coman(), retargeter().settings.between)


def scripts(rooms):
    """Streams without end: motions through the body and hostile input, by two retargeters."""
    its = retargeter(), retargeter(target=MARGIN, check=False)
    for number in range(10_000):
        it, kind = its[number // 2 % 2], ("random", "adversarial")[number % 2]
        yield it, rooms.streams.draw(kind, it, np.random.default_rng([7, number]))


@pytest.fixture(scope="module")
def steps(rooms):
    """The first steps of them: the script's steps, and which of them."""
    found = []
    for it, script in scripts(rooms):
        made = rooms.streams.drive(it, script)
        found += [(made, i) for i in range(len(made.q1))]
        if len(found) >= STEPS:
            return found[:STEPS]
    raise AssertionError("too few steps")


def heard(judge, rows):
    """The verdicts, and how often each promise was broken."""
    seen = [judge.step(*row) for row in rows]
    return seen, Counter(kind for one in seen for kind in one.broken)


# --- what the retargeter does


def test_coal_sees_no_broken_promise_in_thousands_of_steps_near_contact(coal, steps):
    seen = [made.judged(coal, i) for made, i in steps]
    assert not breaks(seen)
    assert 0.999 < max(one.hardest for one in seen) <= 1.0 + 1e-9
    near = np.mean([one.clearance < 0.005 for one in seen])
    assert len(seen) == STEPS and near > 0.5  # [m]
    assert min(one.clearance for one in seen) < MARGIN  # some pass where no pose may stay
    assert max(one.speed for one in seen) > 0.999  # and as fast as joints may turn
    modes = Counter(made.mode[i] for made, i in steps)
    assert len(modes) >= 8 and modes["stop"] > STEPS / 20
    curves = np.mean([len(made.rows[i]) > 0 for made, i in steps])
    assert curves > 0.9  # but where no time passed


def test_mujoco_sees_no_broken_promise_either(mujoco, coal, steps):
    rows = steps[:: STEPS // STEPS_BY_MUJOCO]
    seen = [made.judged(mujoco, i) for made, i in rows]
    assert not breaks(seen) and len(seen) == STEPS_BY_MUJOCO
    for (made, i), one in list(zip(rows, seen, strict=True))[::10]:
        other = made.judged(coal, i)
        assert one.poses == other.poses and abs(one.clearance - other.clearance) < SAME


def refusals(hpp, rows):
    """Of each path: is it refused, and how close is it by coal where it is?"""
    checker, out = coman().certifier(), []
    for q0, q1 in rows:
        said = hpp.path(q0, q1)
        pose = q0 if said.free else (1.0 - said.t) * q0 + said.t * q1
        out.append((not said.free, checker.check(pose[None]).clearance[0]))
    return out


def test_hpp_proves_every_step_too(rooms, coal, steps):
    pytest.importorskip("pyhpp")
    between = retargeter().settings.between - rooms.streams.SAG
    prover, looked = rooms.continuous.Continuous(coman(), between), 0
    for made, i in steps[:: STEPS // STEPS_BY_HPP]:
        chords = made.chords(coal, i)
        looked += 1
        if np.isfinite(chords).all():
            pairs = list(zip(chords, chords[1:], strict=False))
            assert not any(refused for refused, _ in refusals(prover, pairs))
    assert looked == STEPS_BY_HPP


def test_with_the_guard_off_hpp_refuses_what_the_proof_refuses_and_coal_says_why(hpp, steps):
    rows = [(made.free0[i], made.free1[i]) for made, i in steps[:: STEPS // STEPS_UNGUARDED]]
    between, found = retargeter().settings.between, refusals(hpp, rows)
    for (q0, q1), (refused, clearance) in zip(rows, found, strict=True):
        assert refused == (certify(coman(), np.stack([q0, q1]), between).status[0] != CERTIFIED)
        assert not refused or clearance < between
    assert sum(refused for refused, _ in found) > len(rows) / 50


def test_hpp_is_given_the_robot_whose_paths_it_is_to_prove(hpp):
    """Bisected: where it finds two bodies too close, coal finds them at the margin of paths."""
    anchor, down, between = coman().anchor, np.zeros(11), retargeter().settings.between
    checker = coman().certifier()
    for end in (down, *inside_limits(coman(), 12, 3)):
        clear, close = anchor, end
        if hpp.path(close, close).free:
            continue
        for _ in range(50):
            middle = (clear + close) / 2
            clear, close = (middle, close) if hpp.path(middle, middle).free else (clear, middle)
        assert checker.check(clear[None]).clearance[0] == pytest.approx(between, abs=2e-7)
    assert hpp.path(down, anchor) == (False, 0.0) and hpp.path(anchor, anchor).free


def test_a_refusal_by_hpp_is_a_violation_and_says_whether_coal_explains_it(rooms, court):
    refused = rooms.continuous.Proof(False, 0.5)

    class Strict:
        def path(self, q0, q1):
            return refused

    it = court()
    it.hpp = Strict()
    made = it.shard(3, 0)
    count = -(-30 // rooms.shards.HPP_EVERY)
    assert made["hpp"] == {"steps": count, "refused": count, "unexplained": count, "missed": 0}
    assert made["violations"] == count and made["first"][0]["broken"] == ["refused"]
    free = rooms.continuous.Heard()
    assert not free.add(rooms.continuous.Proof(True, np.nan), 0.0001, np.nan, 0.0005)
    assert not free.add(rooms.continuous.Proof(True, np.nan), 0.0006, np.nan, 0.0005)
    assert free.add(refused, 0.0001, 0.0001, 0.0005) and free.add(refused, 0.005, np.nan, 0.0005)
    assert free.record() == {"steps": 4, "refused": 2, "unexplained": 1, "missed": 1}


def test_with_the_guard_off_both_see_the_same_input_break_the_promises(mujoco, coal, steps):
    rows = [
        (made.free0[i], made.free1[i], made.dt[i]) for made, i in steps[:: STEPS // STEPS_UNGUARDED]
    ]
    for judge, some in ((coal, rows), (mujoco, rows[::5])):
        _, broken = heard(judge, some)
        assert broken["collision"] > len(some) / 50 and broken["between"] >= broken["collision"]
        assert broken["speed"] > len(some) / 10


NUMBERS = st.one_of(
    st.floats(), st.integers(), st.just(10**400), st.booleans(), st.none(), st.text(max_size=3),
    st.floats(-1.0, 1.0), st.sampled_from([1j, b"x", {}, [], (1.0, 2.0), "0.03"]),
)  # fmt: skip
FRAMES = st.one_of(
    NUMBERS,
    st.lists(NUMBERS, max_size=22),
    st.lists(st.floats(-2.0, 2.0), min_size=21, max_size=21),
    st.lists(st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3), min_size=7, max_size=7),
    st.tuples(*[NUMBERS] * 21),
    st.just(np.full(21, "x")),
    st.just(np.ones((7, 3), complex)),
    st.just(np.array([10**400] * 21, object)),
)
TIMES = st.one_of(st.just(1 / 30), st.floats(), st.floats(1e-7, 2.0), NUMBERS)


@settings(max_examples=60, deadline=None)
@given(script=st.lists(st.tuples(FRAMES, TIMES), min_size=1, max_size=6))
def test_whatever_comes_in_is_refused_in_words_or_answered_by_a_step_that_holds(
    rooms, coal, script
):
    it, x = retargeter(), stored()[1]
    stream = it.start()
    stream.step(x[0], 1 / 30)
    for given_x, dt in (*script, (x[1], 1 / 30)):
        before, v = stream.q, stream.v
        try:
            made = stream.step(given_x, dt)
        except ParameterError:
            assert (stream.q == before).all() and (stream.v == v).all()
            continue
        rows = rooms.streams.moved(before, v, made.q, made.v, float(dt), made.via)
        if rows:
            assert coal.curve(rows).broken == ()
        else:
            assert coal.step(before, made.q, float(dt)).broken == ()


# --- the judge itself


@pytest.mark.parametrize("name", ["coman", "coman_covered"])
def test_engines_agree_with_each_other_and_with_the_certificate(rooms, name):
    pytest.importorskip("mujoco")
    made = coman(name=name)
    between = retargeter().settings.between
    one, other = rooms.engines.Coal(made, between), rooms.engines.Mujoco(made, between)
    q = inside_limits(made, 60, 4)
    found = np.array([one.pairs(pose) for pose in q])
    assert np.allclose(found, [other.pairs(pose) for pose in q], rtol=0, atol=SAME)
    assert np.allclose(
        found.min(axis=1), made.certifier(between).check(q).clearance, rtol=0, atol=SAME
    )
    rows = np.arange(3, 60, 7)
    for engine in (one, other):
        least, pair = engine.nearest(q, rows)
        assert np.allclose(least, found[:, rows].min(axis=1), rtol=0, atol=SAME)
        assert set(pair) <= set(rows)


def test_pairs_that_are_left_out_are_far(rooms, coal):
    far = rooms.judging.FAR
    q = stored()[0][:24]
    for q0, q1 in zip(q[::2], q[1::2], strict=True):
        end = q0 + np.clip(q1 - q0, -0.3, 0.3)
        seen = coal.path(q0, end)
        poses = coal.samples(q0, end)
        whole = coman().certifier(retargeter().settings.between).check(poses).clearance
        assert seen.clearance == pytest.approx(min(whole.min(), far), abs=SAME)
        last = coman().certifier().check(poses[-1:]).clearance[0]
        assert seen.end == pytest.approx(min(last, far), abs=SAME)


def test_no_point_moves_more_than_a_millimetre_between_two_samples(coal):
    made, way = coman(), np.random.default_rng(9).normal(size=(100, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    q0, q1 = stored()[0][:2]
    poses = coal.samples(q0, q1)
    assert (poses[0] == q0).all() and (poses[-1] == q1).all()
    for row in range(0, len(poses) - 1, len(poses) // 5):
        before, after = (placements(made, pose) for pose in poses[row : row + 2])
        for one, two, body in zip(before, after, made.bodies, strict=True):
            half = np.linalg.norm(body.b - body.a) / 2
            skin = body.radius * way + np.sign(way[:, 2:]) * [0.0, 0.0, half]
            first, then = (skin @ at.getRotation().T + at.getTranslation() for at in (one, two))
            assert np.linalg.norm(then - first, axis=1).max() <= 0.001


def test_each_promise_that_is_broken_is_named(coal):
    anchor, arms_down = coman().anchor, np.zeros(11)
    assert coal.step(anchor, anchor, 0.1).broken == ()
    assert coal.step(anchor, anchor, np.nan).broken == ()
    moved = anchor + np.eye(11)[0] * 0.1
    assert coal.step(anchor, moved, 1 / 30).broken == ()
    for dt in (np.nan, 0.0, -1.0, 1e-9, -np.inf):
        assert coal.step(anchor, moved, dt).broken == ("held",)
    assert coal.step(anchor, moved, 0.02).broken == ("speed",)
    assert coal.step(moved, anchor, np.inf).broken == ()  # no more than in a second
    out = anchor + np.eye(11)[1] * 5.0
    assert {"limits", "speed"} <= set(coal.step(anchor, out, np.inf).broken)
    assert set(coal.step(anchor, np.where(anchor, np.nan, 0.0), 1.0).broken) >= {"collision"}
    came = type("Came", (), {"v": np.eye(11)[0] * 1.0, "dt": 1 / 30})
    hard = coal.step(anchor, moved, 1 / 30, came)  # from 1 to 3 rad/s in 1/30 s
    assert hard.broken == () and hard.hardest == pytest.approx(1.0)
    assert coal.step(anchor, moved * (1.0 + 1e-8), 1 / 30, came).broken == ("acceleration",)
    came.dt = np.nan  # nothing is promised of what went before
    assert coal.step(anchor, moved * (1.0 + 1e-8), 1 / 30, came).broken == ()
    down = coal.step(anchor, arms_down, 1.0)
    assert down.broken == ("collision", "between", "margin") and down.end < 0.0
    assert coal.step(arms_down, anchor, 1.0).broken == ("collision", "between")


def test_a_clearance_between_the_margins_is_for_paths_alone(coal):
    """Bisected between a clear pose and one that collides."""
    anchor, share = coman().anchor, [0.0, 1.0]
    checker = coman().certifier()
    for _ in range(60):
        middle = sum(share) / 2
        free = checker.check((1.0 - middle) * anchor[None]).clearance[0] >= 0.001
        share[0 if free else 1] = middle
    pose = (1.0 - share[0]) * anchor  # 1 mm apart
    assert coal.step(anchor, pose, 1.0).broken == ("margin",)
    assert coal.step(pose, anchor, 1.0).broken == ()


# --- whole motions, and joint motions through the guard


@pytest.fixture(scope="module")
def clips():
    """A motion through the body as a clip, at two rates."""
    return [(30.0, motion(240, 3)), (120.0, motion(480, 4))]


@pytest.fixture(scope="module")
def planned(rooms, clips):
    """Whole motions by two retargeters."""
    its = retargeter(), retargeter(target=MARGIN, check=False)
    return list(collected(lambda it, rng: rooms.plans.drive(
        it, rooms.plans.draw(it, rng, clips)), its, 600))  # fmt: skip


@pytest.fixture(scope="module")
def guards(rooms):
    return [rooms.joints.guards_of(coman(), close) for close in (False, True)]


@pytest.fixture(scope="module")
def guarded(rooms, clips, guards):
    """Joint motions by two guards."""
    return list(collected(lambda its, rng: rooms.joints.drive(
        its, rooms.joints.draw(retargeter(), rng, clips)), guards, 1500))  # fmt: skip


def collected(drive, its, least):
    """Scripts until there are so many steps."""
    number = steps = 0
    while steps < least:
        made = drive(its[number % 2], np.random.default_rng([8, number]))
        number, steps = number + 1, steps + len(made.q1)
        yield made


def verdicts(judge, scripts, led=False):
    """What is seen of all steps, those that lead out or the others."""
    return [
        made.judged(judge, i) for made in scripts for i in range(len(made.q1)) if made.led[i] == led
    ]


def breaks(seen):
    return Counter(kind for one in seen for kind in one.broken)


def unguarded(scripts):
    """The same inputs as they would be driven with the guard off."""
    return [
        made._replace(q0=made.free0, q1=made.free1, rows=tuple(() for _ in made.rows))
        for made in scripts[::3]
    ]


def judges(rooms, rounding):
    promise = rooms.judging.promise_of(retargeter())._replace(rounding=rounding)
    return rooms.judging.Judge(coman(), promise, rooms.engines.Coal(coman(), promise.between))


def test_no_step_of_a_planned_file_breaks_a_promise_and_unplanned_they_do(rooms, planned):
    judge = judges(rooms, rooms.shards.PLANS_ROUND)
    seen = verdicts(judge, planned)
    assert len(seen) >= 600 and not breaks(seen)
    assert max(one.speed for one in seen) > 0.999 and max(one.hardest for one in seen) > 0.999
    assert np.mean([one.clearance < 0.005 for one in seen]) > 0.05
    off = breaks(verdicts(judge, unguarded(planned)))
    assert off["speed"] > len(seen) / 30 and off["acceleration"] > 0 and off["collision"] > 0


def test_no_step_of_a_guarded_joint_motion_breaks_a_promise_and_unguarded_they_do(rooms, guarded):
    judge = judges(rooms, rooms.shards.FILES_ROUND)
    seen, led = verdicts(judge, guarded), verdicts(judge, guarded, led=True)
    assert len(seen) > 800 and not breaks(seen)
    assert led and not {"speed", "acceleration", "held"} & set(breaks(led))
    assert not [words for made in guarded for words in made.wrong]
    assert sum(made.refused for made in guarded) > 10
    modes = {str(mode) for made in guarded for mode in made.mode}
    assert {"as", "slowed", "moved", "guarded", "leading", "braked"} <= modes
    off = breaks(verdicts(judge, unguarded(guarded)))
    for kind in ("collision", "margin", "limits", "speed", "acceleration"):
        assert off[kind] > 3, kind


def test_every_door_of_the_guard_is_tried(rooms, clips):
    doors = Counter(
        rooms.joints.draw(retargeter(), np.random.default_rng([8, i]), clips).door
        for i in range(20)
    )
    assert set(doors) == set(rooms.joints.DOORS)


def test_a_guard_that_answers_what_it_must_refuse_is_found_out(rooms, clips, guards, monkeypatch):
    live, rng = guards[0].live, np.random.default_rng(5)
    step = live.step

    def forgiving(wanted, dt, measured=None):
        return step(live.q, dt if 1e-6 <= dt < 1.0 else 0.1)

    q = rooms.streams.smooth(retargeter(), rng, 60, 10)
    times = np.arange(60) / 30
    wanted = [rooms.joints.Wanted("step", coman().anchor, q, times, seed) for seed in range(6)]
    assert not [words for one in wanted for words in rooms.joints.drive(guards[0], one).wrong]
    monkeypatch.setattr(live, "step", forgiving)
    found = [words for one in wanted for words in rooms.joints.drive(guards[0], one).wrong]
    assert found and all("had to be refused" in words for words in found)


def test_a_guard_that_refuses_what_it_must_answer_is_found_out(rooms, guards, monkeypatch):
    def strict(*given):
        raise ParameterError("no")

    monkeypatch.setattr(guards[0].live, "step", strict)
    q = np.repeat(coman().anchor[None], 30, axis=0)
    wanted = rooms.joints.Wanted("step", coman().anchor, q, np.arange(30) / 30, 1)
    made = rooms.joints.drive(guards[0], wanted)
    assert len(made.wrong) > 20 and "was refused: no" in made.wrong[0] and not len(made.q1)


def test_what_a_robot_is_led_out_by_is_held_to_time_alone(rooms, court, monkeypatch):
    it = court()
    n, anchor, down = 11, coman().anchor, np.zeros(11)
    step = np.stack([down, down + 0.01])

    def script(led):
        log = rooms.streams.Log(n)
        for k in range(30):
            log.add(step[k % 2], step[1 - k % 2], 1.0, "leading", k, (anchor, anchor), led=led)
        return log.steps()

    for led, least in ((True, 0), (False, 30)):
        monkeypatch.setattr(it, "driven", lambda *of, led=led: script(led))
        made = it.shard(1, 2)
        assert made["kind"] == "joints" and made["violations"] == least
        assert made["led_out"] == 30 * led and made["steps"] == 30


def test_input_that_was_answered_and_should_not_have_been_is_a_violation(rooms, court, monkeypatch):
    it, anchor = court(), coman().anchor
    log = rooms.streams.Log(11)
    for k in range(30):
        log.add(anchor, anchor, 0.1, "as", k, (anchor, anchor))
    log.wrong.append("row 3 had to be refused")
    monkeypatch.setattr(it, "driven", lambda *of: log.steps())
    made = it.shard(1, 2)
    assert made["violations"] == 1 and made["first"][0]["broken"] == ["answered"]


# --- shards, and the search


@pytest.fixture
def court(rooms, monkeypatch):
    """A court of the tests' own retargeter."""
    monkeypatch.setattr(rooms.shards, "STEPS", 30)
    of_its_own = rooms.shards.Court

    def make(folder=None, source=None):
        made = object.__new__(of_its_own)
        made.folder, made.source = Path(folder or "."), Path(source or ".")
        made.plain, made.close = retargeter(), retargeter(target=MARGIN, check=False)
        made.clips, made.digest = [(30.0, motion())], "clips"
        promise = rooms.judging.promise_of(made.plain)
        made.sit(promise, rooms.engines.Coal(coman(), promise.between), None)
        made.hpp, made.versions = None, {"coal": "3"}
        made.between, made.certifier = promise.between, coman().certifier()
        return made

    return make


def test_a_judgement_that_was_stopped_goes_on_and_ends_as_any_other(
    rooms, court, tmp_path, monkeypatch
):
    (tmp_path / "retargeter.json").write_text("{}")
    monkeypatch.setattr(rooms.shards, "Court", lambda *of: court(tmp_path))

    def judged(name, **options):
        given = {"steps": 90, "seconds": 0.0, "workers": 1, "search": 0.0, "seed": 3}
        with pytest.raises(SystemExit) as end:
            rooms.run.main(
                **given | options, folder=tmp_path, clips=tmp_path, reports=tmp_path / name,
                work=tmp_path / "work" / name,
            )  # fmt: skip
        assert end.value.code == 0
        return json.loads((tmp_path / name / "steps.json").read_text())

    whole = judged("whole")
    assert whole["complete"] and whole["steps"] == 90 and whole["violations"] == 0
    assert {"random", "files", "joints"} <= set(whole)
    led = whole["all"]["led_out"]
    assert whole["all"]["coal"]["steps"] == 90 - led == whole["all"]["steps"] - led
    assert all(whole[kind]["unguarded"]["steps"] == 2 for kind in ("random", "files"))
    perform, made = rooms.run.perform, []

    def interrupted(*of):
        for one in perform(*of):
            made.append(one)
            yield one
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(rooms.run, "perform", interrupted)
        part = judged("stopped")
    assert not part["complete"] and part["steps"] == 30 and part["steps_planned"] == 90
    assert judged("stopped") == whole


def test_the_search_finds_what_a_retargeter_without_a_guard_does(rooms, court, monkeypatch):
    def unguarded(it, script):
        made = drive(it, script)
        rows = tuple(() for _ in made.rows)
        return made._replace(q0=made.free0, q1=made.free1, rows=rows)

    class Bar:
        def __enter__(self):
            return self

        def __exit__(self, *of):
            pass

        def update(self, more):
            pass

    drive, bar = rooms.streams.drive, lambda *of: Bar()
    guarded = rooms.hunt.search(court(), 2.0, 1, bar)
    assert guarded["violations"] == 0 and guarded["streams"] > 0 and guarded["steps"] > 0
    monkeypatch.setattr(rooms.streams, "drive", unguarded)
    found = rooms.hunt.search(court(), 2.0, 1, bar)
    assert found["violations"] > 0 and len(found["first"]) == 3
    assert found["fastest_of_limit"] > 1.0
    one = found["first"][0]
    assert len([float.fromhex(v) for v in one["q0"]]) == 11 and one["broken"]


def test_without_a_retargeter_it_says_what_to_run(rooms, tmp_path):
    with pytest.raises(SystemExit) as end:
        rooms.run.main(folder=tmp_path / "none", clips=None)
    assert str(end.value) == (
        f"make judge: {tmp_path / 'none'} is missing; write it with: dvc repro export"
    )


@pytest.mark.parametrize("kind", ["known", "bounded", "ranges"])
def test_no_step_among_given_joints_breaks_a_promise(rooms, kind, monkeypatch):
    monkeypatch.setattr(rooms.among, "STEPS", 150)
    made = rooms.among.shard("g1", 1, rooms.among.KINDS.index(kind))
    assert (made["kind"], made["steps"], made["broken"]) == (kind, 150, {})
    assert made["forced"] < 50 and made["least_between_m"] >= 0.0005 - SAME


def test_a_guard_that_does_not_look_at_the_others_is_found_out(rooms, monkeypatch):
    monkeypatch.setattr(rooms.among, "STEPS", 300)
    every = rooms.among.parts("g1")[2]
    monkeypatch.setattr(every._walker, "_holds", lambda *_: True)
    monkeypatch.setattr(every._walker, "see", lambda: None)
    made = rooms.among.shard("g1", 1, 0)
    assert made["broken"] and made["held_broken"]
