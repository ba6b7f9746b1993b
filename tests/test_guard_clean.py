"""One motion through the guard: what is written holds by the audit, or nothing is written."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from worlds import coman

from s3le.errors import CertificateError, ParameterError, TrajectoryError
from s3le.guard import clean, moved
from s3le.guard.claim import claim
from s3le.guard.clean import Guard, looks, work
from s3le.guard.layouts.episode import Episode
from s3le.guard.layouts.numbers import Numbers, decode
from s3le.motion.trajectory import BETWEEN
from s3le.safety import audit

RATE = 30.0


class Held(NamedTuple):
    """A layout in memory."""

    path: Path
    episodes: list[Episode]


def held(*motions, kind=float, degrees=False, mode=None, rate=RATE, place=False):
    """A layout of motions (m, n) [rad], its numbers of a kind, perhaps with a place for speeds."""
    robot, episodes = coman(), []
    for number, q in enumerate(motions):
        raw = tuple((np.rad2deg(c) if degrees else c).astype(kind) for c in q.T)
        q = np.stack([decode(column, degrees) for column in raw], axis=1)
        numbers = Numbers(raw, (degrees,) * q.shape[1], q, robot.lower, robot.upper)
        time, pace = np.arange(len(q)) / rate, None
        if place:
            none, free = np.full(len(q), np.nan, kind), np.full(q.shape[1], np.inf)
            pace = numbers.__class__(
                (none,) * q.shape[1], numbers.degrees, np.full(q.shape, np.nan), -free, free
            )
        episodes.append(Episode(f"motion {number}", time, q, [], numbers, mode, pace=pace))
    return Held(Path("held"), episodes)


def joint(name):
    return coman().joint_names.index(name)


def still(rows=30):
    return np.repeat(coman().anchor[None], rows, axis=0)


def swaying(rows=60, by=0.2):
    q = still(rows)
    q[:, joint("LShSag")] += by * np.sin(np.arange(rows) / 8)
    return q


def colliding(rows=60):
    """An arm goes into the trunk and comes out again, within limits, speed and acceleration."""
    q = still(rows)
    share = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(rows) / (rows - 1))
    q[:, joint("RShLat")] += share * 1.75
    return q


@pytest.fixture(scope="module")
def guard():
    return Guard(*claim(coman()))


@pytest.fixture(scope="module")
def straight():
    return Guard(*claim(coman(), straight=True))


def counts(checks):
    return {kind: check["broken"] for kind, check in checks.items()}


def test_a_colliding_motion_becomes_one_that_the_audit_certifies(guard):
    given = held(colliding())
    made = guard.clean(given, degrees=False)
    before = made.summary["before"]
    assert before["poses"]["broken"] > 5 and before["paths"]["broken"] > 5
    assert "overlap by" in before["poses"]["worst"][0]["says"]
    assert set(counts(made.summary["after"]).values()) == {0} and made.summary["holds"]
    wanted = audit.demands(coman(), acceleration=60.0)
    assert audit.audit(coman(), given.episodes[0].time, made.q[0], wanted).holds
    hardest = made.summary["certificate"]["acceleration_rad_s2"]
    assert hardest == dict.fromkeys(coman().joint_names, 60.0)
    assert made.summary["moved"]["joints"][0]["joint"] == "RShLat"
    assert made.summary["moved"]["most_deg"] < 40.0


@pytest.mark.parametrize(("kind", "degrees"), [("f8", False), ("f4", False), ("f4", True)])
def test_what_came_out_comes_back_to_the_bit(guard, kind, degrees):
    once = guard.clean(held(colliding(), kind=kind, degrees=degrees), degrees)
    again = held(once.q[0], kind=kind, degrees=degrees)
    assert (again.episodes[0].q == once.q[0]).all()
    twice = guard.clean(again, degrees)
    assert twice.q == [None] and twice.summary["moved"]["touched"] == 0
    assert set(counts(twice.summary["before"]).values()) == {0}


def test_a_motion_that_holds_is_not_even_planned(guard, monkeypatch):
    monkeypatch.setattr(clean.Planner, "plan", lambda *_, **__: pytest.fail("planned"))
    made = guard.clean(held(swaying()), degrees=False)
    assert made.q == [None] and made.summary["rows"]["as_wanted"] == 60


def test_of_several_motions_those_that_hold_stay(guard):
    made = guard.clean(held(swaying(), colliding(), still(1)), degrees=False)
    assert [q is None for q in made.q] == [True, False, True]
    assert made.summary["episodes"] == 3 and made.summary["frames"] == 121
    assert made.summary["before"]["poses"]["worst"][0]["episode"] == "motion 1"
    assert made.summary["certificate"]["paths"]["proven"] == 59 + 59
    assert made.summary["certificate"]["poses"]["checked"] == 121


# --- the verification has the word, whatever planning says


def lying(monkeypatch, change):
    """A planner that claims more than is so."""
    honest = clean.Planner.plan

    def plan(self, times, wanted, progress=None):
        made = honest(self, times, wanted)
        return made._replace(q=change(times, wanted, made.q.copy()))

    monkeypatch.setattr(clean.Planner, "plan", plan)


def collides(times, wanted, q):
    return wanted


def too_fast(times, wanted, q):
    q[30:, joint("LElbj")] -= 0.14  # 4.2 rad/s of 4
    return q


def too_hard(times, wanted, q):
    q[30:, joint("LElbj")] -= 0.1  # 90 rad/s^2 of 60
    return q


def beyond(times, wanted, q):
    q[:, joint("LElbj")] = 1e-9
    return q


def not_a_number(times, wanted, q):
    q[3, 3] = np.nan
    return q


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (collides, "DWYTorso_0 and RShy_0 are 0.801 mm apart"),
        (too_fast, "LElbj turns at 4.200 rad/s of 4"),
        (too_hard, r"LElbj changes speed by 90.00 rad/s\^2 of 60"),
        (beyond, "LElbj is .* outside its range"),
        (not_a_number, "angle 3 is nan"),
    ],
)
def test_a_planner_that_is_wrong_is_refused_by_the_audit(
    guard, straight, monkeypatch, change, says
):
    lying(monkeypatch, change)
    with pytest.raises((CertificateError, TrajectoryError), match=says):
        straight.clean(held(colliding()), degrees=False)
    for place in (False, True):
        with pytest.raises((CertificateError, TrajectoryError), match="does not hold|is nan"):
            guard.clean(held(colliding(), place=place), degrees=False)


def test_what_the_audit_cannot_decide_is_no(monkeypatch):
    guard = Guard(*claim(coman(), straight=True))
    guard.demands = guard.demands._replace(budget=0)
    q = still(2)
    q[1, [joint("LElbj"), joint("RElbj")]] -= 2.0
    given = held(q, rate=0.5)
    assert guard.check(given.episodes[0], q).checks[-1].undecided == 1
    monkeypatch.setattr(
        clean.Planner, "plan", lambda self, t, w, progress=None: clean_plan(w)
    )  # stays as it is, which is proven with a budget
    with pytest.raises(CertificateError, match="not decided"):
        guard.clean(given, degrees=False)


def clean_plan(q):
    from s3le.plan.whole import Plan

    return Plan(q, np.zeros(len(q), np.uint8), np.zeros(len(q)), np.zeros(len(q)))


# --- numbers that a file rounds


def test_where_the_file_rounds_a_reserve_is_kept_and_said(guard):
    given = held(swaying(by=1.5), kind="f2")  # as fast and as hard as may be
    made = guard.clean(given, degrees=False)
    assert 1e-4 < made.summary["reserve_rad"] < 2e-2
    assert (given.episodes[0].as_written(made.q[0]) == made.q[0]).all()
    assert guard.check(given.episodes[0], made.q[0]).holds


def test_a_file_too_coarse_for_its_rate_is_refused_with_the_reason(guard):
    coarse = colliding(600)
    with pytest.raises(CertificateError, match=r"written to .* rad, which at 0.002 s a row leaves"):
        guard.clean(held(coarse, kind="f2", rate=500.0), degrees=False)


# --- what is no motion of this robot


def test_degrees_for_radians_are_named(guard):
    given = held(np.rad2deg(swaying()))
    with pytest.raises(TrajectoryError, match="look like degrees: .* read them with --degrees"):
        guard.clean(given, degrees=False)
    assert guard.clean(held(swaying(), degrees=True), degrees=True).q == [None]


def test_radians_for_degrees_are_said(guard):
    made = guard.clean(held(np.deg2rad(swaying())), degrees=True)
    assert any("were these radians already?" in note for note in made.summary["notes"])


def test_another_robots_numbers_are_no_degrees(guard):
    q = still()
    q[:, joint("LElbj")] = -400.0
    q[:, joint("RElbj")] = 3000.0
    q[:, joint("WaistYaw")] = 900.0
    q[:, joint("WaistLat")] = 900.0
    with pytest.raises(TrajectoryError, match="angles are not coman's: WaistLat is 900 rad"):
        guard.clean(held(q), degrees=False)


def test_one_wild_row_is_named(guard):
    q = swaying()
    q[17, joint("WaistYaw")] = 55.0
    with pytest.raises(TrajectoryError, match="WaistYaw is 55 rad in row 17.*mend or cut that row"):
        guard.clean(held(q), degrees=False)


def test_jumps_are_planned_over_and_said(guard):
    q = swaying()
    q[30:, joint("LShSag")] -= 1.2
    made = guard.clean(held(q), degrees=False)
    assert made.summary["holds"] and made.summary["before"]["velocities"]["broken"] == 1
    assert made.summary["notes"] == ["one jump, planned over: LShSag by -70.0 deg after row 29"]


def test_a_start_in_collision_is_moved_and_said(guard):
    q = colliding()[25:]
    made = guard.clean(held(q), degrees=False)
    assert made.summary["holds"]
    note = next(note for note in made.summary["notes"] if "first row" in note)
    assert "mm; it is moved by" in note and "would begin" in note


# --- what is asked


def test_a_harder_claim_breaks_what_held_and_is_met(guard):
    q = swaying()
    fastest = np.abs(np.diff(q, axis=0)).max() * RATE
    slow = Guard(*claim(coman(), speed_factor=float(0.8 * fastest / 4.0)))
    made = slow.clean(held(q), degrees=False)
    assert made.summary["before"]["velocities"]["broken"] > 0 and made.summary["holds"]
    assert np.abs(np.diff(made.q[0], axis=0)).max() * RATE <= 0.8 * fastest * (1 + 1e-6)
    hardest = np.abs(np.diff(q, 2, axis=0)).max() * RATE**2
    soft = Guard(*claim(coman(), acceleration={"LShSag": 0.7 * hardest}))
    made = soft.clean(held(q), degrees=False)
    assert made.summary["before"]["accelerations"]["broken"] > 0 and made.summary["holds"]
    wide = Guard(*claim(coman(), margin=0.008))
    made = wide.clean(held(colliding()), degrees=False)
    assert made.summary["certificate"]["poses"]["least_clearance_m"] >= 0.008


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({"speed_factor": 0.0}, "speed factor"),
        ({"speed_factor": float("nan")}, "speed factor"),
        ({"acceleration": -1.0}, "acceleration of WaistLat"),
        ({"acceleration": float("nan")}, "acceleration of WaistLat"),
        ({"acceleration": {"elbow": 3.0}}, "acceleration names 'elbow'"),
        ({"margin": 0.0}, "margin must be above 0"),
        ({"margin": 0.05}, "the anchor pose of coman keeps 12.22 mm"),
    ],
)
def test_what_cannot_be_asked_is_one_line(asked, says):
    with pytest.raises(ParameterError, match=says):
        claim(coman(), **asked)


def test_rows_between_frames_are_held_to_what_the_path_is_until_they_change(guard):
    q = still(3)
    q[1, joint("RShLat")] = near(0.001)
    mode = np.array(["planned", BETWEEN, "planned"])
    given = held(q, rate=0.1, mode=mode)
    assert guard.check(given.episodes[0], q).holds
    other = q.copy()
    other[1, joint("LElbj")] -= 0.01
    assert not guard.check(given.episodes[0], other).holds
    assert not guard.check(held(q, rate=0.1).episodes[0], q).holds


def near(clearance):
    """The angle of RShLat at which the arm keeps so much."""
    low, high = coman().anchor[joint("RShLat")], 0.0
    for _ in range(60):
        q = coman().anchor.copy()
        q[joint("RShLat")] = middle = 0.5 * (low + high)
        if coman().certifier().one(q)[0] > clearance:
            low = middle
        else:
            high = middle
    return low


# --- counting


@pytest.mark.parametrize("motion", [swaying, colliding])
def test_progress_adds_up(guard, motion):
    done = []
    guard.clean(held(motion()), False, done.append)
    assert sum(done) == work(60)
    done = []
    guard.survey(held(motion()), False, done.append)
    assert sum(done) == looks(60)


def test_quantiles_over_many_files_are_those_of_all_frames():
    rng = np.random.default_rng(2)
    off = [np.abs(rng.normal(0, scale, (500, 3))) for scale in (0.01, 0.1, 0.5)]
    tallies = [moved.tally([np.zeros_like(o)], [o], ["a", "b", "c"]) for o in off]
    far = np.rad2deg(np.concatenate(off)).max(axis=1)
    far = far[far > moved.LEAST]
    pooled = moved.pooled(tallies)
    assert pooled["frames"] == 1500 and pooled["moved"] == len(far)
    assert pooled["median_deg"] == pytest.approx(np.median(far), rel=0.011)
    assert pooled["p95_deg"] == pytest.approx(np.quantile(far, 0.95), rel=0.011)
    assert pooled["most_deg"] == far.max()


def test_nothing_moved_is_nought_and_not_an_error():
    q = np.zeros((3, 2))
    said = moved.tally([q], [q], ["a", "b"])
    assert said["touched"] == said["moved"] == 0 and said["median_deg"] == 0.0 and not said["bins"]
    assert moved.pooled([said])["most_deg"] == 0.0 and moved.pooled([])["frames"] == 0


def test_rows_that_planning_hardly_moves_stay_to_the_bit_if_the_audit_agrees(guard, monkeypatch):
    q = np.concatenate([still(90), colliding(), still(90)])

    def nudged(times, wanted, made):
        return made + 9e-6 * (made != coman().upper)

    lying(monkeypatch, nudged)
    made = guard.clean(held(q), degrees=False)
    assert made.summary["moved"]["touched"] < 90 and (made.q[0][:60] == q[:60]).all()
    honest = guard.check

    def strict(episode, q, progress=None, v=None):  # nothing that was put back holds
        report = honest(episode, q, progress, v)
        return report._replace(between=0) if (q != episode.q).any(axis=1).all() else broken(report)

    def broken(report):
        bad = report.checks[0]._replace(broken=1)
        return report._replace(checks=(bad, *report.checks[1:]))

    monkeypatch.setattr(guard, "check", strict)
    made = guard.clean(held(q), degrees=False)
    assert made.summary["moved"]["touched"] == 240 and made.summary["reserve_rad"] == 0.0
