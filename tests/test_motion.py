"""From joint positions to skeletons: dropped frames by cause, rates, and augmentation."""

import numpy as np
import pytest
from worlds import people, yawed

from s3le.errors import ClipError
from s3le.human.dataset import at_rate, domain, training_domain
from s3le.human.skeletons import LEVEL_MIN, skeletons
from s3le.skeleton import POINTS, face_forward, features, mirror

ALGEBRA = 1e-12  # [-] or [rad]
TILT = np.radians(60.0)  # params.yaml's tilt_max
AT = {name: i for i, name in enumerate(POINTS)}
NONE = {"not_finite": 0, "pelvis": 0, "bone": 0, "tilt": 0}


def upright() -> np.ndarray:
    """One frame, arms out, facing x, (10, 3) [m]."""
    at = {
        "hip": (0, 0, 1), "r_pelvis": (0, -0.1, 1), "l_pelvis": (0, 0.1, 1), "neck": (0, 0, 1.55),
        "r_shoulder": (0, -0.2, 1.5), "r_elbow": (0, -0.5, 1.5), "r_hand": (0, -0.75, 1.5),
        "l_shoulder": (0, 0.2, 1.5), "l_elbow": (0, 0.5, 1.5), "l_hand": (0, 0.75, 1.5),
    }  # fmt: skip
    return np.array([at[name] for name in POINTS], float)


def leaning(angle: float) -> np.ndarray:
    """The frame with all above the hip pitched forward about it by angle [rad]."""
    frame = upright()
    c, s = np.cos(angle), np.sin(angle)
    above = [AT[name] for name in POINTS if "pelvis" not in name]
    frame[above] = (frame[above] - frame[0]) @ [[c, 0, -s], [0, 1, 0], [s, 0, c]] + frame[0]
    return frame


def changed(point: str, value) -> np.ndarray:
    frame = upright()
    frame[AT[point]] = value
    return frame


def sloping(level: float) -> np.ndarray:
    """The pelvis line with this share of its length horizontal."""
    frame = upright()
    way = np.array([0.0, level, np.sqrt(1 - level**2)]) * 0.1
    frame[AT["l_pelvis"]], frame[AT["r_pelvis"]] = frame[0] + way, frame[0] - way
    return frame


def points_of(clips: dict[tuple[str, str], tuple[float, np.ndarray]]) -> dict[str, np.ndarray]:
    """Columns of table mocap_points from (split, clip) -> (fps, frames)."""
    columns = {"split": [], "clip": [], "frame": [], "fps": [], "points": []}
    for (split, clip), (fps, frames) in clips.items():
        for i, frame in enumerate(frames):
            for name, value in zip(columns, (split, clip, i, fps, frame.ravel()), strict=True):
                columns[name].append(value)
    return {name: np.array(values) for name, values in columns.items()}


# --- dropping

CAUSES = {
    "NaN": (changed("r_hand", np.nan), "not_finite"),
    "one NaN coordinate": (changed("l_elbow", (0, np.nan, 1.5)), "not_finite"),
    "infinite": (changed("neck", np.inf), "not_finite"),
    "everything infinite": (np.full((10, 3), -np.inf), "not_finite"),
    "NaN in an unused neck": (changed("neck", np.nan), "not_finite"),
    "vertical pelvis": (sloping(0.0), "pelvis"),
    "steep pelvis": (sloping(LEVEL_MIN - 1e-6), "pelvis"),
    "no pelvis line": (changed("l_pelvis", (0, -0.1, 1)), "pelvis"),
    "hand in the elbow": (changed("r_hand", (0, -0.5, 1.5)), "bone"),
    "elbow in the shoulder": (changed("l_elbow", (0, 0.2, 1.5)), "bone"),
    "hip in the neck": (changed("hip", (0, 0, 1.5)), "bone"),
    "leaning": (leaning(TILT + 1e-6), "tilt"),
    "upside down": (leaning(np.pi), "tilt"),
    "unknown and steep and boneless": (np.full((10, 3), np.nan), "not_finite"),
    "steep and boneless": (np.zeros((10, 3)), "pelvis"),
}


@pytest.mark.parametrize(("frame", "cause"), CAUSES.values(), ids=CAUSES)
def test_a_frame_is_dropped_under_its_first_cause_alone(frame, cause):
    kept = skeletons(np.stack([upright(), frame, upright()]), "midpoint", TILT)
    assert kept.dropped == NONE | {cause: 1}
    assert kept.rows.tolist() == [0, 2]
    assert np.isfinite(kept.x).all()


@pytest.mark.parametrize(
    "frame",
    [leaning(TILT - 1e-6), leaning(-TILT + 1e-6), sloping(LEVEL_MIN + 1e-6),
     changed("r_hand", (0, -0.5, 1.500002))],
    ids=["leaning", "leaning back", "sloping", "short forearm"],
)  # fmt: skip
def test_a_frame_just_within_the_bounds_is_kept(frame):
    kept = skeletons(frame[None], "midpoint", TILT)
    assert kept.dropped == NONE and len(kept.x) == 1


def test_kept_and_dropped_are_all_frames():
    frames = np.stack([frame for frame, _ in CAUSES.values()] + [upright()] * 5)
    kept = skeletons(frames, "midpoint", TILT)
    assert len(kept.rows) + sum(kept.dropped.values()) == len(frames)
    want = [cause for _, cause in CAUSES.values()]
    assert kept.dropped == {cause: want.count(cause) for cause in NONE}


def test_a_wider_tilt_keeps_the_leaning_frame():
    frame = leaning(np.radians(75))[None]
    assert skeletons(frame, "midpoint", TILT).dropped["tilt"] == 1
    assert skeletons(frame, "midpoint", np.pi).dropped == NONE


def test_no_frames_are_no_skeletons():
    kept = skeletons(np.empty((0, 10, 3)), "midpoint", TILT)
    assert kept.x.shape == (0, 21) and kept.dropped == NONE


def test_kept_skeletons_face_forward_and_remember_their_heading():
    points = people(30, 1)
    kept = skeletons(points, "midpoint", np.pi)
    turned, heading, _ = face_forward(points)
    assert np.array_equal(kept.x, features(turned)[0][kept.rows])
    assert np.array_equal(kept.heading, heading[kept.rows])
    again = skeletons(yawed(points, 0.7), "midpoint", np.pi)
    assert np.allclose(again.x, kept.x, rtol=0, atol=1e-10)


# --- the mocap domain


def kinds(made):
    return {kind: int((made.kind == kind).sum()) for kind in ("raw", "mirrored", "noisy")}


@pytest.mark.parametrize(
    ("count", "want"),
    [
        (10, {"raw": 10, "mirrored": 0, "noisy": 0}),
        (40, {"raw": 40, "mirrored": 0, "noisy": 0}),
        (41, {"raw": 40, "mirrored": 1, "noisy": 0}),
        (80, {"raw": 40, "mirrored": 40, "noisy": 0}),
        (200, {"raw": 40, "mirrored": 40, "noisy": 120}),
    ],
    ids=str,
)
def test_recorded_frames_come_first_then_mirrored_then_noisy(count, want):
    made = domain(people(40, 2), "midpoint", TILT, count, 0.03, np.random.default_rng(3))
    assert kinds(made) == want
    assert made.kind.tolist() == sorted(made.kind.tolist(), key=["raw", "mirrored", "noisy"].index)
    assert len(made.x) == len(made.origin) == count


def test_without_noise_there_are_at_most_two_rows_a_frame():
    made = domain(people(20, 4), "midpoint", TILT, 500, 0.0, np.random.default_rng(5))
    assert kinds(made) == {"raw": 20, "mirrored": 20, "noisy": 0}


def test_raw_rows_are_the_recorded_skeletons_and_mirrored_rows_their_mirrors():
    points = people(20, 6)
    made = domain(points, "midpoint", TILT, 40, 0.0, np.random.default_rng(7))
    want = skeletons(points, "midpoint", TILT).x
    assert np.array_equal(made.x[:20], want)
    assert np.allclose(made.x[20:], mirror(want), rtol=0, atol=ALGEBRA)
    assert made.origin.tolist() == [*range(20), *range(20)]


def test_rows_name_the_frame_they_come_from_even_where_frames_were_dropped():
    points = people(12, 8)
    points[[0, 5]] = np.nan
    made = domain(points, "midpoint", TILT, 300, 1e-9, np.random.default_rng(9))
    assert not np.isin(made.origin, [0, 5]).any()
    want, _ = features(face_forward(points)[0])
    for x, origin in zip(made.x, made.origin, strict=True):
        assert min(np.abs(x - want[origin]).max(), np.abs(x - mirror(want[[origin]])).max()) < 1e-6


def test_a_thinned_domain_spans_the_whole_recording():
    made = domain(people(100, 10), "midpoint", TILT, 7, 0.03, np.random.default_rng(11))
    assert made.origin[0] == 0 and made.origin[-1] == 99
    assert np.ptp(np.diff(made.origin)) <= 1


def test_noise_moves_joints_by_what_was_asked_for():
    points = np.repeat(upright()[None], 2, axis=0)
    made = domain(points, "midpoint", np.pi, 8004, 0.03, np.random.default_rng(12))
    hand = made.x[made.kind == "noisy"].reshape(-1, 7, 3)[:, 3]  # right elbow to hand, along -y
    # Two ends shake across a bone of 25 cm; the heading adds a little to the forward part.
    assert hand[:, 2].std() == pytest.approx(np.sqrt(2) * 0.03 / 0.25, rel=0.1)
    assert np.allclose(np.linalg.norm(made.x.reshape(-1, 7, 3), axis=2), 1, rtol=0, atol=ALGEBRA)


def test_a_domain_is_a_function_of_its_seed():
    points = people(10, 13)
    a, b, c = (
        domain(points, "midpoint", TILT, 90, 0.03, np.random.default_rng(s)) for s in (1, 1, 2)
    )
    assert np.array_equal(a.x, b.x) and not np.array_equal(a.x, c.x)


def test_a_recording_without_a_usable_frame_ends_with_no_rows():
    made = domain(np.zeros((4, 10, 3)), "midpoint", TILT, 50, 0.03, np.random.default_rng(14))
    assert made.x.shape == (0, 21) and len(made.kind) == 0


def test_only_training_clips_enter_the_domain_at_their_own_rate():
    table = points_of(
        {
            ("train", "a"): (120.0, people(30, 15)),
            ("test", "b"): (30.0, people(20, 16)),
            ("train", "c"): (60.0, people(10, 17)),
            ("heldout", "d"): (30.0, people(20, 18)),
        }
    )
    columns, counts = training_domain(table, "midpoint", TILT, 100, 0.03, np.random.default_rng(19))
    assert counts == {"raw": 40, "mirrored": 40, "noisy": 20}
    assert set(columns["clip"]) == {"a", "c"}
    raw = columns["kind"] == "raw"
    assert (columns["clip"][raw] == "a").sum() == 30  # every frame, not one in four
    assert columns["row"].tolist() == list(range(100))


def test_a_domain_without_a_training_clip_is_refused():
    table = points_of({("test", "b"): (30.0, people(5, 20))})
    with pytest.raises(ClipError) as refusal:
        training_domain(table, "midpoint", TILT, 10, 0.03, np.random.default_rng(21))
    assert str(refusal.value) == ("there is no training clip; put some into the split 'train'")


# --- one rate for all


@pytest.mark.parametrize(
    ("fps", "frames", "rate", "want"),
    [(120.0, 9, 30.0, 3), (30.0, 5, 30.0, 5), (60.0, 4, 30.0, 2), (15.0, 3, 30.0, 5),
     (29.97, 30, 30.0, 30), (120.0, 1, 30.0, 1)],
    ids=["120 to 30", "30 to 30", "60 to 30", "15 to 30", "29.97 to 30", "one frame"],
)  # fmt: skip
def test_clips_are_brought_to_the_rate(fps, frames, rate, want):
    table = points_of({("train", "a"): (fps, np.stack([upright()] * frames))})
    motion, counts = at_rate(table, rate, "midpoint", TILT)
    assert counts == {"train": {"clips": 1, "frames": want, "empty_clips": 0}
                      | {f"dropped_{cause}": 0 for cause in NONE}}  # fmt: skip
    assert motion.frame.tolist() == list(range(want))
    assert np.allclose(motion.time, np.arange(want) / rate, rtol=0, atol=ALGEBRA)


def test_frames_that_fall_on_a_sample_are_taken_as_they_are():
    points = people(9, 22)
    motion, _ = at_rate(points_of({("train", "a"): (120.0, points)}), 30.0, "midpoint", np.pi)
    assert np.array_equal(motion.x, skeletons(points[::4], "midpoint", np.pi).x)


def test_frames_between_samples_are_halfway_in_position():
    two = np.stack([upright(), leaning(0.4)])
    motion, _ = at_rate(points_of({("train", "a"): (10.0, two)}), 20.0, "midpoint", TILT)
    want, _ = features(two.mean(axis=0)[None])
    assert np.allclose(motion.x[1], want[0], rtol=0, atol=ALGEBRA)


def test_dropped_frames_leave_gaps_and_are_counted_by_split_and_cause():
    good, bad = upright(), np.full((10, 3), np.nan)
    table = points_of(
        {
            ("train", "a"): (30.0, np.stack([good, bad, good, sloping(0.0)])),
            ("train", "b"): (30.0, np.stack([leaning(2.0)] * 3)),
            ("test", "c"): (30.0, np.stack([good, changed("hip", (0, 0, 1.5)), good])),
        }
    )
    motion, counts = at_rate(table, 30.0, "midpoint", TILT)
    assert motion.clip.tolist() == ["a", "a", "c", "c"]
    assert motion.frame.tolist() == [0, 2, 0, 2]
    assert motion.split.tolist() == ["train", "train", "test", "test"]
    assert counts["train"] == {
        "clips": 2, "frames": 2, "empty_clips": 1, "dropped_not_finite": 1, "dropped_pelvis": 1,
        "dropped_bone": 0, "dropped_tilt": 3,
    }  # fmt: skip
    assert counts["test"] == {
        "clips": 1, "frames": 2, "empty_clips": 0, "dropped_not_finite": 0, "dropped_pelvis": 0,
        "dropped_bone": 1, "dropped_tilt": 0,
    }  # fmt: skip


def test_a_frame_of_nan_spoils_only_the_samples_between_its_neighbours():
    frames = np.stack([upright()] * 9)
    frames[3] = np.nan
    _, counts = at_rate(points_of({("train", "a"): (60.0, frames)}), 30.0, "midpoint", TILT)
    assert counts["train"]["frames"] == 5 and counts["train"]["dropped_not_finite"] == 0
    _, counts = at_rate(points_of({("train", "a"): (20.0, frames)}), 30.0, "midpoint", TILT)
    assert counts["train"]["dropped_not_finite"] > 0


def test_clips_of_one_name_in_two_splits_are_never_joined():
    table = points_of(
        {
            ("train", "walk"): (30.0, np.stack([upright()] * 4)),
            ("test", "walk"): (30.0, np.stack([upright()] * 6)),
        }
    )
    motion, counts = at_rate(table, 30.0, "midpoint", TILT)
    assert counts["train"]["frames"] == 4 and counts["test"]["frames"] == 6
    assert motion.split.tolist() == ["train"] * 4 + ["test"] * 6


def test_clips_of_which_no_frame_can_be_used_are_refused():
    table = points_of({("train", "a"): (30.0, np.stack([leaning(3.0)] * 2))})
    with pytest.raises(ClipError, match="no frame of any clip is usable: .*'dropped_tilt': 2"):
        at_rate(table, 30.0, "midpoint", TILT)
