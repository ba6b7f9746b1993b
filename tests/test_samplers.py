"""Samplers: in the box, shards that make one sequence, any robot, and the law that each follows."""

import numpy as np
import pytest
from worlds import ARMS_YAML, MARGIN, ROBOTS, coman, edited, write_arms

from s3le import skeleton
from s3le.errors import ParameterError
from s3le.kernels import batch
from s3le.robot.robot import Robot
from s3le.tuples import samplers
from s3le.tuples.samplers import SAMPLERS, draw, limbs, mirror_signs
from s3le.tuples.sampling import relaxed_limits

ALGEBRA = 1e-12  # [rad], float64


def stream(seed):
    return np.random.default_rng(seed)


def box(made, alpha=0.2):
    return relaxed_limits(made.lower, made.upper, alpha)


def rows(name, made, count, shard=0, first=0, seed=7):
    return draw(name, made, *box(made), first, count, stream(shard), seed)


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    """Robots of every make: with a trunk, without one, with unequal arms, without arms."""
    folder = tmp_path_factory.mktemp("robots")
    unequal = edited(
        ARMS_YAML,
        ("[r_shoulder, r_elbow, l_shoulder, l_elbow]", "[r_shoulder, l_shoulder, l_elbow]"),
    )
    text = (ROBOTS / "coman.yaml").read_text(encoding="utf-8")
    start = text.index("joints: [")
    stiff = text.replace(
        text[start : text.index("\n", start)], "joints: [WaistLat, WaistSag, WaistYaw]"
    )
    stiff = edited(
        stiff,
        ("hold: {}", "hold: {LShLat: 1.5707963, RShLat: -1.5707963}"),
        ("urdf/coman.urdf", str(ROBOTS / "urdf" / "coman.urdf")),
    )
    start = stiff.index("anchor: {")
    stiff = stiff.replace(stiff[start : stiff.index("\n", start)], "anchor: {}")
    (folder / "stiff.yaml").write_text(stiff, encoding="utf-8")
    return {
        "coman": coman(),
        "no trunk": Robot.from_file(write_arms(folder / "arms"), MARGIN, "midpoint"),
        "unequal arms": Robot.from_file(write_arms(folder / "un", unequal), MARGIN, "midpoint"),
        "no arms": Robot.from_file(folder / "stiff.yaml", MARGIN, "midpoint"),
    }


ROBOT_NAMES = ("coman", "no trunk", "unequal arms", "no arms")


# --- laws of every sampler


@pytest.mark.parametrize("robot", ROBOT_NAMES)
@pytest.mark.parametrize("name", SAMPLERS)
def test_poses_lie_in_the_box_and_move_every_joint(robots, name, robot):
    made = robots[robot]
    lower, upper = box(made)
    q = rows(name, made, 2000)
    assert q.shape == (2000, made.n_dof) and np.isfinite(q).all()
    assert (q >= lower).all() and (q <= upper).all()
    assert (q.std(axis=0) > 0.02 * (upper - lower)).all()


@pytest.mark.parametrize("count", [1, 2, 777, 4097], ids=str)
@pytest.mark.parametrize("name", SAMPLERS)
def test_fewer_rows_are_the_first_of_more_rows(name, count):
    assert np.array_equal(rows(name, coman(), count), rows(name, coman(), 5000)[:count])


@pytest.mark.parametrize("name", SAMPLERS)
def test_the_same_shard_draws_the_same_rows(name):
    assert np.array_equal(rows(name, coman(), 300), rows(name, coman(), 300))


@pytest.mark.parametrize("name", SAMPLERS)
def test_another_seed_or_another_shard_draws_other_rows(name):
    one = rows(name, coman(), 300)
    for other in (
        rows(name, coman(), 300, shard=1, seed=8),
        rows(name, coman(), 300, shard=1, first=300),
    ):
        assert not (one[:, None] == other).all(axis=2).any()


@pytest.mark.parametrize("name", SAMPLERS)
def test_rows_do_not_depend_on_the_number_of_threads(monkeypatch, name):
    want = rows(name, coman(), 600)
    monkeypatch.setattr(batch, "workers", lambda: 3)
    monkeypatch.setattr(batch, "CHUNK", 64)
    assert np.array_equal(want, rows(name, coman(), 600))


@pytest.mark.parametrize("name", SAMPLERS)
def test_a_box_of_one_pose_gives_that_pose(name):
    made = coman()
    q = draw(name, made, made.anchor, made.anchor, 0, 5, stream(0), 0)
    np.testing.assert_allclose(q, np.tile(made.anchor, (5, 1)), rtol=0, atol=ALGEBRA)


# --- refusals


def test_an_unknown_sampler_is_refused_with_the_nearest_spelling():
    with pytest.raises(ParameterError) as refusal:
        rows("unifrom", coman(), 1)
    assert str(refusal.value) == (
        f"sampler must be one of {', '.join(SAMPLERS)}, got 'unifrom'; did you mean uniform?"
    )
    with pytest.raises(ParameterError, match=r"got 'xyz'$"):
        rows("xyz", coman(), 1)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"first": -1}, "first must be at least 0, got -1"),
        ({"count": 0}, "count must be at least 1, got 0"),
        ({"count": np.nan}, "count must be at least 1, got nan"),
        ({"seed": -1}, "seed must be at least 0, got -1"),
        ({"lower": np.zeros(3)}, r"a box of \(11,\) is wanted, got \(3,\) and \(11,\)"),
        ({"lower": np.full(11, np.nan)}, "joint WaistLat cannot be drawn from .nan, "),
        ({"upper": np.full(11, np.inf)}, "joint WaistLat cannot be drawn from .*inf"),
        ({"upper": np.full(11, -9.0)}, "joint WaistLat cannot be drawn from .*-9.0"),
    ],
    ids=["first", "count", "count nan", "seed", "shape", "nan", "inf", "empty"],
)
@pytest.mark.parametrize("name", SAMPLERS)
def test_what_cannot_be_drawn_from_is_refused(name, change, words):
    made = coman()
    lower, upper = box(made)
    asked = {"lower": lower, "upper": upper, "first": 0, "count": 1, "rng": stream(0), "seed": 0}
    with pytest.raises(ParameterError, match=words):
        draw(name, made, **asked | change)


# --- the groups of joints


def test_comans_joints_are_sorted_by_the_hands_they_move():
    found = limbs(coman())
    names = np.array(coman().joint_names)
    assert list(names[found.trunk]) == ["WaistLat", "WaistSag", "WaistYaw"]
    assert list(names[found.right]) == ["RShSag", "RShLat", "RShYaw", "RElbj"]
    assert list(names[found.left]) == ["LShSag", "LShLat", "LShYaw", "LElbj"]


@pytest.mark.parametrize("robot", ROBOT_NAMES)
def test_every_joint_is_in_exactly_one_group(robots, robot):
    assert (np.sum(limbs(robots[robot]), axis=0) == 1).all()


def test_mirrored_arms_make_mirrored_skeletons():
    made = coman()
    limb = limbs(made)
    signs = mirror_signs(made, limb)
    q = rows("uniform", made, 100)
    q[:, limb.trunk] = 0.0
    image = q.copy()
    image[:, limb.left], image[:, limb.right] = q[:, limb.right] * signs, q[:, limb.left] * signs
    want = skeleton.mirror(batch.skeletons(made.chain, q))
    np.testing.assert_allclose(batch.skeletons(made.chain, image), want, rtol=0, atol=1e-6)


def test_planar_arms_mirror_with_every_sign_turned(robots):
    made = robots["no trunk"]
    assert np.array_equal(mirror_signs(made, limbs(made)), [-1.0, -1.0])


@pytest.mark.parametrize("robot", ["unequal arms", "no arms"])
def test_arms_that_are_no_mirror_images_have_no_signs(robots, robot):
    assert mirror_signs(robots[robot], limbs(robots[robot])) is None


# --- what each one promises


def test_uniform_is_the_generators_own_draw_to_the_bit():
    lower, upper = box(coman())
    assert np.array_equal(rows("uniform", coman(), 99), stream(0).uniform(lower, upper, (99, 11)))


def test_quasi_random_shards_make_one_sequence():
    whole = rows("quasi", coman(), 1000)
    parts = [rows("quasi", coman(), 250, shard=k, first=250 * k) for k in range(4)]
    assert np.array_equal(whole, np.concatenate(parts))


def test_quasi_random_rows_are_more_even_than_random_ones_however_far_along():
    lower, upper = box(coman())
    n = 1000
    for first in (0, 2_000_000_000):
        share = (rows("quasi", coman(), n, first=first) - lower) / (upper - lower)
        gap = np.abs(np.sort(share, axis=0) - (np.arange(n)[:, None] + 0.5) / n)
        assert gap.max() < 0.01  # random rows: about 0.03
        assert len(np.unique(share, axis=0)) == n


def test_quasi_random_steps_are_the_fractions_of_the_roots_of_primes():
    lower, upper = box(coman())
    share = (rows("quasi", coman(), 2) - lower) / (upper - lower)
    step = np.diff(share, axis=0)[0] % 1.0
    roots = np.sqrt([2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31])
    np.testing.assert_allclose(step, roots % 1.0, rtol=0, atol=1e-9)


def test_centred_shares_follow_beta_2_2():
    lower, upper = box(coman())
    share = (rows("centred", coman(), 20_000) - lower) / (upper - lower)
    np.testing.assert_allclose(share.mean(axis=0), 0.5, atol=5 * np.sqrt(0.05 / 20_000))
    np.testing.assert_allclose(share.var(axis=0), 0.05, rtol=0.05)
    below = (share < 0.25).mean(axis=0)
    np.testing.assert_allclose(below, 3 * 0.25**2 - 2 * 0.25**3, atol=0.015)


@pytest.mark.parametrize("name", ["rest", "human"])
def test_trunks_are_near_upright_and_spread_as_said(name):
    made = coman()
    trunk = rows(name, made, 20_000)[:, limbs(made).trunk]
    assert np.degrees(np.abs(np.median(trunk, axis=0))).max() < 2.0
    yaw = trunk[:, 2]  # its range is wide enough to cut nothing off
    assert np.degrees(yaw.std()) == pytest.approx(15.0, abs=0.5)
    assert (np.abs(np.degrees(trunk)) < 20.0).mean() == pytest.approx(0.84, abs=0.03)


def test_rest_leaves_the_arms_uniform():
    made = coman()
    limb = limbs(made)
    arms = limb.right | limb.left
    assert np.array_equal(rows("rest", made, 50)[:, arms], rows("uniform", made, 50)[:, arms])


def elbows(made, q):
    """Height of both upper arms' directions beside an upright trunk, (n, 2)."""
    q = q.copy()
    q[:, limbs(made).trunk] = made.anchor[limbs(made).trunk]
    bones = batch.skeletons(made.chain, q).reshape(len(q), 7, 3)
    return bones[:, [2, 5], 2]


def test_human_arms_hang_more_than_they_are_raised_and_both_alike():
    up = elbows(coman(), rows("human", coman(), 8000))
    plain = elbows(coman(), rows("uniform", coman(), 8000))
    assert (np.median(up, axis=0) < -0.5).all() and (np.median(plain, axis=0) > -0.3).all()
    assert ((up > 0.5).mean(axis=0) > 0.005).all()  # rare, not impossible
    assert np.abs(np.diff(up.mean(axis=0))) < 0.03


def test_a_share_of_human_poses_has_arms_that_mirror_each_other():
    made = coman()
    limb = limbs(made)
    signs = mirror_signs(made, limb)
    for name, share in (("human", samplers.ALIKE), ("centred", 0.0)):
        q = rows(name, made, 8000)
        apart = np.abs(q[:, limb.left] - q[:, limb.right] * signs).max(axis=1)
        near = (apart < 3 * samplers.UNLIKE).mean()
        assert near == pytest.approx(share, abs=0.08)  # some arms are alike by chance


def test_arms_drawn_by_themselves_are_clear_of_the_trunk_more_often_than_uniform_ones():
    made = coman()
    shares = []
    for name in ("arms", "uniform"):
        clipped = np.clip(rows(name, made, 2000), made.lower, made.upper)
        shares.append((batch.clearances(made.chain, clipped) >= made.margin).mean())
    assert shares[0] > shares[1] + 0.2


def test_an_arm_by_itself_is_measured_against_everything_but_the_other_arm(robots):
    made = robots["no trunk"]
    limb = limbs(made)
    alone = samplers._arm_alone(made, limb.right, limb.left)
    q = np.zeros((1, 4))
    q[0, limb.left] = [-1.5, 0.0]  # the left arm reaches through the body to the right one
    assert batch.clearances(made.chain, q)[0] < batch.clearances(alone, q)[0]
    moved = q.copy()
    moved[0, limb.left] = 1.0
    assert batch.clearances(alone, q) == batch.clearances(alone, moved)
