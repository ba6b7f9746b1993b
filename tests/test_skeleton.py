"""The feature x: seven unit vectors, their symmetries, and the distance between two of them."""

import json

import numpy as np
import pytest
from handmade import SHARED
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import people, yawed

from s3le import skeleton
from s3le.errors import ParameterError
from s3le.skeleton import BONES, POINTS, cosine_distance, face_forward, features, mirror

ALGEBRA = 1e-12  # [-] or [m], float64
GOLDEN = SHARED / "golden_fk.json"
GOLDEN_BONES = {  # point -> bone of the oracle whose end it is
    "hip": "root", "r_pelvis": "rhipjoint", "l_pelvis": "lhipjoint", "neck": "thorax",
    "r_shoulder": "rclavicle", "r_elbow": "rhumerus", "r_hand": "rradius",
    "l_shoulder": "lclavicle", "l_elbow": "lhumerus", "l_hand": "lradius",
}  # fmt: skip


def t_pose() -> np.ndarray:
    """Arms out, facing x, the neck joint 5 cm above the shoulder line."""
    at = {
        "hip": (0, 0, 1), "r_pelvis": (0, -0.1, 1), "l_pelvis": (0, 0.1, 1), "neck": (0, 0, 1.55),
        "r_shoulder": (0, -0.2, 1.5), "r_elbow": (0, -0.5, 1.5), "r_hand": (0, -0.75, 1.5),
        "l_shoulder": (0, 0.2, 1.5), "l_elbow": (0, 0.5, 1.5), "l_hand": (0.25, 0.5, 1.5),
    }  # fmt: skip
    return np.array([[at[name] for name in POINTS]], float)


def test_bones_of_a_t_pose_are_the_axes_in_the_order_of_bones():
    x, ok = features(t_pose())
    want = {
        "hip_to_neck": (0, 0, 1), "neck_to_r_shoulder": (0, -1, 0),
        "r_shoulder_to_elbow": (0, -1, 0), "r_elbow_to_hand": (0, -1, 0),
        "neck_to_l_shoulder": (0, 1, 0), "l_shoulder_to_elbow": (0, 1, 0),
        "l_elbow_to_hand": (1, 0, 0),
    }  # fmt: skip
    assert ok.tolist() == [True]
    assert np.allclose(x.reshape(7, 3), [want[bone] for bone in BONES], rtol=0, atol=ALGEBRA)


def test_the_neck_joint_is_used_only_where_it_is_asked_for():
    given = t_pose()
    moved = given.copy()
    moved[0, POINTS.index("neck")] += [0.3, 0.1, 0.2]
    assert np.array_equal(features(given)[0], features(moved)[0])
    own = features(given, "joint")[0].reshape(7, 3)
    down = np.array([0.0, -0.2, -0.05]) / np.hypot(0.2, 0.05)
    assert np.allclose(own[BONES.index("neck_to_r_shoulder")], down, rtol=0, atol=ALGEBRA)


def test_a_midpoint_neck_makes_the_shoulder_bones_opposite():
    x = features(people(50, 1))[0].reshape(-1, 7, 3)
    right, left = BONES.index("neck_to_r_shoulder"), BONES.index("neck_to_l_shoulder")
    assert np.allclose(x[:, right], -x[:, left], rtol=0, atol=ALGEBRA)


@pytest.mark.parametrize("neck", skeleton.NECKS)
def test_every_bone_has_unit_length(neck):
    x, ok = features(people(200, 2), neck)
    assert ok.all()
    assert np.allclose(np.linalg.norm(x.reshape(-1, 7, 3), axis=2), 1.0, rtol=0, atol=ALGEBRA)


def test_skeletons_do_not_know_where_a_person_is_how_big_nor_which_way_they_face():
    person, rng = people(60, 3), np.random.default_rng(4)
    yaw, size = rng.uniform(-9, 9, 60), rng.uniform(0.1, 40, (60, 1, 1))
    elsewhere = yawed(person * size, yaw) + rng.normal(0, 5, (60, 1, 3))
    here, there = (features(face_forward(p)[0])[0] for p in (person, elsewhere))
    assert np.allclose(here, there, rtol=0, atol=1e-11)  # [-], after metres of offset


def test_the_heading_that_is_taken_out_is_the_yaw_that_was_put_in():
    person = face_forward(people(60, 5))[0]
    yaw = np.linspace(-3.1, 3.1, 60)
    _, heading, _ = face_forward(yawed(person, yaw))
    assert np.allclose(heading, yaw, rtol=0, atol=ALGEBRA)  # [rad]


def test_facing_forward_twice_is_facing_forward_once():
    once, _, _ = face_forward(people(60, 6))
    twice, heading, _ = face_forward(once)
    assert np.allclose(once, twice, rtol=0, atol=ALGEBRA)
    assert np.allclose(heading, 0.0, rtol=0, atol=ALGEBRA)


def test_facing_forward_keeps_the_hip_heights_lengths_and_the_pelvis_slope():
    given = people(60, 7)
    turned, _, level = face_forward(given)
    line = turned[:, POINTS.index("l_pelvis")] - turned[:, POINTS.index("r_pelvis")]
    assert np.array_equal(turned[:, 0], given[:, 0])
    assert np.allclose(turned[..., 2], given[..., 2], rtol=0, atol=ALGEBRA)
    assert np.allclose(line[:, 0], 0.0, rtol=0, atol=ALGEBRA) and (line[:, 1] > 0).all()
    assert np.allclose(level, line[:, 1] / np.linalg.norm(line, axis=1), rtol=0, atol=ALGEBRA)


@pytest.mark.parametrize(
    ("left", "level"), [((0, -0.1, 2.0), 0.0), ((0, -0.1, 1.0), np.nan), ((np.nan, 0, 1), np.nan)],
    ids=["vertical line", "no line", "unknown line"],
)  # fmt: skip
def test_a_pelvis_line_that_says_no_heading_has_no_level_share(left, level):
    points = t_pose()
    points[0, POINTS.index("l_pelvis")] = left
    assert np.array_equal(face_forward(points)[2], [level], equal_nan=True)


def test_mirroring_twice_is_the_identity_to_the_bit():
    points = people(40, 8)
    x = features(points)[0]
    assert np.array_equal(mirror(mirror(x)), x)
    assert np.array_equal(skeleton.mirror_points(skeleton.mirror_points(points)), points)


def test_the_skeleton_of_the_mirrored_person_is_the_mirrored_skeleton():
    points = people(40, 9)
    mirrored, heading, _ = face_forward(skeleton.mirror_points(points))
    plain, plain_heading, _ = face_forward(points)
    assert np.allclose(features(mirrored)[0], mirror(features(plain)[0]), rtol=0, atol=1e-11)
    turn = np.exp(1j * (heading + plain_heading))
    assert np.allclose(turn, 1.0, rtol=0, atol=ALGEBRA)


def test_a_mirrored_right_hand_is_a_left_hand():
    x = mirror(features(t_pose())[0]).reshape(7, 3)
    assert np.allclose(x[BONES.index("r_elbow_to_hand")], [1, 0, 0], rtol=0, atol=ALGEBRA)


def test_cosine_distance_is_the_mean_of_one_minus_the_cosine_of_the_angles():
    a, b = np.random.default_rng(10).normal(size=(2, 300, 7, 3))
    cos = (a * b).sum(axis=2) / np.linalg.norm(a, axis=2) / np.linalg.norm(b, axis=2)
    slow = (1.0 - np.cos(np.arccos(cos))).mean(axis=1)
    fast = cosine_distance(a.reshape(-1, 21), b.reshape(-1, 21))
    assert np.allclose(fast, slow, rtol=0, atol=ALGEBRA)


def test_cosine_distance_is_zero_to_itself_two_to_its_opposite_and_symmetric():
    x = features(people(50, 11))[0]
    other = features(people(50, 12))[0]
    assert np.array_equal(cosine_distance(x, x), np.zeros(50))
    assert np.allclose(cosine_distance(x, -x), 2.0, rtol=0, atol=ALGEBRA)
    assert np.array_equal(cosine_distance(x, other), cosine_distance(other, x))
    assert np.allclose(cosine_distance(3 * x, other), cosine_distance(x, other), atol=ALGEBRA)


def test_cosine_distance_resolves_angles_whose_cosine_rounds_to_one():
    angle = 1e-9  # [rad]
    a = np.tile([1.0, 0.0, 0.0], 7)
    b = np.tile([np.cos(angle), np.sin(angle), 0.0], 7)
    assert cosine_distance(a, b) == pytest.approx(angle**2 / 2, rel=1e-6)


def test_one_person_is_compared_with_many_at_once():
    x = features(people(5, 13))[0]
    assert np.array_equal(cosine_distance(x[0], x), cosine_distance(np.tile(x[0], (5, 1)), x))


@pytest.mark.parametrize(
    "spoil",
    [
        lambda p: p.__setitem__((1, POINTS.index("r_hand"), 0), np.nan),
        lambda p: p.__setitem__((1, POINTS.index("r_hand"), 0), np.inf),
        lambda p: p.__setitem__((1, POINTS.index("r_hand")), p[1, POINTS.index("r_elbow")]),
        lambda p: p.__setitem__((1, POINTS.index("hip")), np.mean(p[1, [4, 7]], axis=0)),
    ],
    ids=["NaN", "infinite", "hand in the elbow", "hip in the neck"],
)
def test_a_frame_without_a_direction_is_marked_and_its_neighbours_are_not(spoil):
    points = people(3, 14)
    want = features(points)[0]
    spoil(points)
    x, ok = features(points)
    assert ok.tolist() == [True, False, True]
    assert np.isnan(x[1]).all()
    assert np.array_equal(x[[0, 2]], want[[0, 2]])
    assert np.isnan(cosine_distance(x, want)).tolist() == [False, True, False]


@pytest.mark.parametrize("length", [0.5e-6, 2e-6], ids=["too short", "just long enough"])
def test_a_bone_needs_a_micrometre(length):
    points = t_pose()
    points[0, POINTS.index("r_hand")] = points[0, POINTS.index("r_elbow")] + [0, 0, length]
    assert features(points)[1].tolist() == [length > skeleton.SHORTEST_BONE]


def test_a_bone_of_no_length_has_no_distance():
    a = np.tile([1.0, 0.0, 0.0], 7)
    b = a.copy()
    b[3:6] = 0.0
    assert np.isnan(cosine_distance(a, b))


def test_an_unknown_neck_and_a_wrong_shape_are_refused():
    with pytest.raises(ParameterError) as refusal:
        features(t_pose(), "thorax")
    assert str(refusal.value) == "neck must be one of midpoint, joint, got 'thorax'"
    with pytest.raises(ParameterError) as refusal:
        features(np.zeros((4, 9, 3)))
    assert str(refusal.value) == "points must have shape (n, 10, 3), got (4, 9, 3)"


@pytest.mark.skipif(not GOLDEN.is_file(), reason="needs the real clips beside the project")
def test_unit_vectors_of_an_independent_reader_are_reproduced_from_its_joint_positions():
    oracle = json.loads(GOLDEN.read_text())
    for trial, want in oracle.items():
        at = [np.array(want["joint_pos_asf_units"][GOLDEN_BONES[point]]) for point in POINTS]
        points = np.stack(at, axis=1)[..., [2, 0, 1]]  # y up, z forward -> x forward, z up
        x, ok = features(face_forward(points)[0])
        assert ok.all(), trial
        vectors = np.array(want["unit_vectors_mid_neck"]).reshape(-1, 21)
        assert np.allclose(x, vectors, rtol=0, atol=1e-8), trial  # [-], the oracle has 9 digits


# --- laws for any input


def turned(seed: int) -> np.ndarray:
    """A rotation, (3, 3), uniform over all of them."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def skeletons(seed: int, n: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n, 21))


SEEDS = st.integers(0, 2**31)


@settings(deadline=None, max_examples=40)
@given(seed=SEEDS, neck=st.sampled_from(skeleton.NECKS))
def test_turning_a_person_any_way_turns_every_bone_alike(seed, neck):
    points, turn = people(3, seed), turned(seed)
    x = features(points, neck)[0].reshape(-1, 7, 3)
    assert np.allclose(features(points @ turn.T, neck)[0].reshape(-1, 7, 3), x @ turn.T, atol=1e-11)


@settings(deadline=None, max_examples=40)
@given(
    seed=SEEDS, size=st.floats(1e-2, 1e3), yaw=st.floats(-10, 10),
    place=st.tuples(*[st.floats(-1e3, 1e3)] * 3), neck=st.sampled_from(skeleton.NECKS),
)  # fmt: skip
def test_a_skeleton_is_the_same_wherever_whatever_size_and_whichever_way(
    seed, size, yaw, place, neck
):
    points = people(3, seed)
    points -= points[:, :1]
    moved = yawed(size * points, yaw) + np.array(place)
    x, x_moved = (features(face_forward(p)[0], neck)[0] for p in (points, moved))
    # a coordinate of 1e3 m has 1e-13 m of rounding, the shortest bone here some 1e-4 m
    assert np.allclose(x, x_moved, rtol=0, atol=1e-7)
    both = skeleton.mirror_points(face_forward(moved)[0])
    assert np.allclose(features(both, neck)[0], mirror(x), rtol=0, atol=1e-7)


@settings(deadline=None, max_examples=40)
@given(
    values=st.lists(
        st.one_of(st.floats(-1e4, 1e4), st.sampled_from([np.nan, np.inf, -np.inf, 0.0, 1e-320])),
        min_size=30, max_size=30,
    ),
)  # fmt: skip
def test_a_frame_is_either_seven_unit_vectors_or_marked_and_nan(values):
    x, ok = features(np.reshape(values, (1, 10, 3)))
    assert x.shape == (1, 21) and ok.shape == (1,)
    if ok[0]:
        assert np.isfinite(values)[[0, 1, 2]].all()  # the hip enters
        assert np.allclose(np.linalg.norm(x.reshape(7, 3), axis=1), 1.0, rtol=0, atol=ALGEBRA)
    else:
        assert np.isnan(x).all()


@settings(deadline=None, max_examples=40)
@given(seed=SEEDS)
def test_the_root_of_the_cosine_distance_is_a_metric_that_no_rotation_changes(seed):
    a, b, c = (skeletons(seed + i, 20) for i in range(3))
    ab, bc, ac = (cosine_distance(*pair) for pair in ((a, b), (b, c), (a, c)))
    assert ((ab >= 0) & (ab <= 2 + ALGEBRA)).all()
    assert (np.sqrt(ac) <= np.sqrt(ab) + np.sqrt(bc) + ALGEBRA).all()
    turn = turned(seed)
    both = [(v.reshape(-1, 7, 3) @ turn.T).reshape(-1, 21) for v in (a, b)]
    assert np.allclose(cosine_distance(*both), ab, rtol=0, atol=ALGEBRA)


@settings(deadline=None, max_examples=40)
@given(seed=SEEDS, sizes=st.lists(st.floats(1e-100, 1e100), min_size=7, max_size=7))
def test_the_cosine_distance_does_not_see_the_length_of_a_bone(seed, sizes):
    a, b = skeletons(seed, 5), skeletons(seed + 1, 5)
    longer = (a.reshape(-1, 7, 3) * np.reshape(sizes, (7, 1))).reshape(-1, 21)
    assert np.allclose(cosine_distance(longer, b), cosine_distance(a, b), rtol=0, atol=ALGEBRA)
