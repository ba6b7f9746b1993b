"""The audit: what holds passes, and each way of breaking it is found, named and measured."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import MARGIN, coman, inside_limits, relaxed, write_arms

from s3le.errors import ParameterError
from s3le.kernels import batch
from s3le.robot.certificate import Certifier
from s3le.robot.robot import Robot
from s3le.safety import paths
from s3le.safety.audit import audit, certificate, demands, not_covered, say, tree
from s3le.safety.paths import CERTIFIED, UNDECIDED

RATE = 30.0
R_SHOULDER, R_ELBOW = 2, 3  # joints of the two-armed robot


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    return Robot.from_file(write_arms(tmp_path_factory.mktemp("arms")), MARGIN, "midpoint")


def swaying(made, rows=40):
    """A motion that holds: one arm sways about the anchor."""
    q = np.repeat(made.anchor[None], rows, 0)
    q[:, R_SHOULDER] += 0.2 * np.sin(np.arange(rows) / 8)
    return np.arange(rows) / RATE, q


def by_name(report):
    return {check.name: check for check in report.checks}


def test_a_calm_motion_holds_and_says_by_how_much(arms):
    time, q = swaying(arms)
    report = audit(arms, time, q, demands(arms))
    assert report.holds and report.first is None and report.complaint == ""
    assert [check.broken for check in report.checks] == [0, 0, 0, 0]
    assert [check.total for check in report.checks] == [40, 39, 40, 39]
    assert report.least == arms.certifier().check(q).clearance.min() >= MARGIN
    assert MARGIN / 4 <= report.bound <= report.least
    assert report.fastest == pytest.approx(0.2 / 8 * RATE, rel=0.02)
    said = certificate(arms, demands(arms), report)
    assert said["holds"] and said["paths"]["proven"] == 39 and said["robot_hash"]


def test_a_limit_that_is_passed_is_found_and_named(arms):
    time, q = swaying(arms)
    q[7, R_SHOULDER] = arms.lower[R_SHOULDER] - 1e-9
    report = audit(arms, time, q, demands(arms, velocity=1e3))
    check = by_name(report)["limits"]
    assert not report.holds and check.broken == 1
    assert check.first.row == 7 and check.first.what == "r_shoulder"
    assert check.first.value == pytest.approx(-1e-9, rel=1e-6)
    q[7, R_SHOULDER] = arms.lower[R_SHOULDER]  # the end of the range belongs to it
    assert by_name(audit(arms, time, q, demands(arms)))["limits"].broken == 0


def test_a_joint_that_is_too_fast_is_found_and_the_limit_can_be_set(arms):
    time, q = swaying(arms)
    q[20:, R_ELBOW] += 0.2  # 6 rad/s; the URDF has 4
    report = audit(arms, time, q, demands(arms))
    check = by_name(report)["velocities"]
    assert check.broken == 1 and check.first.row == 19 and check.first.what == "r_elbow"
    assert check.first.value == pytest.approx(6.0) and check.first.wanted == 4.0
    assert audit(arms, time, q, demands(arms, velocity=6.0)).holds
    assert audit(arms, time, q, demands(arms, velocity={"r_elbow": 6.0})).holds
    assert audit(arms, time, q, demands(arms, velocity=np.inf)).holds
    assert not audit(arms, time, q, demands(arms, velocity={"r_elbow": 5.99})).holds


@pytest.mark.parametrize("share, broken", [(0.9e-6, 0), (1.1e-6, 1), (-1e-6, 0)])
def test_a_speed_may_exceed_its_limit_by_what_times_in_a_file_are_rounded_by(arms, share, broken):
    q = np.repeat(arms.anchor[None], 2, 0)
    q[1, R_ELBOW] += 0.25
    time = np.array([0.0, 0.25 / 4.0 / (1.0 + share)])  # at 4 rad/s and a little
    report = audit(arms, time, q, demands(arms))
    assert by_name(report)["velocities"].broken == broken and report.holds == (not broken)


def test_an_arm_that_jumps_through_the_trunk_between_two_clear_poses_is_found(arms):
    q = np.repeat(arms.anchor[None], 3, 0)
    q[1:, R_SHOULDER] = 3.0
    time = np.array([0.0, 2.0, 4.0])
    report = audit(arms, time, q, demands(arms))
    checks = by_name(report)
    assert checks["poses"].broken == checks["velocities"].broken == 0
    assert checks["paths"].broken == 1 and report.between == 1 and not report.holds
    first = report.first
    assert first.what == "body_0 and r_upper_0" or first.what == "body_0 and r_lower_0"
    assert 0.0 < first.time < 2.0 and first.value < MARGIN / 4
    t = first.time / 2.0  # coal agrees with what is said of the pose there
    there = (1 - t) * q[0] + t * q[1]
    assert arms.certifier().check(there[None]).clearance[0] == pytest.approx(first.value, abs=1e-9)
    assert np.isnan(report.bound) and tree(report)["proven_bound_m"] is None


def test_what_is_not_decided_is_not_a_yes():
    made = coman()
    q = batch.project(made.chain, made.anchor, relaxed(made, 40, 5), MARGIN).q
    small = paths.certify(made, q, MARGIN / 4, 0).status
    whole = paths.certify(made, q, MARGIN / 4).status
    row = int(np.flatnonzero((small == UNDECIDED) & (whole == CERTIFIED))[0])
    time, q = np.array([0.0, 1.0]), q[row : row + 2]
    assert audit(made, time, q, demands(made, velocity=np.inf)).holds
    report = audit(made, time, q, demands(made, velocity=np.inf, budget=0))
    check = by_name(report)["paths"]
    assert check.undecided == check.broken == 1 and not report.holds
    assert "not decided" in report.complaint
    assert tree(report)["checks"]["paths"]["first"]["value"] is None


def seen_as(monkeypatch, **changed):
    """Let the independent check find something else at row 2 of a motion."""
    whole = Certifier.check

    def check(self, q, progress=None):
        report = whole(self, q, progress)
        for name, value in changed.items() if len(q) > 2 else ():
            getattr(report, name)[2] = value
        return report

    monkeypatch.setattr(Certifier, "check", check)


def test_a_pose_whose_clearance_is_not_known_is_not_clear(arms, monkeypatch):
    time, q = swaying(arms, 5)
    seen_as(monkeypatch, clearance=np.nan, pair=-1)
    report = audit(arms, time, q, demands(arms))
    check = by_name(report)["poses"]
    assert check.broken == 1 and check.first.row == 2 and np.isnan(check.first.value)
    assert [one.broken for one in report.checks] == [0, 0, 1, 0] and not report.holds
    assert np.isnan(report.least) and report.complaint == "0.0667 s (row 2): no pose"
    said = certificate(arms, demands(arms), report)
    assert not said["holds"]
    assert tree(report)["checks"]["poses"]["first"]["value"] is None
    assert tree(report)["least_clearance_m"] is None


@pytest.mark.parametrize("clearance, broken, deep", [
    (MARGIN, 0, 0), (MARGIN - 1e-12, 1, 0), (0.0, 1, 0), (-1e-9, 1, 1), (-0.004, 1, 1),
    (np.nan, 1, 0),
])  # fmt: skip
def test_a_pose_below_its_margin_by_any_amount_is_broken(
    arms, monkeypatch, clearance, broken, deep
):
    time, q = swaying(arms, 5)
    seen_as(monkeypatch, clearance=clearance)
    report = audit(arms, time, q, demands(arms))
    assert by_name(report)["poses"].broken == broken and report.deep == deep
    assert report.holds == (not broken)


def test_a_path_is_between_clear_poses_only_where_both_are_known_to_be_clear(arms, monkeypatch):
    q = np.repeat(arms.anchor[None], 4, 0)
    q[2:, R_SHOULDER] = 3.0  # through the trunk, from row 1 to row 2
    time = np.arange(4.0)
    assert audit(arms, time, q, demands(arms)).between == 1
    seen_as(monkeypatch, clearance=np.nan)
    assert audit(arms, time, q, demands(arms)).between == 0


@pytest.mark.parametrize("joint", [R_SHOULDER, R_ELBOW])
def test_each_check_refuses_a_row_that_is_not_finite_by_itself(arms, joint):
    time, q = swaying(arms, 5)
    q[2, joint] = np.nan
    with np.errstate(invalid="ignore"):
        report = audit(arms, time, q, demands(arms))
    found = {check.name: (check.broken, check.first.row) for check in report.checks}
    assert found == {"limits": (1, 2), "velocities": (2, 1), "poses": (1, 2), "paths": (2, 1)}
    assert by_name(report)["paths"].undecided == 2
    name = arms.joint_names[joint]
    assert report.complaint == f"0.0333 s (row 1): {name} is not a number"
    limits = say("limits", by_name(report)["limits"].first)
    assert limits == f"0.0667 s (row 2): {name} is not a number"


def test_a_bound_is_told_only_where_every_path_is_proven(arms, monkeypatch):
    time, q = swaying(arms, 5)
    whole = paths.certify

    def spent(*given):
        found = whole(*given)
        found.status[1] = UNDECIDED
        return found

    assert audit(arms, time, q, demands(arms)).bound > 0.0
    monkeypatch.setattr("s3le.safety.audit.certify", spent)
    report = audit(arms, time, q, demands(arms))
    assert np.isnan(report.bound) and not report.holds
    check = by_name(report)["paths"]
    assert check.undecided == check.broken == 1 and check.first.row == 1
    assert np.isnan(check.first.value) and report.between == 0


def test_deep_poses_are_measured_as_coal_does():
    made = coman()
    q = inside_limits(made, 60, 3)
    report = audit(made, np.arange(60.0), q, demands(made, velocity=np.inf))
    seen = made.certifier().check(q)
    check = by_name(report)["poses"]
    assert check.broken == (seen.clearance < MARGIN).sum() > 0
    assert report.deep == (seen.clearance < 0).sum()
    worst = check.worst[0]
    assert worst.value == seen.clearance.min() and worst.row == seen.clearance.argmin()
    assert worst.what == made.pair_name(seen.pair[worst.row])
    assert "overlap by" in report.complaint or "apart" in report.complaint


def test_worst_places_are_of_different_times(arms):
    time, q = swaying(arms, 60)
    q[10:14, 1] = [2.51, 2.6, 2.7, 2.52]
    q[40, 1] = 2.55
    check = by_name(audit(arms, time, q, demands(arms, velocity=np.inf)))["limits"]
    assert check.broken == 5 and [one.row for one in check.worst] == [12, 40]
    assert check.first.row == 10


def test_margins_can_be_asked_row_by_row(arms):
    time, q = swaying(arms, 3)
    clearance = arms.certifier().check(q).clearance
    wanted = demands(arms, margin=float(clearance.min()) + 0.001, margin_between=0.001)
    assert not audit(arms, time, q, wanted).holds
    assert audit(arms, time, q, wanted, at_rows=np.full(3, 0.001)).holds


@pytest.mark.parametrize("rows", [1, 2])
def test_short_motions_are_motions(arms, rows):
    time, q = swaying(arms, rows)
    report = audit(arms, time, q, demands(arms))
    assert report.holds and report.rows == rows
    assert tree(report)["checks"]["paths"]["total"] == rows - 1


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"margin": 0.0}, "margin must be above 0"),
        ({"margin": np.nan}, "margin must be above 0"),
        ({"margin_between": 0.003}, "at most margin"),
        ({"margin_between": 0.0}, "margin_between must be above 0"),
        ({"velocity": -1.0}, "above 0 rad/s"),
        ({"velocity": np.nan}, "above 0 rad/s"),
        ({"velocity": {"elbow": 1.0}}, "names 'elbow'; joints: l_shoulder"),
    ],
)
def test_demands_out_of_range_are_refused(arms, more, words):
    with pytest.raises(ParameterError, match=words):
        demands(arms, **more)


def test_a_urdf_without_speeds_asks_for_none(tmp_path):
    from worlds import ARMS_URDF

    urdf = ARMS_URDF.replace('velocity="4"', 'velocity="0"')
    made = Robot.from_file(write_arms(tmp_path, urdf=urdf), MARGIN, "midpoint")
    assert np.isinf(demands(made).velocity).all()


def test_pairs_that_nothing_is_said_about_are_listed_with_the_reason():
    listed = not_covered(coman())
    assert {"a": "LShy_0", "b": "LElb_0", "kind": "within a limb",
            "reason": "overlap at the anchor when grown"} in listed  # fmt: skip
    assert len(listed) == 20


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    bad=st.sampled_from([np.nan, np.inf, -np.inf, 1e300, 50.0]),
    at=st.integers(0, 5),
    joint=st.integers(0, 3),
)
def test_one_bad_number_anywhere_is_never_certified(arms, seed, bad, at, joint):
    q = batch.project(arms.chain, arms.anchor, relaxed(arms, 1, seed), MARGIN).q
    q = np.repeat(q, 6, 0)
    time = np.arange(6.0)
    assert audit(arms, time, q, demands(arms)).holds
    q[at, joint] = bad
    with np.errstate(invalid="ignore", over="ignore"):
        report = audit(arms, time, q, demands(arms, velocity=np.inf))
    assert not report.holds
    tree(report)


def test_an_acceleration_that_is_too_high_is_found_where_it_is_asked_for(arms):
    time, q = swaying(arms)
    assert len(audit(arms, time, q, demands(arms)).checks) == 4
    wanted = demands(arms, velocity=1e3, acceleration={"r_elbow": 50.0})
    assert audit(arms, time, q, wanted).holds
    q[21:, R_ELBOW] += 51.0 / RATE**2  # a step between rows 20 and 21
    check = by_name(audit(arms, time, q, wanted))["accelerations"]
    assert check.total == 38 and check.broken == 2
    assert check.first.row == 20 and check.first.time == time[20] and check.first.what == "r_elbow"
    assert check.worst[0].value == pytest.approx(51.0)
    assert say("accelerations", check.first).endswith("changes speed by 51.00 rad/s^2 of 50")
    q[21:, R_ELBOW] -= 1.01 / RATE**2
    report = audit(arms, time, q, wanted)
    assert report.holds and tree(report)["checks"]["accelerations"]["broken"] == 0
    limit = certificate(arms, wanted, report)["acceleration_rad_s2"]
    assert limit["r_elbow"] == 50.0 and limit["l_elbow"] is None


def test_accelerations_of_uneven_rows_are_changes_of_speed_over_the_mean_step(arms):
    time = np.array([0.0, 0.1, 0.4, 0.5])
    q = np.repeat(arms.anchor[None], 4, 0)
    q[:, R_ELBOW] += [0.0, 0.02, 0.14, 0.15]  # 0.2, 0.4, 0.1 rad/s
    wanted = demands(arms, acceleration=1e-3)
    check = by_name(audit(arms, time, q, wanted))["accelerations"]
    assert [one.row for one in check.worst] == [2]  # of a run of neighbours the worst
    assert check.worst[0].value == pytest.approx(0.3 / 0.2)
    assert check.first.row == 1 and check.first.value == pytest.approx(0.2 / 0.2)


@pytest.mark.parametrize("rows", [1, 2])
def test_so_few_rows_have_no_acceleration(arms, rows):
    q = np.repeat(arms.anchor[None], rows, 0)
    report = audit(arms, np.arange(rows) / RATE, q, demands(arms, acceleration=1.0))
    assert report.holds and by_name(report)["accelerations"].total == 0


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan])
def test_no_acceleration_at_all_is_refused(arms, bad):
    with pytest.raises(ParameterError, match=r"acceleration of \w+ must be above 0"):
        demands(arms, acceleration=bad)
