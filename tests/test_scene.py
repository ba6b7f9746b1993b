"""Motions as they are seen: at any moment, by kind, from the joints' frames, through the rays."""

from dataclasses import replace

import bodies
import numpy as np
import pytest
from handmade import bvh, write
from hypothesis import given
from hypothesis import strategies as st
from worlds import ARMS_URDF, coman, relaxed, write_arms

from s3le.errors import ClipError, ParameterError, RobotError, TrajectoryError
from s3le.human.keypoints.how import How
from s3le.human.origin import about_clip
from s3le.human.skeletons import read_frames
from s3le.kernels import batch
from s3le.motion import files, trajectory
from s3le.robot import model
from s3le.robot.posing import Nearness, Poser
from s3le.show import human, motions, pace, visual
from s3le.show.viewer.player import Player


def wave(folder, frames=30, by=3.0):
    rows = [[0, 0, 0, 0, 0, 0, -by * k, 0, 0, 0, 0, 0] for k in range(frames)]
    return write(folder / "clips" / "wave.bvh", bvh(rows, order="ZXY", step=f"{1 / 30:.9f}"))


def moving(folder, rows=30, name="walk", about=None, modes=True):
    robot = coman()
    q = np.repeat(robot.anchor[None], rows, 0)
    q[:, 3] += 0.3 * np.sin(np.arange(rows) / 10)
    mode = np.full(rows, "refined", "U8")
    mode[5:9], mode[12:14] = "held", "planned"
    time = np.arange(rows) / 30
    made = trajectory.make(
        name, robot.joint_names, time, q, mode=mode if modes else None, about=about
    )
    files.write(made, folder / f"{name}.parquet")
    return motions.read(folder / f"{name}.parquet", coman())


# --- moments


def test_a_row_is_shown_as_it_is_and_between_two_the_joints_move_straight(tmp_path):
    shown = moving(tmp_path)
    time, q = shown.trajectory.time, shown.trajectory.q
    np.testing.assert_array_equal(motions.poses(shown, time), q)
    half = motions.poses(shown, (time[1:] + time[:-1]) / 2)
    np.testing.assert_allclose(half, (q[1:] + q[:-1]) / 2, atol=1e-15)
    np.testing.assert_array_equal(motions.poses(shown, [-1.0, 99.0]), q[[0, -1]])
    # Between two rows it is on its way to the second, and so that one's mode is what is told.
    words = motions.modes(shown, np.array([4 / 30, 4.5 / 30, 5 / 30, 8.5 / 30, 99.0]))
    assert words.tolist() == ["refined", "held", "held", "refined", "refined"]


def test_moments_are_the_rows_or_a_rate_and_never_nothing(tmp_path):
    shown = [moving(tmp_path)]
    time = shown[0].trajectory.time
    np.testing.assert_array_equal(motions.moments(shown, 60.0), time)
    assert len(motions.moments(shown, 60.0, exact=True)) == 59
    np.testing.assert_allclose(np.diff(motions.moments(shown, 10.0)), 0.1)
    part = motions.moments(shown, 60.0, 0.25, 0.5)
    assert part[0] == 0.25 and part[-1] <= 0.5
    for begin, end in ((5.0, None), (0.5, 0.25), (None, -1.0), (float("nan"), None)):
        with pytest.raises(TrajectoryError, match="nothing to show"):
            motions.moments(shown, 60.0, begin, end)
    with pytest.raises(TrajectoryError, match="--from and --to"):
        motions.moments(shown, 1e6)


def test_labels_differ_however_alike_the_names_are(tmp_path):
    for folder in "ab":
        (tmp_path / folder).mkdir()
    shown = [moving(tmp_path / folder) for folder in "ab"]
    assert [s.label for s in motions.named(shown)] == ["a/walk", "b/walk"]
    assert [s.label for s in motions.named([shown[0]] * 2)] == ["walk (1)", "walk (2)"]
    assert [s.label for s in motions.named(shown[:1])] == ["walk"]


# --- the human


def test_a_motion_finds_its_human_also_after_both_have_moved(tmp_path):
    clip = wave(tmp_path / "one")
    about = about_clip(clip, tmp_path / "one") | {"clip_time_offset_s": 0.5}
    shown = moving(tmp_path / "one", about=about)
    assert motions.recorded_clip(shown)[0].samefile(clip) and not motions.recorded_clip(shown)[1]
    (tmp_path / "one").rename(tmp_path / "two")
    shown = motions.read(tmp_path / "two" / "walk.parquet", coman())
    clip = motions.recorded_clip(shown)[0]
    seen = motions.human(clip, shown)
    assert seen.label == "wave" and seen.time[0] == 0.5
    np.testing.assert_array_equal(motions.skeletons(seen, [0.0, 0.5, 0.51]), seen.x[[0, 0, 0]])
    np.testing.assert_array_equal(motions.skeletons(seen, [0.5 + 2 / 30, 99]), seen.x[[2, -1]])
    clip.write_bytes(clip.read_bytes() + b"\n")
    assert "has changed since" in motions.recorded_clip(shown)[1]
    clip.unlink()
    path, words = motions.recorded_clip(shown)
    assert path is None and "No such file" in words and "--human" in words


def test_a_human_of_keypoints_is_read_as_it_was_for_the_motion(tmp_path):
    people = np.stack([bodies.body(9), bodies.body(9)[::-1]], axis=1)
    clip = tmp_path / "two.npz"
    np.savez(clip, joints=people, fps=30.0)
    first, second = (read_frames(clip, "midpoint", how=How(person=i)) for i in (0, 1))
    about = about_clip(clip, tmp_path) | second.reading.how.about()
    shown = moving(tmp_path, about=about)
    np.testing.assert_array_equal(motions.human(clip, shown).x, second.x)
    np.testing.assert_array_equal(motions.human(clip, shown, How(person=0)).x, first.x)
    other = tmp_path / "other.npz"  # what is known of one clip says nothing of another
    np.savez(other, joints=people)
    with pytest.raises(ClipError, match="holds 2 persons"):
        motions.human(other, shown)


@pytest.mark.parametrize("name", [None, 7, "\0", "x" * 9999])
def test_a_motion_without_a_usable_clip_says_so(tmp_path, name):
    shown = moving(tmp_path, about={motions.CLIP: name})
    path, words = motions.recorded_clip(shown)
    assert path is None and "--human" in words


def test_a_clip_of_another_time_is_refused(tmp_path):
    shown = moving(tmp_path, about={"clip_time_offset_s": 50.0})
    with pytest.raises(ClipError, match="lasts from 50.00"):
        motions.human(wave(tmp_path), shown)


def test_a_human_has_the_directions_it_was_given_and_the_lengths_of_whom_it_is_laid_over():
    x = batch.skeletons(coman().chain, relaxed(coman(), 5, 1))
    size = human.Size(0.3, 0.1, 0.2, 0.15)
    made = human.stick_figures(x, size, slim=0.5)
    assert made.ends.shape == (5, len(made.radius), 2, 3)
    trunk = made.ends[:, made.colours.index(human.MIDDLE)]
    np.testing.assert_allclose(trunk[:, 1] - trunk[:, 0], 0.3 * x[:, :3], atol=1e-12)
    one = human.stick_figures(x[3:4])
    np.testing.assert_allclose(human.stick_figures(x).ends[3], one.ends[0], atol=1e-15)
    with pytest.raises(ParameterError, match=r"\(n, 21\)"):
        human.stick_figures(x[:, :20])


# --- kinds


def test_kinds_are_told_from_modes_or_from_what_the_robot_does(tmp_path):
    shown = moving(tmp_path)
    kind = pace.kinds(shown, shown.trajectory.time)
    assert pace.spans(kind) == [(5, 9, pace.HELD), (12, 14, pace.SLOWED)]
    mode = np.array(shown.trajectory.mode)
    mode[3:8] = mode[29] = trajectory.BETWEEN  # on the way to row 8, which is held; to nowhere
    dense = replace(shown.trajectory, mode=mode)
    kind = pace.kinds(shown._replace(trajectory=dense), dense.time)
    assert pace.spans(kind) == [(3, 9, pace.HELD), (12, 14, pace.SLOWED)]
    robot = coman()
    q = np.repeat(robot.anchor[None], 6, 0)
    q[3:, 0] += 0.01
    files.write(trajectory.make("m", robot.joint_names, np.arange(6.0), q), tmp_path / "m.csv")
    other = motions.read(tmp_path / "m.csv", coman())
    still = pace.spans(pace.kinds(other, np.arange(6.0)))
    assert still == [(1, 3, pace.STILL), (4, 6, pace.STILL)]


@given(st.lists(st.integers(0, len(pace.KINDS) - 1), min_size=1, max_size=40))
def test_spans_cover_exactly_the_moments_that_are_not_plain(kind):
    marked = [pace.PLAIN] * len(kind)
    for first, end, what in pace.spans(np.array(kind)):
        marked[first:end] = [what] * (end - first)
    assert marked == [pace.KINDS[k] for k in kind]


# --- the robot


def test_frames_of_the_joints_carry_the_bodies_where_the_kernels_have_them():
    made = coman()
    q = relaxed(made, 3, 2)
    for pose, ends in zip(q, batch.capsule_ends(made.chain, q), strict=True):
        at = Poser(made).place(pose)
        for body, (a, _) in zip(made.bodies, ends, strict=True):
            w, v = at.wxyz[body.joint + 1][0], at.wxyz[body.joint + 1][1:]
            turned = body.a + 2 * np.cross(v, np.cross(v, body.a) + w * body.a)
            np.testing.assert_allclose(turned + at.position[body.joint + 1], a, atol=1e-12)


def test_the_closest_points_lie_on_the_two_bodies_as_far_apart_as_is_said():
    made = coman()
    plain = np.isnan(made.baselines)  # of bodies that overlap by design, thinner ones are measured
    near = Nearness(made, made.watched, made.slack())
    for pose in relaxed(made, 20, 3):
        found = near.closest(pose)
        report = made.certifier().check(pose[None])
        assert (found.clearance, found.pair) == (report.clearance[0], report.pair[0])
        assert np.linalg.norm(np.subtract(*found.points)) == pytest.approx(
            abs(found.clearance), abs=1e-6
        )
        if not plain[found.pair]:
            continue
        ends = batch.capsule_ends(made.chain, pose[None])[0]
        for body, point in zip(made.watched[found.pair], found.points, strict=True):
            a, along = ends[body, 0], ends[body, 1] - ends[body, 0]
            t = np.clip((point - a) @ along / max(along @ along, 1e-18), 0.0, 1.0)
            away = np.linalg.norm(point - a - t * along)
            assert away == pytest.approx(made.bodies[body].radius, abs=1e-6)


VISUAL = """<visual><origin xyz="0 0 0.1" rpy="0 0 1.5707963267948966"/><geometry>
<mesh filename="{name}" scale="2 2 2"/></geometry>
<material name="red"><color rgba="1 0 0 1"/></material></visual>"""
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.mark.parametrize("name", ["tri.obj", "package://looks/tri.obj"])
def test_a_mesh_is_where_its_link_and_origin_put_it(tmp_path, name):
    urdf = ARMS_URDF.replace('<link name="l_lower">', f'<link name="l_lower">{VISUAL}')
    assert "<visual>" in urdf
    path = write_arms(tmp_path / "looks", urdf=urdf.replace("{name}", name))
    (tmp_path / "looks" / "tri.obj").write_text(OBJ)
    robot = model.load(path)
    (seen,) = visual.visuals(robot)
    assert robot.joint_names[seen.joint] == "l_elbow" and seen.colour == (1.0, 0.0, 0.0)
    np.testing.assert_array_equal(seen.faces, [[0, 1, 2]])
    wanted = [[0, 0, 0.1], [0, 2, 0.1], [-2, 0, 0.1]]
    np.testing.assert_allclose(seen.vertices, wanted, atol=1e-12)


@pytest.mark.parametrize("content", [None, "no mesh\n", ""])
def test_a_mesh_that_is_not_there_or_none_is_named(tmp_path, content):
    urdf = ARMS_URDF.replace('<link name="l_lower">', f'<link name="l_lower">{VISUAL}')
    path = write_arms(tmp_path, urdf=urdf.replace("{name}", "tri.obj"))
    if content is not None:
        (tmp_path / "tri.obj").write_text(content)
    with pytest.raises(RobotError, match="tri.obj"):
        visual.visuals(model.load(path))


def test_meshes_may_come_from_the_urdf_that_a_robot_was_made_of(tmp_path):
    robot = model.load(write_arms(tmp_path / "made"))
    urdf = ARMS_URDF.replace('<link name="l_lower">', f'<link name="l_lower">{VISUAL}')
    (tmp_path / "original.urdf").write_text(urdf.replace("{name}", "tri.obj"))
    (tmp_path / "tri.obj").write_text(OBJ)
    (seen,) = visual.visuals(robot, tmp_path / "original.urdf")
    assert visual.visuals(robot) == [] and seen.link == "l_lower"
    other = urdf.replace("l_lower", "elsewhere")
    (tmp_path / "other.urdf").write_text(other.replace("{name}", "tri.obj"))
    with pytest.raises(RobotError, match="other.urdf: no mesh of a link that .*arms.yaml has"):
        visual.visuals(robot, tmp_path / "other.urdf")


def test_coman_has_no_meshes():
    assert visual.visuals(coman()) == []


# --- playing


@given(
    st.lists(st.floats(0.001, 2.0), min_size=1, max_size=20),
    st.lists(
        st.one_of(
            st.tuples(st.just("advance"), st.floats(0.0, 50.0)),
            st.tuples(st.just("seek"), st.floats(-10.0, 50.0)),
            st.tuples(st.just("step"), st.integers(-30, 30)),
            st.tuples(st.just("set_loop"), st.booleans()),
            st.tuples(st.just("set_speed"), st.sampled_from([0.125, 1.0, 4.0])),
            st.tuples(st.just("toggle"), st.none()),
        ),
        max_size=20,
    ),
)
def test_a_playback_never_leaves_its_moments(steps, actions):
    player = Player(np.cumsum(steps))
    for name, value in actions:
        getattr(player, name)(*([] if value is None else [value]))
        assert 0 <= player.index < len(steps)


def test_a_playback_keeps_time_loops_and_stops():
    player = Player(np.arange(11) / 10)
    player.advance(0.5)
    assert player.index == 0  # it does not play yet
    assert player.toggle()
    player.advance(0.25)
    assert player.index == 2
    player.set_speed(0.5)
    player.advance(0.5)
    assert player.index == 5
    player.set_speed(1.0)
    player.advance(0.75)
    assert player.index == 2 and player.playing  # once round
    player.set_loop(False)
    player.advance(9.0)
    assert player.index == 10 and not player.playing
    assert player.toggle() and player.index == 0
    player.seek(0.62)
    assert player.index == 6
    player.step(-2)
    assert player.index == 4 and not player.playing
