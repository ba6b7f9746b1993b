import gzip
import hashlib
import json
import os
import re
import subprocess
import sys
import zipfile
from contextlib import contextmanager
from pathlib import Path

import bodies
import estimators
import numpy as np
import pytest
from handmade import amc, asf, bvh, deepmimic, table, write
from webserver import serving

from s3le.errors import ClipError, FetchError, ParameterError
from s3le.human import dataset, fetch, sources
from s3le.human.read import read_clip

ROW = [0.0] * 12
ASF, AMC = asf().encode(), amc({}, {}, {}).encode()
FAST = {"tries": 3, "timeout": 5.0}


def digest(data):
    return hashlib.sha256(data).hexdigest()


# --- CMU --------------------------------------------------------------------------------------


@pytest.fixture
def server(monkeypatch):
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    monkeypatch.setattr("pooch.core.time.sleep", lambda _: None)
    with serving() as state:
        yield state


COLUMNS = "trial,description,fps,split,sha256,asf_sha256"


@pytest.fixture
def manifest(tmp_path):
    return table(
        tmp_path / "manifest.csv", COLUMNS,
        ("01_01", "walk", 120, "train", digest(AMC), digest(ASF)),
        ("01_02", "run", 120, "test", "", digest(ASF)),
        ("79_03", "swim, far", 60, "heldout", "", ""),
    )  # fmt: skip


def serve_all(server):
    for subject, trial in (("01", "01_01"), ("01", "01_02"), ("79", "79_03")):
        server.files[f"/subjects/{subject}/{subject}.asf"] = ASF
        server.files[f"/subjects/{subject}/{trial}.amc"] = AMC


def test_trials_come_over_http_once_and_read(server, tmp_path, manifest):
    serve_all(server)
    found = sources.cmu(manifest, tmp_path / "cache", server.base, **FAST)
    assert found.left_out == []
    assert [(s.clip, s.split, s.fps, s.description) for s in found.clips] == [
        ("01_01", "train", 120.0, "walk"),
        ("01_02", "test", 120.0, "run"),
        ("79_03", "heldout", 60.0, "swim, far"),
    ]
    assert found.clips[0].path == tmp_path / "cache" / "01" / "01_01.amc"
    assert len(read_clip(found.clips[2].path, found.clips[2].fps).points) == 3
    asked = len(server.requests)
    assert asked == 5  # two skeletons, three motions
    again = sources.cmu(manifest, tmp_path / "cache", server.base, **FAST)
    assert again == found and len(server.requests) == asked
    assert sources.cmu(manifest, tmp_path / "unused", tmp_path / "cache") == found


def test_only_the_splits_wanted_are_fetched(server, tmp_path, manifest):
    serve_all(server)
    found = sources.cmu(manifest, tmp_path / "c", server.base, splits=("test",), **FAST)
    assert [s.clip for s in found.clips] == ["01_02"]
    assert len(server.requests) == 2


def test_a_gzipped_mirror_serves_as_well_and_a_cut_file_is_fetched_again(
    server, tmp_path, manifest
):
    serve_all(server)
    packed = gzip.compress(AMC, mtime=0)
    del server.files["/subjects/01/01_01.amc"]
    server.files["/subjects/01/01_01.amc.gz"] = packed
    server.drop_after = [len(ASF), len(packed) // 2]
    found = sources.cmu(manifest, tmp_path / "c", server.base, **FAST)
    assert found.clips[0].path.name == "01_01.amc.gz"
    assert found.clips[0].path.read_bytes() == packed
    assert server.requests.count("/subjects/01/01_01.amc.gz") == 2
    assert len(read_clip(found.clips[0].path).points) == 3


@pytest.mark.parametrize(
    ("body", "why"),
    [
        (b"<!DOCTYPE html><title>moved</title>", "looks like an HTML or XML page, not AMC text"),
        (b"", "looks like an empty file, not AMC text"),
        (AMC + b"4\n", f"sha256 is {digest(AMC + b'4' + bytes([10]))}, wanted {digest(AMC)}"),
    ],
)
def test_a_page_in_place_of_a_trial_is_refused_and_not_kept(server, tmp_path, manifest, body, why):
    serve_all(server)
    server.files["/subjects/01/01_01.amc"] = body
    with pytest.raises(FetchError, match=why):
        sources.cmu(manifest, tmp_path / "c", server.base, **FAST)
    assert sorted(os.listdir(tmp_path / "c" / "01")) == ["01.asf", "01_02.amc"]


def test_missing_trials_are_named_together_with_what_to_do(server, tmp_path, manifest):
    serve_all(server)
    del server.files["/subjects/01/01_02.amc"], server.files["/subjects/79/79.asf"]
    with pytest.raises(FetchError) as error:
        sources.cmu(manifest, tmp_path / "c", server.base, **FAST)
    assert str(error.value) == (
        f"2 of 3 trials cannot be had: 01_02, 79_03; first: {server.base}/subjects/01/01_02.amc.gz:"
        f" HTTP status 404; run again to go on from {tmp_path / 'c'}, or name a folder with "
        "subjects/SS/SS_TT.amc in clips_mirror, or set clips_missing: skip"
    )
    found = sources.cmu(manifest, tmp_path / "c", server.base, missing="skip", **FAST)
    assert [s.clip for s in found.clips] == ["01_01"]
    assert [said.partition(":")[0] for said in found.left_out] == ["01_02", "79_03"]


def test_a_dead_server_is_knocked_at_once_and_the_cache_still_serves(
    server, tmp_path, manifest, monkeypatch
):
    serve_all(server)
    sources.cmu(manifest, tmp_path / "c", server.base, splits=("heldout",), **FAST)
    knocks = []

    def nobody(url, *_, **__):
        knocks.append(url)
        raise fetch.UnreachableError(f"{url}: nobody")

    monkeypatch.setattr(fetch, "download", nobody)
    with pytest.raises(FetchError, match="2 of 3 trials cannot be had: 01_01, 01_02"):
        sources.cmu(manifest, tmp_path / "c", server.base)
    found = sources.cmu(manifest, tmp_path / "c", server.base, missing="skip")
    assert [s.clip for s in found.clips] == ["79_03"] and len(knocks) == 2
    with pytest.raises(FetchError, match="3 of 3 trials cannot be had: 01_01, 01_02, 79_03"):
        sources.cmu(manifest, tmp_path / "empty", server.base, missing="skip")


def test_a_damaged_cache_is_fetched_again(server, tmp_path, manifest):
    serve_all(server)
    found = sources.cmu(manifest, tmp_path / "c", server.base, **FAST)
    found.clips[0].path.write_bytes(AMC[:-20])
    sources.cmu(manifest, tmp_path / "c", server.base, **FAST)
    assert found.clips[0].path.read_bytes() == AMC


@pytest.mark.parametrize("above", ["", "subjects/"])
@pytest.mark.parametrize("suffix", ["", ".gz"])
def test_a_local_mirror_is_read_where_it_lies(tmp_path, manifest, above, suffix):
    for subject, trial in (("01", "01_01"), ("01", "01_02"), ("79", "79_03")):
        write(tmp_path / f"mirror/{above}{subject}/{subject}.asf{suffix}", ASF)
        write(tmp_path / f"mirror/{above}{subject}/{trial}.amc{suffix}", AMC)
    found = sources.cmu(manifest, tmp_path / "c", tmp_path / "mirror")
    assert len(found.clips) == 3 and not (tmp_path / "c").exists()
    assert len(read_clip(found.clips[0].path).points) == 3


def test_a_changed_file_in_a_local_mirror_is_refused(tmp_path, manifest):
    write(tmp_path / "mirror/01/01.asf", ASF)
    write(tmp_path / "mirror/01/01_01.amc", amc({}))
    with pytest.raises(FetchError, match="01_01.amc: sha256 is"):
        sources.cmu(manifest, tmp_path / "c", tmp_path / "mirror", splits=("train",))


@pytest.mark.parametrize("wish", [{"missing": "ignore"}, {"splits": ("training",)}])
def test_misspelt_wishes_are_refused(tmp_path, manifest, wish):
    with pytest.raises(ParameterError):
        sources.cmu(manifest, tmp_path / "c", tmp_path, **wish)


# --- the demo ---------------------------------------------------------------------------------


@pytest.fixture
def wheel(tmp_path):
    """A wheel with two clips, its manifest, and how often it was downloaded."""
    texts = {"hop": deepmimic({}, {}), "wave": deepmimic({}, {}, {})}
    path = tmp_path / "pybullet.whl"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("pybullet.so", b"\0" * 1000)
        for name, content in texts.items():
            archive.writestr(f"pybullet_data/data/motions/humanoid3d_{name}.txt", content)
    table(
        tmp_path / "demo.csv", "clip,split,sha256,description",
        *[(name, "train", digest(text.encode()), "d") for name, text in texts.items()],
    )  # fmt: skip
    calls = []

    def download(folder):
        calls.append(folder)
        return write(folder / path.name, path.read_bytes())

    return download, digest(path.read_bytes()), tmp_path / "demo.csv", calls


def test_the_demo_keeps_its_texts_and_nothing_else(tmp_path, wheel):
    download, sha256, manifest, calls = wheel
    cache = tmp_path / "a" / "cache"
    found = sources.demo(manifest, cache, download, sha256)
    assert [(s.clip, s.split, s.fps) for s in found.clips] == [
        ("hop", "train", None), ("wave", "train", None)]  # fmt: skip
    assert sorted(os.listdir(cache)) == ["hop.txt", "wave.txt"]
    assert len(read_clip(found.clips[1].path).points) == 3
    assert sources.demo(manifest, cache, download, sha256) == found and len(calls) == 1
    (cache / "hop.txt").write_text("{}")
    sources.demo(manifest, cache, download, sha256)
    assert len(calls) == 2 and len(read_clip(cache / "hop.txt").points) == 2


def test_another_wheel_is_refused(tmp_path, wheel):
    download, _, manifest, _ = wheel
    with pytest.raises(FetchError, match="pybullet.whl: sha256 is .* wanted 5d858abf"):
        sources.demo(manifest, tmp_path / "cache", download)
    assert os.listdir(tmp_path / "cache") == []


def test_a_wheel_without_a_clip_or_with_another_one_is_refused(tmp_path, wheel):
    download, sha256, manifest, _ = wheel
    text = manifest.read_text()
    manifest.write_text(text.replace("hop", "leap"))
    with pytest.raises(FetchError, match="humanoid3d_leap.txt"):
        sources.demo(manifest, tmp_path / "cache", download, sha256)
    manifest.write_text(re.sub(r"hop,train,.{64}", "hop,train," + "0" * 64, text))
    with pytest.raises(FetchError, match="humanoid3d_hop.txt: sha256 is .* wanted 0000"):
        sources.demo(manifest, tmp_path / "cache", download, sha256)


@contextmanager
def pip_that(monkeypatch, status, writes=()):
    calls = []

    def run(command, check):
        calls.append(command)
        for name in writes:
            write(Path(command[command.index("-d") + 1]) / name, b"wheel")
        return subprocess.CompletedProcess(command, status)

    monkeypatch.setattr(subprocess, "run", run)
    yield calls


def test_pip_is_asked_for_one_wheel_of_a_fixed_platform_with_the_users_options(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("PIP_ARGS", "--no-index --find-links 'my wheels'")
    with pip_that(monkeypatch, 0, ["pybullet-3.2.7-x.whl"]) as calls:
        assert sources.pip_wheel(tmp_path).name == "pybullet-3.2.7-x.whl"
    [command] = calls
    assert command[:5] == [sys.executable, "-m", "pip", "download", "pybullet==3.2.7"]
    assert command[-3:] == ["--no-index", "--find-links", "my wheels"]
    assert not any("://" in word for word in command)


@pytest.mark.parametrize(("status", "files"), [(1, []), (0, [])])
def test_a_pip_that_fails_is_reported_with_what_to_do(tmp_path, monkeypatch, status, files):
    with pip_that(monkeypatch, status, files):
        with pytest.raises(FetchError, match=f"status {status}; .*PIP_ARGS"):
            sources.pip_wheel(tmp_path)


# --- a folder of one's own --------------------------------------------------------------------


@pytest.fixture
def own(tmp_path):
    root = tmp_path / "own"
    write(root / "train" / "b" / "wave.bvh", bvh([ROW]))
    write(root / "train" / "a.json.gz", deepmimic({}))
    write(root / "train" / "me.asf", asf())
    write(root / "train" / "me_01.amc", amc({}))
    write(root / "train" / "README.txt", "notes")
    write(root / "train" / ".DS_Store", b"\0")
    write(root / "test" / "kick.bvh.gz", bvh([ROW]))
    return root


def test_a_folder_lists_its_clips_in_order_and_what_it_ignored(own):
    found = sources.folder(own)
    assert [(s.clip, s.split) for s in found.clips] == [
        ("a", "train"), ("b/wave", "train"), ("me_01", "train"), ("kick", "test")]  # fmt: skip
    assert found.left_out == [
        "train/.DS_Store: not a motion file", "train/README.txt: not a motion file"]  # fmt: skip
    assert all(len(read_clip(s.path, s.fps).points) == 1 for s in found.clips)
    write(own / "heldout" / "z.bvh", bvh([ROW]))
    assert sources.folder(own).clips[-1].split == "heldout"


def test_a_table_of_rates_overrides_the_files(own):
    table(own / "fps.csv", "clip,fps", ("b/wave", 25), ("kick", "59.94"))
    assert [s.fps for s in sources.folder(own).clips] == [None, 25.0, None, 59.94]


@pytest.mark.parametrize(
    ("row", "why"),
    [
        (("b/wav", 25), "no clip is called 'b/wav'; did you mean b/wave?"),
        (("kick", "fast"), "fps of kick must be a frame rate, got 'fast'"),
        (("kick", "nan"), "fps of kick must be a frame rate, got 'nan'"),
        (("kick", "0"), "fps of kick must be a frame rate, got '0'"),
    ],
)
def test_a_faulty_table_of_rates_is_refused(own, row, why):
    table(own / "fps.csv", "clip,fps", row)
    with pytest.raises(ClipError, match=re.escape(why)):
        sources.folder(own)


def test_a_clip_in_two_splits_is_refused(own):
    write(own / "test" / "a.bvh", bvh([ROW]))
    with pytest.raises(ClipError, match="a.bvh: a is also .*train/a.json.gz; rename one"):
        sources.folder(own)


@pytest.mark.parametrize("split", ["train", "test", "heldout"])
def test_an_empty_split_is_refused(own, split):
    (own / split).rename(own / "away") if (own / split).exists() else None
    with pytest.raises(ClipError, match=f"{split}: no motion file"):
        (own / split).mkdir()
        sources.folder(own)
    (own / split).rmdir()
    if split != "heldout":
        with pytest.raises(ClipError, match=f"{split}: no motion file"):
            sources.folder(own)


def test_a_folder_may_hold_whatever_retarget_reads(tmp_path):
    root = tmp_path / "own"
    write(root / "train" / "walk.bvh", bvh([ROW]))
    amass = root / "train" / "CMU" / "01"
    amass.mkdir(parents=True)
    poses = {"poses": np.pad(bodies.pose(), ((0, 0), (0, 84))), "mocap_framerate": 120.0}
    np.savez(amass / "01_01_poses.npz", **poses)
    for name in ("shape.npz", "neutral_stagei.npz"):  # of AMASS, without motion
        np.savez(amass / name, betas=np.zeros(10))
    frames = root / "test" / "openpose"
    joints = bodies.listed("body25", bodies.body(3) @ bodies.INTO["camera"].T)
    for number, own in enumerate(joints):
        numbers = np.c_[own, np.ones(len(own))].ravel().tolist()
        tree = {"people": [{"pose_keypoints_3d": numbers}]}
        write(frames / f"a_{number:03d}_keypoints.json", json.dumps(tree))
    write(root / "test" / "wham_output.pkl", estimators.wham(bodies.pose()))
    found = sources.folder(root)
    assert [(s.clip, s.split) for s in found.clips] == [
        ("CMU/01/01_01_poses", "train"), ("walk", "train"), ("openpose", "test"),
        ("wham_output", "test"),
    ]  # fmt: skip
    assert found.left_out == [f"train/CMU/01/{name}: not a motion file"
                              for name in ("neutral_stagei.npz", "shape.npz")]  # fmt: skip
    read, lost = dataset.load(found)
    assert lost == []
    counts = {name: int((read.clip == name).sum()) for name in dict.fromkeys(read.clip)}
    assert counts == {"CMU/01/01_01_poses": 12, "walk": 1, "openpose": 3, "wham_output": 12}
    assert set(read.fps[read.clip == "CMU/01/01_01_poses"]) == {120.0}


def test_one_bad_clip_stops_the_others_or_is_left_out_as_asked(own):
    write(own / "train" / "bad.bvh", b"nonsense")
    write(own / "test" / "odd.npz", b"PK")
    found = sources.folder(own)
    with pytest.raises(ClipError, match="bad.bvh: looks like text of no motion format"):
        dataset.load(found)
    done = []
    read, lost = dataset.load(found, done.append, missing="skip")
    assert list(dict.fromkeys(read.clip)) == ["a", "b/wave", "me_01", "kick"]
    assert len(lost) == 2 and "bad.bvh: looks like" in lost[0] and "odd.npz: is no" in lost[1]
    assert sum(done) == len(found.clips)
    write(own / "test" / "kick.bvh.gz", b"nonsense")
    with pytest.raises(ClipError, match="not one of 2 clips of 'test' can be read; first: .*kick"):
        dataset.load(sources.folder(own), missing="skip")
