"""Certified motions in the comparison: what a stream gives, motion by motion, or nothing."""

import numpy as np
import pytest
from streaming import held_to_its_word, motion, retargeter, stored
from worlds import MARGIN, coman

from s3le.errors import BundleError, CertificateError
from s3le.kernels import batch
from s3le.retarget import ahead
from s3le.retarget.rows import Mode, Rows
from s3le.retarget.stream import Retargeter
from s3le.skeleton import cosine_distance
from s3le.study import followed
from s3le.study.tables import MODES

LENGTHS, RATE = (25, 1, 14), 25.0  # [Hz]; one frame is missing in the last motion


@pytest.fixture(scope="module")
def frames():
    clips = np.repeat(["a", "b", "c"], LENGTHS)
    times = np.concatenate([np.arange(n) for n in LENGTHS]) / RATE
    times[-5:] += 1.0 / RATE
    return clips, times, motion()[: sum(LENGTHS)]


@pytest.fixture(scope="module")
def both(frames):
    return {refine: followed.follow(coman(), retargeter(), *frames, refine) for refine in (0, 1)}


@pytest.mark.parametrize("refine", [0, 1])
def test_every_motion_starts_at_its_own_first_pose_and_all_of_it_is_certified(frames, both, refine):
    clips, times, _ = frames
    q, v, mode = both[refine]
    assert set(mode) <= set(MODES)
    for clip in "abc":
        own = clips == clip
        assert mode[own][0] == "start" and "start" not in mode[own][1:]
        held_to_its_word(q[own], v[own], np.diff(times[own]), judged=1)


def test_frame_by_frame_it_is_what_a_stream_gives(frames):
    clips, times, x = frames
    own = clips == "c"
    q, v, mode = followed.follow(coman(), retargeter(), *frames, True, look_ahead=False)
    stream = retargeter().start()
    steps = np.concatenate([[1 / 30], np.diff(times[own])])
    rows = [stream.step(*frame) for frame in zip(x[own], steps, strict=True)]
    np.testing.assert_array_equal(q[own], [row.q for row in rows])
    np.testing.assert_array_equal(v[own], [row.v for row in rows])
    assert mode[own].tolist() == [row.mode for row in rows]


def test_the_look_up_alone_goes_for_stored_poses(frames):
    clips, times, x = frames
    both = [
        followed.follow(coman(), retargeter(), *frames, refine, look_ahead=False)
        for refine in (False, True)
    ]
    q, _, mode = both[0]
    poses, skeletons = stored()
    first = np.flatnonzero(np.r_[True, clips[1:] != clips[:-1]])
    nearest = cosine_distance(skeletons[None], x[first][:, None]).argmin(axis=1)
    np.testing.assert_array_equal(q[first], poses[nearest])
    there = np.isin(mode, ["start", "lookup"])
    off = np.abs(q[there][:, None] - poses[None]).max(axis=2).min(axis=1)
    assert off.max() <= ahead.AS_WANTED
    far = {k: cosine_distance(batch.skeletons(coman().chain, both[k][0]), x).mean() for k in (0, 1)}
    assert far[1] < far[0]  # refining is worth something


def test_given_time_the_look_up_alone_is_where_it_wants_to_be(frames):
    _, _, x = frames
    slow = (np.repeat("a", 25), np.arange(25.0), x[::8].repeat(5, axis=0))
    q, _, mode = followed.follow(coman(), retargeter(), *slow, False)
    poses, skeletons = stored()
    nearest = cosine_distance(skeletons[None], slow[2][:, None]).argmin(axis=1)
    arrived = np.isin(mode, ["lookup", "refined"])
    assert arrived.sum() >= 3
    assert q[arrived] == pytest.approx(poses[nearest[arrived]], abs=ahead.AS_WANTED)


class Liar(Retargeter):
    """Goes straight from one stored pose to another and calls it certified."""

    def plan(self, x, dt, start=None, progress=None):
        words = np.full(len(x), Mode.REFINED, object)
        q = stored()[0][: len(x)]
        return Rows(q, words, *np.full((5, len(x)), MARGIN), np.zeros_like(q))


def test_a_motion_that_does_not_hold_is_refused_by_name(frames):
    liar = Liar(coman(), retargeter(), retargeter().settings)
    with pytest.raises(CertificateError, match=r"^a: 0\.0000 s \(row 0\): .* rad/s of 4"):
        followed.follow(coman(), liar, *frames, True)


def test_a_retargeter_of_another_robot_is_refused(frames):
    with pytest.raises(BundleError, match="dvc repro export"):
        followed.follow(coman(0.003), retargeter(), *frames, True)


def test_the_table_knows_every_mode_of_a_stream():
    of_given_joints = {Mode.GAVE_WAY, Mode.FORCED}  # a study has none
    assert set(MODES) == {"decoded", *(set(Mode) - of_given_joints)}
