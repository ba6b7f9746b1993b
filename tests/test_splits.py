"""Which frames a stage may look at, and that the stages look at no other."""

import numpy as np
import pytest
from worlds import MARGIN, coman, inside_limits, relaxed

from s3le.errors import CertificateError, ClipError
from s3le.human.splits import test_rows as rows_to_test  # pytest would take it for a test
from s3le.human.splits import train_rows
from s3le.kernels import batch
from s3le.robot.certificate import point_positions
from s3le.skeleton import cosine_distance
from s3le.study import truth
from s3le.tuples import ik, pairing

ENDS = [("hip", "neck")] + [
    pair
    for side in "rl"
    for pair in (
        ("neck", f"{side}_shoulder"),
        (f"{side}_shoulder", f"{side}_elbow"),
        (f"{side}_elbow", f"{side}_hand"),
    )
]  # of the seven vectors, in the order of x
SPLITS = np.array(["test", "train", "train", "demo", "train", "test", "train", "train"])


def frames(seed=2):
    """Skeletons of COMAN's own poses, collisions and all, in clips of every split."""
    q = inside_limits(coman(), len(SPLITS), seed)
    return {
        "split": SPLITS,
        "clip": np.array([f"clip{i}" for i in range(len(SPLITS))]),
        "frame": 10 * np.arange(len(SPLITS)),
        "x": batch.skeletons(coman().chain, q),
    }


def test_training_rows_are_of_training_clips_and_test_rows_all_others():
    assert train_rows({"split": SPLITS}, 99).tolist() == [1, 2, 4, 6, 7]
    assert rows_to_test({"split": SPLITS}).tolist() == [0, 3, 5]
    together = np.concatenate([train_rows({"split": SPLITS}, 99), rows_to_test({"split": SPLITS})])
    assert sorted(together) == list(range(len(SPLITS)))


@pytest.mark.parametrize("count, want", [(5, [1, 2, 4, 6, 7]), (3, [1, 4, 7]), (2, [1, 7])])
def test_training_rows_are_thinned_evenly_over_the_training_clips_alone(count, want):
    assert train_rows({"split": SPLITS}, count).tolist() == want


def test_a_split_without_a_frame_is_refused_in_words():
    with pytest.raises(ClipError, match="no training frame is left"):
        train_rows({"split": np.array(["test", "demo"])}, 3)
    with pytest.raises(ClipError, match="no test frame is left; put a clip into the split 'test'"):
        rows_to_test({"split": np.array(["train", "train"])})


# --- tuples from motion capture


def skeleton_by_pinocchio(q):
    """The seven unit vectors of one pose, by another kinematics (21,)."""
    at = dict(zip(coman().points, point_positions(coman(), q), strict=True))
    ways = [at[end] - at[begin] for begin, end in ENDS]
    return np.concatenate([way / np.linalg.norm(way) for way in ways])


def test_pairs_are_of_training_frames_and_every_column_says_what_it_is():
    made, given = coman(), frames()
    found, counts = pairing.pair(made, given, 99, 1e-3)
    train = np.flatnonzero(SPLITS == "train")
    assert found["clip"].tolist() == given["clip"][train].tolist()
    assert found["frame"].tolist() == given["frame"][train].tolist()
    assert (found["x_relaxed"] == given["x"][train]).all()
    for q, x in zip(found["q_feasible"], found["x_feasible"], strict=True):
        assert np.allclose(skeleton_by_pinocchio(q), x, rtol=0, atol=1e-9)
    # The relaxed pose has the human's skeleton, the feasible one is its projection.
    reached = np.array([skeleton_by_pinocchio(q) for q in found["q_relaxed"]])
    assert np.allclose(
        found["residual"], cosine_distance(reached, given["x"][train]), rtol=0, atol=1e-9
    )
    assert found["residual"].max() < 1e-3
    by_itself = [batch.project(made.chain, made.anchor, q[None], MARGIN)
                 for q in found["q_relaxed"]]  # fmt: skip
    assert (found["q_feasible"] == np.concatenate([one.q for one in by_itself])).all()
    moved = (found["q_feasible"] != found["q_relaxed"]).any(axis=1)
    assert ((found["projection"] != "feasible already") == moved).all() and moved.any()
    report = made.certifier().check(found["q_feasible"])
    assert (report.clearance >= MARGIN).all() and (found["clearance"] == report.clearance).all()
    assert (found["limit_margin"] == report.limit_margin).all()
    assert counts["rows"] == len(train) and counts["feasible"] == (~moved).sum()
    assert counts["residual_mean"] == pytest.approx(found["residual"].mean())


def test_a_tuple_whose_projection_is_not_feasible_stops_the_pairing(monkeypatch):
    whole = batch.project

    def blind(chain, anchor, q, margin, **more):
        found = whole(chain, anchor, q, margin, **more)
        found.q[-1] = 0.0  # arms down: the hands are in the thighs
        return found

    monkeypatch.setattr(batch, "project", blind)
    with pytest.raises(CertificateError, match="1 of 5 poses are not feasible"):
        pairing.pair(coman(), frames(), 99, 1e-3)


# --- the ground truth


def test_the_ground_truth_is_of_test_frames_feasible_and_near():
    made, given = coman(), frames()
    found = truth.ground_truth(made, given, 2, 1e-3, np.random.default_rng(0))
    test = np.flatnonzero(SPLITS != "train")
    for name in ("split", "clip", "frame"):
        assert found[name].tolist() == given[name][test].tolist()
    x = np.array([skeleton_by_pinocchio(q) for q in found["q"]])
    assert np.allclose(found["x"], x, rtol=0, atol=1e-9)
    assert np.allclose(found["to_human"], cosine_distance(x, given["x"][test]), atol=1e-9)
    report = made.certifier().check(found["q"])
    assert (found["clearance"] == report.clearance).all()
    assert (report.clearance >= MARGIN).all() and (report.limit_margin >= 0.0).all()
    # No farther than what the projection of the relaxed pose reaches.
    start, _ = ik.relaxed_poses(made, given["x"][test], 1e-3)
    start = batch.project(made.chain, made.anchor, start, MARGIN).q
    reached = cosine_distance(batch.skeletons(made.chain, start), given["x"][test])
    assert (found["to_human"] <= reached + 1e-6).all()


def test_where_no_solve_ends_feasible_the_projected_relaxed_pose_is_the_truth(monkeypatch):
    made, x = coman(), frames()["x"][:3]
    whole = batch.follow

    def failing(chain, x, starts, middle, ridge, margin, collide, progress=None):
        found = whole(chain, x, starts, middle, ridge, margin, collide, progress)
        if collide:
            found.feasible[1] = False
            found.q[1] = 0.0  # arms down: the hands are in the thighs
        return found

    monkeypatch.setattr(batch, "follow", failing)
    q, distance = ik.ground_truth(made, x, 2, 1e-3, np.random.default_rng(0))
    relaxed_pose, _ = ik.relaxed_poses(made, x[1:2], 1e-3)
    first = batch.project(made.chain, made.anchor, relaxed_pose, MARGIN).q[0]
    assert np.allclose(q[1], first, rtol=0, atol=1e-9)
    assert (made.certifier().check(q).clearance >= MARGIN).all()
    assert np.allclose(distance, cosine_distance(batch.skeletons(made.chain, q), x), atol=1e-9)


def test_a_ground_truth_that_is_not_feasible_is_refused(monkeypatch):
    def blind(made, x, *more):
        return np.zeros((len(x), made.n_dof)), np.zeros(len(x))

    monkeypatch.setattr(ik, "ground_truth", blind)
    with pytest.raises(CertificateError, match="3 of 3 poses are not feasible"):
        truth.ground_truth(coman(), frames(), 2, 1e-3, np.random.default_rng(0))


def test_a_relaxed_pose_is_the_one_nearest_to_the_range_among_those_whole_turns_away():
    made = coman()
    low, high = made.lower, made.upper
    q = relaxed(made, 20, 3)
    turned = q + 2 * np.pi * np.random.default_rng(1).integers(-2, 3, q.shape)
    found = ik.nearest_turn(turned, low, high)

    def beyond(q):
        return np.maximum(np.maximum(low - q, q - high), 0.0)

    assert np.allclose(np.cos(found), np.cos(q)) and np.allclose(np.sin(found), np.sin(q))
    for turns in (-1, 1):
        assert (beyond(found) <= beyond(found + 2 * np.pi * turns) + 1e-9).all()
