"""Links that never meet: the proof, and robots that need it; how far bodies hold a robot back."""

import sys
from types import SimpleNamespace

import coal
import numpy as np
import pinocchio as pin
import pytest
from dag import ROOT
from figures import BOX, drawn, figure, write
from onboarded import new
from worlds import MARGIN

from s3le.kernels import batch
from s3le.onboard import anchor, apart, motion, reading, splitting
from s3le.robot.robot import Robot
from s3le.skeleton import cosine_distance

SHOULDER = frozenset(("left_sp", "left_upper"))


def square(_radius, _length) -> str:
    return '<box size="0.08 0.08 0.16"/>'  # the upper arm: from 60 mm below the shoulder on


def socketed(side: float) -> str:
    """The figure with a cube in each shoulder, on the joint before the last two."""
    text = figure(body=square)
    for name in ("left_sp", "right_sp"):
        cube = f'<collision><geometry><box size="{side} {side} {side}"/></geometry></collision>'
        text = text.replace(f'<link name="{name}">', f'<link name="{name}">{cube}')
    return text


@pytest.fixture(scope="module")
def plain(tmp_path_factory) -> Robot:
    return new(tmp_path_factory.mktemp("plain"), figure()).robot


def solid(robot: Robot, joint: str, centre, half) -> apart.Solid:
    corners = BOX * half + centre
    return apart.Solid(robot.joint_names.index(joint), corners, motion.convex(corners))


def gaps(robot: Robot, one: apart.Solid, other: apart.Solid, q: np.ndarray) -> np.ndarray:
    """Distances of two solids at poses q [m], by pinocchio's kinematics."""
    model, _ = robot.reduced()
    data, found = model.createData(), []
    for pose in q:
        pin.forwardKinematics(model, data, pose)
        a, b = (data.oMi[s.joint + 1] for s in (one, other))
        at = [coal.Transform3s(place.rotation, place.translation) for place in (a, b)]
        found.append(coal.distance(one.shape, at[0], other.shape, at[1],
                                   coal.DistanceRequest(), coal.DistanceResult()))  # fmt: skip
    return np.array(found)


# --- the proof


@pytest.mark.parametrize(
    ("a", "b"),
    [(("waist_pitch", (0.0, 0.0, 0.15), (0.05, 0.06, 0.1)),
      ("left_shoulder_roll", (0.0, 0.02, -0.1), (0.02, 0.01, 0.03))),
     (("left_shoulder_pitch", (0.0, 0.0, 0.0), (0.02, 0.02, 0.02)),
      ("left_shoulder_yaw", (0.01, 0.0, -0.1), (0.03, 0.02, 0.04)))],
)  # fmt: skip
def test_it_holds_below_the_least_distance_and_not_above(plain, a, b):
    one, other = solid(plain, *a), solid(plain, *b)
    rng = np.random.default_rng(0)
    q = rng.uniform(plain.lower, plain.upper, (6000, plain.n_dof))
    q[::2] = np.where(rng.random(q[::2].shape) < 0.3, plain.lower, q[::2])
    q[::3] = np.where(rng.random(q[::3].shape) < 0.3, plain.upper, q[::3])
    least = float(gaps(plain, one, other, q).min())
    assert least > 0.005
    assert apart.never_nearer(plain, [one], [other], least - 0.004)
    assert apart.never_nearer(plain, [other], [one], least - 0.004)
    assert not apart.never_nearer(plain, [one], [other], least + 1e-5)
    # Of several solids the nearest decides.
    away = solid(plain, a[0], np.add(a[1], (0.0, 0.0, 0.01)), np.multiply(a[2], 0.5))
    assert not apart.never_nearer(plain, [away, one], [other], least + 1e-5)


def test_too_many_joints_and_too_few_boxes_say_nothing(plain, monkeypatch):
    pelvis = apart.Solid(-1, BOX * 0.01, motion.convex(BOX * 0.01))
    hand = solid(plain, "left_elbow", (0.0, 0.0, -0.1), (0.01, 0.01, 0.01))
    assert not apart.never_nearer(plain, [pelvis], [hand], -1.0)
    near = solid(plain, "left_shoulder_pitch", (0.0, 0.0, 0.0), (0.02, 0.02, 0.02))
    bar = solid(plain, "left_shoulder_yaw", (0.01, 0.0, -0.1), (0.03, 0.02, 0.04))
    assert apart.never_nearer(plain, [near], [bar], 0.001)
    monkeypatch.setattr(apart, "BOXES", 3)
    assert not apart.never_nearer(plain, [near], [bar], 0.001)


def test_what_is_drawn_counts_and_what_is_no_hull_is_left_out(tmp_path):
    text = drawn(figure(), "waist_pitch_link", '<box size="0.3 0.2 0.2"/>', "0 0 0.15")
    made = new(tmp_path, text)
    source = reading.read(write(tmp_path / "again", text), [])
    found = apart.solids(made.robot, source)
    assert "head" not in found and "left_upper" not in found  # a sphere, a capsule
    reach = [np.abs(one.corners).max(axis=0)[0] for one in found["waist_pitch_link"]]
    assert sorted(reach) == pytest.approx([0.07, 0.15])


# --- robots whose bodies overlap though nothing meets


def test_links_that_never_meet_are_taken_off_with_the_reason(tmp_path):
    made = new(tmp_path, socketed(0.06), finer=True, with_hulls=True)  # 8 mm at the nearest
    assert "never within 0.5 mm" in made.robot.disabled[SHOULDER]
    assert any("left_sp and left_upper" in line for line in made.proposal.sure)
    assert any(set(pair[:2]) == {"left_sp_0", "left_upper_0"} for pair in made.robot.unwatched())


def test_a_joint_that_is_held_between_leaves_them_watched(tmp_path, monkeypatch):
    source = reading.read(write(tmp_path, socketed(0.06)), [])
    assert apart.between(source, "left_sp", "left_upper") == {
        "left_shoulder_roll", "left_shoulder_yaw"
    }  # fmt: skip
    assert "left_hip_pitch" in apart.between(source, "left_hip_pitch_link", "left_upper")
    monkeypatch.setattr(apart, "between", lambda *links: {"left_hip_pitch"})  # held, may be given
    made = new(tmp_path, socketed(0.06), finer=True)
    assert "never within" not in made.robot.disabled.get(SHOULDER, "")


def test_links_that_can_meet_are_not(tmp_path):
    made = new(tmp_path, socketed(0.09), finer=True)  # its corners reach 78 mm
    assert "never within" not in made.robot.disabled.get(SHOULDER, "")


# --- pieces


def test_a_grid_of_cells_holds_the_piece_with_fewer_capsules_than_cells():
    points = BOX * [0.06, 0.09, 0.12]
    splitter = splitting.Splitter(points)
    inside = np.random.default_rng(2).uniform(-1, 1, (4000, 3)) * [0.06, 0.09, 0.12]
    found = splitter.grids(16)
    assert found and max(map(len, found)) <= 16
    for parts in found:
        far = np.full(len(inside), np.inf)
        for part in parts:
            a, b, radius = part.capsule
            t = np.clip((inside - a) @ (b - a) / max((b - a) @ (b - a), 1e-300), 0, 1)
            near = np.linalg.norm(inside - a - t[:, None] * (b - a), axis=1)
            far = np.minimum(far, near - radius)
        assert far.max() <= 1e-9
    far = [splitter.furthest([part.capsule for part in parts]) for parts in found]
    limit = float(np.median(far))
    kept = splitter.grids(16, limit)
    assert 0 < len(kept) < len(found)
    assert max(splitter.furthest([p.capsule for p in parts]) for parts in kept) <= limit
    small = splitting.Part(BOX * 0.01, splitting.around(BOX * 0.01, np.zeros(3), np.zeros(3)))
    large = splitting.Part(BOX * 0.05, splitting.around(BOX * 0.05, np.zeros(3), np.zeros(3)))
    (left,) = splitting.pruned([small, large])
    assert left.capsule is large.capsule and len(left.points) == 16


def test_a_face_from_which_others_come_is_held_flatter():
    points = BOX * [0.05, 0.05, 0.05]
    face = np.array([[0.0, 0.02, 1.0]]) / np.hypot(0.02, 1.0)
    out = []
    for count in (0.0, 400.0):
        splitter = splitting.Splitter(points)
        ways = np.concatenate([splitting.WAYS, face])
        weights = np.concatenate([np.ones(len(splitting.WAYS)), [count]])
        splitter.look(ways, weights / weights.mean())
        a, b, radius = splitter.whole().capsule
        out.append(float(max((face @ a)[0], (face @ b)[0]) + radius))
    assert out[1] < out[0] - 0.002


def test_a_named_anchor_serves_with_less_room_than_an_odd_one(plain, monkeypatch):
    def judged(robot, q, how):
        return anchor.Found(q, how, 0.008 if how == "T-pose" else 0.012, 5)

    monkeypatch.setattr(anchor, "_judged", judged)
    listed = [("T-pose", plain.anchor), ("search", plain.anchor)]
    monkeypatch.setattr(anchor, "candidates", lambda robot, neck: iter(listed))
    found = anchor.search(plain, "midpoint")
    assert found is not None and found.how == "T-pose"


# --- how far bodies hold a robot back


@pytest.fixture(scope="module")
def rooms():
    """The modules of benchmarks/robots."""
    names = ("solids", "share", "stands", "sources")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "benchmarks/robots"))
        yield SimpleNamespace(**{name: __import__(name) for name in names})
    for name in names:
        sys.modules.pop(name, None)


def test_a_robot_of_capsules_loses_nothing_and_one_in_a_fat_torso_does(
    tmp_path, rooms, monkeypatch
):
    monkeypatch.setattr(rooms.share, "FARTHER", 1e-4)
    round_, fat = '<capsule radius="0.08" length="0.1"/>', '<box size="0.3 0.24 0.3"/>'
    pelvis = '<box size="0.14 0.2 0.12"/>', '<capsule radius="0.07" length="0.06"/>'
    texts = [figure(torso=round_, legs=False).replace(*pelvis), figure(torso=fat)]
    lost = []
    for k, text in enumerate(texts):
        made = new(tmp_path / str(k), text, most=1)
        robot = made.robot
        solids = rooms.solids.Solids(robot, write(tmp_path / str(k), text))
        q = robot.stand + np.random.default_rng(0).normal(0.0, 0.05, (40, robot.n_dof))
        x = batch.skeletons(robot.chain, np.clip(q, robot.lower, robot.upper))
        found = rooms.share.measured(robot, solids, x)
        assert (found.bodies >= found.hulls).all() and (found.hulls >= found.free - 1e-6).all()
        for row in np.flatnonzero(found.lost > rooms.share.FARTHER):
            assert solids.clear(found.with_hulls[row]) >= MARGIN
        away = cosine_distance(batch.skeletons(robot.chain, found.with_hulls), x, robot.followed)
        assert found.hulls == pytest.approx(away, abs=1e-9)
        lost.append(float((found.lost > rooms.share.FARTHER).mean()))
        named = rooms.share.blamed(robot, found)
        assert (lost[-1] == 0.0) == (not named)
    assert lost[0] == 0.0 and lost[1] > 0.1  # though it has finer bodies where arms hang


def test_gradients_are_those_of_the_distances(tmp_path, rooms):
    text = figure(torso='<box size="0.2 0.2 0.3"/>', body=square)
    made = new(tmp_path, text)
    solids = rooms.solids.Solids(made.robot, write(tmp_path, text))
    rng, checked = np.random.default_rng(1), []
    for q in rng.uniform(made.robot.lower, made.robot.upper, (12, made.robot.n_dof)):
        rows, apart_by, slope = solids.gradients(q)
        for j in range(len(q)):
            ends = []
            for step in (-1e-6, 1e-6):
                moved = q.copy()
                moved[j] += step
                ends.append(dict(zip(*solids.measure(moved), strict=True)))
            for i, row in enumerate(rows):
                if apart_by[i] > MARGIN and row in ends[0] and row in ends[1]:
                    checked.append(abs((ends[1][row] - ends[0][row]) / 2e-6 - slope[i, j]))
    assert len(checked) > 100 and np.quantile(checked, 0.95) < 1e-4
