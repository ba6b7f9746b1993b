"""Figures of a comparison, by hand; what could not be measured counts against the method."""

import numpy as np
import pytest
from worlds import MARGIN, write_arms

from s3le.kernels.threads import use_threads
from s3le.robot.certificate import Certifier, Report
from s3le.robot.robot import Robot
from s3le.safety import paths
from s3le.study import evaluation
from s3le.study.evaluation import Between, Scored, between, score, summary

UP = np.tile([0.0, 0.0, 1.0], 7)
FORWARD = np.tile([1.0, 0.0, 0.0], 7)


def no_paths(n=0):
    no = np.zeros(n, bool)
    return Between(np.arange(n), ~no, no, no, no, no, np.zeros(n), 0.0005)


def test_scores_are_mean_cosine_distances():
    x = np.stack([UP, UP, np.r_[FORWARD[:3], UP[3:]]])
    scored = score(x, np.stack([UP, FORWARD, UP]), np.stack([-UP, UP, UP]))
    np.testing.assert_allclose(scored.to_truth, [0.0, 1.0, 1 / 7], atol=1e-12)
    np.testing.assert_allclose(scored.to_human, [2.0, 0.0, 1 / 7], atol=1e-12)


def test_motions_count_the_same_whatever_their_length():
    clips = ["a", "a", "a", "b"]
    scored = Scored(np.array([0.1, 0.1, 0.1, 0.5]), np.zeros(4))
    report = Report(np.full(4, 0.01), np.zeros(4, int), np.full(4, 0.1))
    found = summary(clips, scored, report, 0.002, no_paths(), ["lookup"] * 4)
    assert found["all"]["to_truth"] == pytest.approx(0.2)
    assert found["all"]["to_truth_motions"] == pytest.approx(0.3)
    assert found["motions"]["b"]["frames"] == 1
    assert list(found["motions"]) == ["a", "b"]


def test_a_pose_that_was_not_measured_counts_as_unsafe():
    report = Report(
        np.array([0.01, np.nan, -0.01, 0.001]),
        np.zeros(4, int),
        np.array([0.1, np.nan, 0.1, -0.1]),
    )
    scored = Scored(np.zeros(4), np.zeros(4))
    found = summary(["a"] * 4, scored, report, 0.002, no_paths(), ["lookup"] * 4)["all"]
    assert found["collision_rate"] == 0.5
    assert found["below_margin_rate"] == 0.75
    assert found["limit_rate"] == 0.5


@pytest.mark.parametrize(
    "clearance, collides, close",
    [
        (-0.005, 1, 1), (-0.004, 1, 1), (-1e-9, 1, 1), (-5e-324, 1, 1), (0.0, 0, 1), (1e-9, 0, 1),
        (0.002 - 1e-12, 0, 1), (0.002, 0, 0), (np.inf, 0, 0), (np.nan, 1, 1), (-np.inf, 1, 1),
    ],
)  # fmt: skip
def test_bodies_that_overlap_at_all_collide_and_those_below_the_margin_are_close(
    clearance, collides, close
):
    report = Report(np.array([clearance]), np.zeros(1, int), np.array([0.1]))
    scored = Scored(np.zeros(1), np.zeros(1))
    found = summary(["a"], scored, report, 0.002, no_paths(), ["lookup"])
    for figures in (found["all"], found["motions"]["a"]):
        assert (figures["collision_rate"], figures["below_margin_rate"]) == (collides, close)


@pytest.mark.parametrize(
    "room, outside", [(0.0, 0), (1e-12, 0), (-5e-324, 1), (-0.01, 1), (np.nan, 1)]
)
def test_a_joint_beyond_its_limit_by_any_amount_is_outside(room, outside):
    report = Report(np.array([0.01]), np.zeros(1, int), np.array([room]))
    scored = Scored(np.zeros(1), np.zeros(1))
    found = summary(["a"], scored, report, 0.002, no_paths(), ["lookup"])
    assert found["all"]["limit_rate"] == found["motions"]["a"]["limit_rate"] == outside


def test_modes_of_a_stream_are_shares_of_frames():
    report = Report(np.full(4, 0.01), np.zeros(4, int), np.full(4, 0.1))
    modes = ["start", "limited", "detour", "shortened"]
    scored = Scored(np.zeros(4), np.zeros(4))
    found = summary(["a", "a", "b", "b"], scored, report, 0.002, no_paths(), modes)
    assert [found["all"][name] for name in evaluation._MODES] == [0.25, 0.5, 0.0]
    assert found["motions"]["b"]["avoiding_rate"] == 1.0


# --- between the frames, on the robot of two planar arms


DOWN, RAISED, NEARLY_RAISED, INTO_THE_BODY = 0.0, 2.9, 2.8, 1.2  # [rad], of its right shoulder
MOTION = [  # clip, frame, right shoulder; the left arm stays aside
    ("a", 0, DOWN), ("a", 1, RAISED), ("a", 2, NEARLY_RAISED), ("a", 4, DOWN),
    ("a", 5, INTO_THE_BODY), ("b", 0, DOWN), ("b", 1, DOWN - 0.1),
]  # fmt: skip


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    return Robot.from_file(write_arms(tmp_path_factory.mktemp("arms")), MARGIN, "midpoint")


def moved(arms):
    """What lies between the frames of MOTION, and the figures of it."""
    clip, frame, shoulder = map(np.array, zip(*MOTION, strict=True))
    assert arms.joint_names[2] == "r_shoulder"
    q = np.stack([1.5 + 0 * shoulder, 0 * shoulder, shoulder, 0 * shoulder], axis=1)
    report = arms.certifier().check(q)
    assert (report.clearance >= MARGIN).tolist() == (shoulder != INTO_THE_BODY).tolist()
    found = between(arms, {"clip": clip, "frame": frame, "time": frame / 30.0}, q, report)
    scored = Scored(np.zeros(len(q)), np.zeros(len(q)))
    return found, summary(clip, scored, report, MARGIN, found, ["lookup"] * len(q))


def test_a_segment_joins_frames_that_follow_each_other_in_one_motion(arms):
    found, figures = moved(arms)
    assert found.row.tolist() == [0, 1, 3, 5]  # not over the gap, not from a to b
    assert figures["motions"]["a"]["segments"] == 3
    assert figures["motions"]["b"]["segments"] == 1


def test_a_path_that_collides_between_two_safe_poses_is_counted(arms):
    found, figures = moved(arms)
    assert found.feasible.tolist() == [True, True, False, True]
    assert found.collides.tolist() == [True, False, True, False]  # through the body; into it
    assert found.unproven.tolist() == [True, False, True, False]
    total = figures["all"]
    assert total["segments_colliding"] == 1  # whose ends are safe
    assert total["segment_collision_rate"] == pytest.approx(1 / 3)
    assert total["segment_uncertified_rate"] == 0.5
    assert total["segment_margin_mm"] == pytest.approx(MARGIN * 250)
    assert figures["motions"]["b"]["segments_colliding"] == 0


def test_speeds_and_jumps_are_those_at_the_clip_s_frame_rate(arms):
    found, figures = moved(arms)
    assert found.fast.tolist() == [True, False, True, False]  # 87, 3, 36 and 3 of 4 rad/s
    assert figures["all"]["segment_too_fast_rate"] == 0.5
    assert figures["all"]["largest_jump_rad"] == pytest.approx(RAISED - DOWN)
    assert figures["motions"]["b"]["largest_jump_rad"] == pytest.approx(0.1)


def test_what_no_proof_decides_is_counted_apart_and_never_as_certified(arms, monkeypatch):
    whole = paths.certify
    monkeypatch.setattr(
        paths, "certify", lambda *all_of_it, **its: whole(*all_of_it, **its, budget=0)
    )
    found, figures = moved(arms)
    assert figures["all"]["segments_colliding"] == 0
    assert figures["all"]["segments_undecided"] == 1
    assert figures["all"]["segment_undecided_rate"] == pytest.approx(1 / 3)
    assert found.unproven[0]


def test_a_collision_that_coal_does_not_see_is_undecided(arms, monkeypatch):
    check = Certifier.check

    def blind(self, q, progress=None):
        report = check(self, q, progress)
        return report if len(q) == len(MOTION) else report._replace(clearance=0 * report.clearance)

    monkeypatch.setattr(Certifier, "check", blind)
    _, figures = moved(arms)
    assert figures["all"]["segments_colliding"] == 0
    assert figures["all"]["segments_undecided"] == 1


@pytest.mark.parametrize("depth", [1e-9, 0.004, 0.006], ids="{:g} m deep".format)
def test_a_path_collides_by_coal_however_little_its_bodies_overlap(arms, monkeypatch, depth):
    check = Certifier.check

    def grazing(self, q, progress=None):
        report = check(self, q, progress)
        return (
            report if len(q) == len(MOTION) else report._replace(clearance=np.full(len(q), -depth))
        )

    monkeypatch.setattr(Certifier, "check", grazing)
    found, figures = moved(arms)
    assert found.collides.tolist() == [True, False, True, False]
    assert figures["all"]["segments_colliding"] == 1 and not found.undecided.any()


@pytest.mark.parametrize("unknown", ["clearance", "limit_margin"])
def test_a_segment_with_a_frame_that_was_not_measured_is_none_between_feasible_ones(arms, unknown):
    q = np.tile(arms.anchor, (3, 1))
    report = arms.certifier().check(q)
    getattr(report, unknown)[1] = np.nan
    frames = {"clip": np.array(["a"] * 3), "frame": np.arange(3), "time": np.arange(3) / 30.0}
    found = between(arms, frames, q, report)
    assert found.feasible.tolist() == [False, False]
    getattr(report, unknown)[1] = 0.0  # the margin of a pose is more, that of a joint is not
    found = between(arms, frames, q, report)
    assert found.feasible.tolist() == [unknown == "limit_margin"] * 2


def test_one_frame_alone_has_no_segments_and_no_shares(arms):
    q = np.array([[1.5, 0.0, DOWN, 0.0]])
    report = arms.certifier().check(q)
    alone = {"clip": np.array(["a"]), "frame": np.array([0]), "time": np.zeros(1)}
    found = between(arms, alone, q, report)
    total = summary(["a"], Scored(*np.zeros((2, 1))), report, MARGIN, found, ["lookup"])["all"]
    assert total["segments"] == 0 and total["largest_jump_rad"] == 0.0
    assert total["segment_collision_rate"] is None and total["segment_too_fast_rate"] is None


def test_the_number_of_threads_changes_nothing(arms, monkeypatch):
    monkeypatch.setattr(paths, "CHUNK", 2)
    found = []
    for threads in (1, 3):
        use_threads(threads)
        try:
            found.append(moved(arms)[0])
        finally:
            use_threads(0)
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)
