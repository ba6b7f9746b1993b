"""Which axis is up, and which hand the axes are of: in BVH and wherever joints have names."""

import bodies
import numpy as np
import pytest
from handmade import amc, asf, deepmimic, write

from s3le.errors import ClipError
from s3le.human.keypoints.how import How
from s3le.human.read import read_clip
from s3le.skeleton import face_forward, features

LAFAN = bodies.named("LAFAN1")
Z_UP = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # Blender's: forward is -y


def body(frames=12, metres=4.0):
    """Somebody who walks straight on with bent elbows and knees, feet on the floor."""
    made = bodies.body(frames)
    for hand, elbow in ((20, 18), (21, 19)):
        made[:, hand] = made[:, elbow] + 0.25 * np.array([1.0, 0.0, 0.0])
    for knee in (4, 5):
        made[:, knee, 0] += 0.12
    lift = made[:, [10, 11], 2].min(axis=1)
    made[:, :, 2] -= lift[:, None]
    made[:, :, 0] += np.linspace(-metres / 2, metres / 2, frames)[:, None]
    return made


BODY = body()
WANT = features(face_forward(bodies.points(BODY))[0])[0]
LYING = body(metres=0.0)[..., [2, 1, 0]] * (1.0, 1.0, -1.0)  # its trunk along x
LYING = LYING - LYING.mean(axis=(0, 1)) + (0.0, 0.0, 0.3)


def into(joints, axes):
    return joints @ (Z_UP if axes == "z-up" else bodies.INTO[axes]).T


def bvh(tmp_path, joints, rest, name="a.bvh"):
    return write(tmp_path / name, bodies.bvh_of(joints, LAFAN, rest))


def check(clip, want=WANT):
    assert np.allclose(features(face_forward(clip.points)[0])[0], want, rtol=0, atol=1e-6)


@pytest.mark.parametrize("rest", ["none", "agrees"])
@pytest.mark.parametrize("axes", ["y-up", "z-up"])
def test_up_is_where_rest_pose_and_motion_agree_or_only_the_motion_tells(tmp_path, axes, rest):
    path = bvh(tmp_path, into(BODY, axes), rest if rest == "none" else axes[0])
    clip = read_clip(path)
    check(clip)
    told = clip.reading.told if clip.reading else ()
    by = "where trunks point" if rest == "none" else "its rest pose"
    assert told == ((f"axes {axes}, by {by}",) if (axes, rest) != ("y-up", "agrees") else ())
    check(read_clip(path, how=How(axes=axes)))


@pytest.mark.parametrize(("axes", "rest"), [("y-up", "z"), ("z-up", "y")])
def test_a_motion_that_disagrees_with_its_rest_pose_is_asked_for(tmp_path, axes, rest):
    path = bvh(tmp_path, into(BODY, axes), rest)
    with pytest.raises(ClipError, match=f"rest pose is {rest}-up and trunks in the motion point"):
        read_clip(path)
    clip = read_clip(path, how=How(axes=axes))
    check(clip)
    assert clip.reading.how == How(axes=axes)


@pytest.mark.parametrize("axes", ["y-up", "z-up"])
@pytest.mark.parametrize("turn", range(8))
@pytest.mark.parametrize("floor", [0.0, -0.9, 2.0])
def test_a_man_who_lies_through_a_whole_clip_is_never_upright(tmp_path, axes, turn, floor):
    angle = np.radians(45.0 * turn)
    c, s = np.cos(angle), np.sin(angle)
    lying = LYING @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T
    path = bvh(tmp_path, into(lying + (0.0, 0.0, floor), axes), "none")
    try:
        clip = read_clip(path)
    except ClipError as refused:
        assert "--axes y-up or --axes z-up" in str(refused)
        clip = read_clip(path, how=How(axes=axes))
    trunk = features(face_forward(clip.points)[0])[0][:, 2]
    assert np.abs(trunk).max() < 0.5  # lies, so that all of its frames are left out as tilted


def test_who_falls_half_way_is_read_by_the_floor(tmp_path):
    lying = LYING[:8] + np.linspace(0, 3, 8)[:, None, None] * (1.0, 1.0, 0.0)
    joints = into(np.concatenate([BODY[:4], lying]), "z-up")
    clip = read_clip(bvh(tmp_path, joints, "none"))
    assert clip.reading.told == ("axes z-up, by the floor",)
    check(clip._replace(points=clip.points[:4]), WANT[:4])


@pytest.mark.parametrize("axes", ["z-up", "y-up-left", "z-up-left", "camera"])
def test_axes_may_be_stated_of_every_format(tmp_path, axes):
    write(tmp_path / "1.asf", asf())
    pose = {"lhumerus": "10 20 30", "thorax": "10 0 0"}
    doors = {"1_1.amc": amc(pose), "a.txt": deepmimic({8: [0.9, 0.1, 0.3, 0.2]})}
    for name, text in doors.items():
        path = write(tmp_path / name, text)
        clip, other = read_clip(path), read_clip(path, how=How(axes=axes))
        file = clip.points @ bodies.INTO["y-up"].T
        if axes == "camera":
            want = np.stack([-file[..., 2], file[..., 0], -file[..., 1]], axis=-1)
        elif axes == "z-up":
            want = file
        elif axes == "y-up-left":
            want = np.stack([file[..., 2], -file[..., 0], file[..., 1]], axis=-1)
        else:
            want = file * (1, -1, 1)
        assert np.allclose(other.points, want) and other.reading.how == How(axes=axes)
        assert np.array_equal(read_clip(path, how=How(axes="y-up")).points, clip.points)


# --- hands

SIDES = [("y-up", (1, 1, -1), "y-up-left"), ("z-up", (1, -1, 1), "z-up-left")]
PARTS = {  # joints that are left, and what they say
    "toes": ((4, 5, 7, 8, 10, 11), "the face or the toes point backwards"),
    "knees": ((4, 5, 7, 8), "knees bend backwards"),
    "elbows": ((), "elbows bend backwards"),
}


@pytest.mark.parametrize(("axes", "mirror", "stated"), SIDES)
@pytest.mark.parametrize("part", PARTS)
def test_left_handed_axes_are_refused_or_stated_in_every_door(tmp_path, axes, mirror, stated, part):
    keep, why = PARTS[part]
    names = [n if i < 4 or i in keep or i > 11 else f"x{i}" for i, n in enumerate(LAFAN)]
    joints = into(BODY, axes)
    if axes == "z-up":  # as Unreal has it, x forward
        joints = BODY
    given = {"a.bvh": axes[0], "b.bvh": "none", "a.npz": ""}
    for name, rest in given.items():
        for good in (True, False):
            own = joints if good else joints * mirror
            path = tmp_path / name
            if rest:
                write(path, bodies.bvh_of(own, names, rest))
            else:
                np.savez(path, joints=own, joint_names=names, fps=30.0)
            if good:
                check(read_clip(path))
                continue
            with pytest.raises(ClipError, match=f"in 100% of the frames {why}") as error:
                read_clip(path)
            assert stated in str(error.value)
            check(read_clip(path, how=How(axes=stated)))


def test_exchanged_sides_are_refused_and_righted_by_names(tmp_path):
    names = [n.replace("Left", "?").replace("Right", "Left").replace("?", "Right") for n in LAFAN]
    path = write(tmp_path / "a.bvh", bodies.bvh_of(into(BODY, "y-up"), names, "y"))
    with pytest.raises(ClipError, match="left and right are exchanged"):
        read_clip(path)
    from s3le.human.rigs import match

    found = match(names)
    turned = {"l": "r", "r": "l"}
    points = {k: v[0] for k, v in found.joints.items()} | found.more
    given = {turned[k[0]] + k[1:]: names[j] for k, j in points.items() if k[1] == "_"}
    check(read_clip(path, how=How(names=given)))


def test_one_arm_in_a_frame_or_few_frames_of_many_are_no_proof(tmp_path):
    made = np.repeat(BODY[:1], 200, axis=0)
    made[:, 20:22] = made[:, 18:20] + 0.25 * np.array([0.0, 0.0, -1.0])  # straight down
    made[:9, 20:22] = made[:9, 18:20] - 0.25 * np.array([1.0, 0.0, 0.0])  # and 9 of 200 behind
    names = [n if i < 4 or i > 11 else f"x{i}" for i, n in enumerate(LAFAN)]
    path = write(tmp_path / "a.bvh", bodies.bvh_of(into(made, "y-up"), names, "y"))
    assert len(read_clip(path).points) == 200
    write(path, bodies.bvh_of(into(made[:40], "y-up"), names, "y"))
    with pytest.raises(ClipError, match="elbows bend backwards"):
        read_clip(path)


# --- clocks


@pytest.mark.parametrize(
    ("name", "step", "fps"),
    [
        ("60_10_salsa", ".0083333", 60.0), ("60_10", "0.008333", 60.0), ("79_51", ".0083333", 60.0),
        ("136_19_walk", ".0083333", 60.0), ("136_18", ".0083333", 120.0),
        ("05_02", ".0083333", 120.0), ("60_10_salsa", "0.0166667", 60.0),
        ("60_10_salsa", "0.0333333", 30.0), ("salsa_60_10", ".0083333", 120.0),
        ("60_10b", ".0083333", 120.0),
    ],
)  # fmt: skip
def test_cmus_trials_of_60_hz_are_known_by_name_in_bvh_and_said(tmp_path, name, step, fps):
    text = bodies.bvh_of(into(BODY, "y-up"), LAFAN, "y")
    text = text.replace("Frame Time: 0.0333333", f"Frame Time: {step}")
    path = write(tmp_path / f"{name}.bvh", text)
    clip = read_clip(path)
    assert clip.fps == fps
    said = any(words.startswith("60 Hz: CMU recorded this trial so") for words in (
        clip.reading.told if clip.reading else ()))  # fmt: skip
    assert said == (fps == 60.0 and "008333" in step)
    assert read_clip(path, fps=120).fps == 120.0
