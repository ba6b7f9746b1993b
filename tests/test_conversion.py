"""From a clip to a motion that is written: in time, in gaps, at any rate, and only if it holds."""

import json

import numpy as np
import pytest
from follower import Plain, Reckless
from handmade import amc, asf, bvh, deepmimic, write
from worlds import coman

from s3le.errors import CertificateError, ClipError, ParameterError
from s3le.human.keypoints.how import How
from s3le.human.skeletons import read_frames, skeletons
from s3le.motion import files
from s3le.retarget import clip
from s3le.retarget.follow import approach
from s3le.safety import audit
from s3le.skeleton import features


@pytest.fixture(scope="module")
def wave(tmp_path_factory):
    """A second and a half of a figure that lowers its arms, as BVH at 30 Hz."""
    return write(tmp_path_factory.mktemp("wave") / "wave.bvh", waving())


def waving(frames=45, broken=()):
    angles = 70 * np.sin(np.linspace(0, 1.4, frames)) ** 2
    rows = [[0, 0, 0, 0, 0, 0, -a, 0, 0, 0, a / 2, 0] for a in angles]
    for row in broken:
        rows[row][3:6] = [0, 90, 0]
    return bvh(rows, order="ZXY", step=".0333333")


def follower(cls=Plain):
    return cls()


def holds(made, margins=None):
    robot = coman()
    wanted = audit.demands(robot)
    q = made.motion.q
    at_rows = np.where(made.motion.mode == "between", wanted.margin_between, wanted.margin)
    return audit.audit(robot, made.motion.time, q, wanted, at_rows).holds


# --- clips as frames


def test_frames_are_those_of_the_pipeline(wave):
    frames = read_frames(wave, "midpoint")
    from s3le.human.read import read_clip

    clip = read_clip(wave)
    kept = skeletons(clip.points, "midpoint", np.radians(60.0))
    assert (frames.x == kept.x).all() and frames.total == len(clip.points) == 45
    assert frames.time == pytest.approx(np.arange(45) / clip.fps, abs=1e-12)
    assert frames.name == "wave" and frames.gap == pytest.approx(1 / clip.fps)


@pytest.mark.parametrize("kind", ["bvh", "amc", "amc.gz", "txt", "json"])
def test_every_format_that_is_known_is_read(tmp_path, kind, wave):
    if kind.startswith("amc"):
        write(tmp_path / "01.asf", asf())
        path = write(tmp_path / f"01_01.{kind}", amc({}, {}))
    elif kind == "bvh":
        path = wave
    else:
        path = write(tmp_path / f"a.{kind}", deepmimic({}, {}))
    frames = read_frames(path, "midpoint")
    assert frames.x.shape == (frames.total, 21) and frames.fps > 0


def test_rows_go_on_where_frames_cannot_be_used(tmp_path):
    path = write(tmp_path / "falls.bvh", waving(45, broken=(0, 10, 11, 12)))
    frames = read_frames(path, "midpoint")
    assert frames.total == 45 and len(frames.x) == 41
    assert frames.frame[:2].tolist() == [1, 2] and sum(frames.dropped.values()) == 4
    assert frames.time[0] == pytest.approx(1 / frames.fps)
    assert frames.gap == pytest.approx(4 / frames.fps)
    made = clip.convert(follower(), frames)
    assert len(made.motion.time) == 44 and holds(made)
    assert np.diff(made.motion.time) == pytest.approx(1 / frames.fps)
    assert np.flatnonzero(made.motion.mode == "dropped").tolist() == [9, 10, 11]
    assert made.summary["to_human"]["mean"] < 0.05  # over the frames that were seen
    assert made.summary["frames"]["longest_gap_s"] == pytest.approx(4 / frames.fps)


def test_a_clip_without_a_usable_frame_is_refused_with_the_cause(tmp_path):
    path = write(tmp_path / "lies.bvh", waving(5, broken=range(5)))
    with pytest.raises(ClipError, match=r"lies.bvh: not one of 5 frames can be used \(\w+ 5\)"):
        read_frames(path, "midpoint", how=How(axes="y-up"))


def test_another_rate_is_resampled_as_in_the_pipeline(wave):
    frames = read_frames(wave, "midpoint", rate=60.0)
    assert frames.fps == 60.0 and frames.total == 89


# --- motions


def test_what_comes_out_holds_and_is_described(wave):
    frames = read_frames(wave, "midpoint")
    made = clip.convert(follower(), frames, about={"model": "plain"})
    motion, summary = made
    assert motion.joints == tuple(coman().joint_names) and holds(made)
    assert motion.time == pytest.approx(frames.time, abs=0)
    assert motion.mode[0] == "start" and set(motion.mode) <= {"start", "refined", "limited", "held"}
    assert motion.clearance == pytest.approx(coman().certifier().check(motion.q).clearance, abs=0)
    assert motion.about["robot_hash"] == coman().digest and motion.about["model"] == "plain"
    assert motion.about["certificate"]["holds"]
    assert len(motion.about["certificate"]["not_covered"]) == 20
    assert summary["to_human"]["mean"] < 0.05
    certified = summary["certified"]
    assert certified["poses"] == 45 and certified["paths"] == 44 and certified["share"] == 1.0
    assert certified["proven_bound_m"] >= 0.0005
    assert sum(summary["modes"].values()) == 45
    assert summary["milliseconds_per_frame"]["p50"] > 0
    assert summary["speed_rad_s"]["highest"] <= 4.0 * (1 + 1e-6)
    json.dumps(summary, allow_nan=False)


def test_fidelity_is_measured_on_the_frames_by_hand(wave):
    frames = read_frames(wave, "midpoint")
    made = clip.convert(follower(), frames)
    from s3le.kernels import batch

    points = batch.points(coman().chain, made.motion.q)
    x, _ = features(points, "midpoint")
    by_hand = np.mean(1 - (x.reshape(-1, 7, 3) * frames.x.reshape(-1, 7, 3)).sum(2), axis=1)
    assert made.summary["to_human"]["mean"] == pytest.approx(by_hand.mean(), abs=1e-9)
    assert made.summary["to_human"]["largest"] == pytest.approx(by_hand.max(), abs=1e-9)


@pytest.mark.parametrize("rate", [30.0, 47.3, 120.0, 1000.0])
def test_at_any_rate_it_holds_and_stays_on_the_path(wave, rate):
    frames = read_frames(wave, "midpoint")
    plain = clip.convert(follower(), frames)
    made = clip.convert(follower(), frames, rate=rate)
    assert holds(made)
    assert np.diff(made.motion.time) == pytest.approx(1 / rate, rel=1e-6)
    for j in range(11):
        path = np.interp(made.motion.time, plain.motion.time, plain.motion.q[:, j])
        assert made.motion.q[:, j] == pytest.approx(path, abs=0.1)
    assert made.summary["to_human"]["mean"] == pytest.approx(
        plain.summary["to_human"]["mean"], abs=1e-3
    )


def test_a_lead_in_begins_at_the_anchor_and_is_marked(wave):
    frames = read_frames(wave, "midpoint")
    made = clip.convert(follower(), frames, lead_in=1.0, rate=100.0)
    motion = made.motion
    assert (motion.q[0] == coman().anchor).all() and motion.time[0] == 0.0
    assert motion.mode[0] == "start" and holds(made)
    lead = motion.mode == "lead_in"
    assert motion.time[lead].max() == pytest.approx(1.0, abs=0.04)
    assert not lead[motion.time > 1.05].any() and lead[1:90].all()
    offset = motion.about["clip_time_offset_s"]
    pace = 100.0 / 3  # that the clip is followed at
    assert offset == pytest.approx(made.summary["rows"]["lead_in"] / pace)
    assert made.summary["rows"]["lead_in"] == round(pace) + 1


def test_an_approach_turns_every_bone_from_one_to_the_other():
    rng = np.random.default_rng(0)
    a, b = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.normal(size=(2, 7, 3)))
    b[0], b[1] = -a[0], a[1]  # about turn, and no turn
    way = approach(a.reshape(21), b.reshape(21), 50).reshape(50, 7, 3)
    assert np.linalg.norm(way, axis=2) == pytest.approx(1.0, abs=1e-12)
    whole = np.concatenate([a[None], way, b[None]])
    turn = np.arccos(np.clip((whole[1:] * whole[:-1]).sum(2), -1, 1))
    assert turn.max() < 0.15 and turn[0].max() < 0.001
    total = np.arccos(np.clip((a * b).sum(1), -1, 1))
    assert turn.sum(axis=0) == pytest.approx(total, abs=1e-5)


@pytest.mark.parametrize("lead_in", [-1.0, float("nan"), 1e9])
def test_a_lead_in_out_of_range_is_refused(wave, lead_in):
    frames = read_frames(wave, "midpoint")
    with pytest.raises(ParameterError, match="lead-in must be in"):
        clip.convert(follower(), frames, lead_in=lead_in)


def test_a_motion_that_does_not_hold_is_refused_with_the_place(tmp_path):
    rows = [[0, 0, 0, 0, 0, 0, -80 * (i // 5 % 2), 0, 0, 0, 0, 0] for i in range(20)]
    path = write(tmp_path / "jerks.bvh", bvh(rows, order="ZXY", step=".0333333"))
    frames = read_frames(path, "midpoint")
    with pytest.raises(CertificateError, match=r"jerks: refused, \d.* turns at .* rad/s of 4"):
        clip.convert(follower(Reckless), frames)
    assert holds(clip.convert(follower(), frames))


def test_one_frame_is_a_motion(tmp_path):
    frames = read_frames(write(tmp_path / "w.bvh", waving(1)), "midpoint")
    for rate in (None, 500.0):
        made = clip.convert(follower(), frames, rate=rate)
        assert len(made.motion.q) == 1
        files.write(made.motion, tmp_path / "w.parquet")
        json.dumps(made.summary, allow_nan=False)
