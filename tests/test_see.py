"""`s3le view` in a real browser, and `s3le render`: what a person sees, and what they are told."""

import json
import signal
import time
import urllib.request
from pathlib import Path

import browser
import numpy as np
import pytest
from command import ROBOT, run
from follower import Plain, led_by
from test_scene import moving, wave

from s3le.cli import shell
from s3le.human.origin import about_clip
from s3le.show import motions, pace


@pytest.fixture
def walk(tmp_path):
    """A motion that knows its clip."""
    clip = wave(tmp_path)
    return moving(tmp_path, about=about_clip(clip, tmp_path)).path


def picture(path):
    from PIL import Image

    with Image.open(path) as image:
        return np.array(image.convert("RGB"))


# --- strips and films


def test_a_strip_is_the_same_bytes_twice_and_changes_with_what_is_asked(walk, tmp_path):
    made = {}
    for name, options in {
        "a": [], "b": [], "three": ["--frames", "3", "--camera", "left"],
        "alone": ["--human", "none", "--size", "700"],
    }.items():  # fmt: skip
        said = run("render", walk, *ROBOT, "--out", tmp_path / f"{name}.png", *options)
        assert said.exit_code == 0, said.output
        made[name] = (tmp_path / f"{name}.png").read_bytes()
    assert made["a"] == made["b"] and len(set(made.values())) == len(made) - 1
    whole, alone = picture(tmp_path / "a.png"), picture(tmp_path / "alone.png")
    assert whole.shape[0] > alone.shape[0] + 100  # the human's row
    assert whole.std() > 10


def test_a_film_lasts_as_long_as_the_motion_and_moves(walk, tmp_path):
    av = pytest.importorskip("av")
    other = moving(tmp_path, name="other", modes=False).path
    for out in ("a.mp4", "b.mp4"):
        said = run(
            "render", walk, other, *ROBOT, "--out", tmp_path / out, "--fps", 20, "--size", 480
        )
        assert said.exit_code == 0, said.output
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()
    with av.open(str(tmp_path / "a.mp4")) as film:
        stream = film.streams.video[0]
        shown = [frame.to_ndarray(format="rgb24") for frame in film.decode(stream)]
    assert stream.average_rate == 20 and len(shown) == 20  # 29 steps of 1/30 s
    assert shown[0].shape[1] == 480 and shown[0].shape[0] % 2 == 0
    assert np.abs(shown[0].astype(int) - shown[-1]).max() > 60


def test_a_gif_keeps_time(walk, tmp_path):
    from PIL import Image

    said = run("render", walk, *ROBOT, "--out", tmp_path / "a.gif", "--fps", 30, "--size", 320)
    assert said.exit_code == 0, said.output
    spent, held = 0, tuple(bytes.fromhex(pace.HELD.colour[1:]))
    with Image.open(tmp_path / "a.gif") as film:
        for frame in range(film.n_frames):
            film.seek(frame)
            spent += film.info["duration"]
        drawn = np.array(film.convert("RGB")).reshape(-1, 3)
    assert (drawn == held).all(axis=1).any() and (drawn == 255).all(axis=1).any()
    assert spent == pytest.approx(1000, abs=10)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--out", "a.avi"], "wanted .png, .mp4, .gif"),
        (["--out", "a.mp4", "--frames", "3"], "a film has --fps"),
        (["--out", "a.png", "--frames", "3", "--every", "1"], "give one of them"),
        (["--out", "a.png", "--frames", "0"], "from 1 to 60"),
        (["--out", "a.png", "--every", "nan"], "above 0 s"),
        (["--out", "a.png", "--every", "0.001"], "at most 60 are drawn"),
        (["--out", "a.png", "--from", "9"], "nothing to show"),
        (["--out", "a.png", "--size", "9"], "from 200 to"),
        (["--out", "a.png", "--camera", "up"], "wanted AZIMUTH"),
        (["--out", "a.png", "--camera", "0,0"], "wanted AZIMUTH"),
        (["--out", "a.png", "--human", "no.bvh"], "no.bvh"),
        (["--out", "a.gif", "--fps", "60"], "at most 50"),
        (["--out", "a.mp4", "--fps", "nan"], "--fps must be"),
    ],
)
def test_what_cannot_be_drawn_is_one_line_and_leaves_nothing(
    walk, tmp_path, monkeypatch, options, message
):
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path / "out")
    said = run("render", walk, *ROBOT, *options)
    assert said.exit_code == shell.UNREADABLE
    assert message in said.stderr and len(said.stderr.splitlines()) == 1
    assert list(Path().iterdir()) == []


def test_a_film_that_breaks_off_leaves_the_old_one(walk, tmp_path, monkeypatch):
    from s3le.show import film

    (tmp_path / "a.gif").write_bytes(b"old")
    drawn = film.Film.picture

    def breaks(self, i):
        if i == 3:
            raise OSError("the disk is full")
        return drawn(self, i)

    monkeypatch.setattr(film.Film, "picture", breaks)
    said = run("render", walk, *ROBOT, "--out", tmp_path / "a.gif", "--size", 320)
    assert said.exit_code == shell.UNREADABLE and "the disk is full" in said.stderr
    assert (tmp_path / "a.gif").read_bytes() == b"old"
    assert not list(tmp_path.glob("*.part"))


def test_a_retargeted_clip_knows_its_human(tmp_path, monkeypatch):
    led_by(monkeypatch, Plain)
    clip = wave(tmp_path)
    assert run("retarget", clip, "--out", tmp_path / "out").exit_code == 0
    shown = moving(tmp_path)  # for its machine
    made = motions.read(tmp_path / "out" / "wave.parquet", shown.robot)
    assert motions.recorded_clip(made) == (tmp_path / "out" / "../clips/wave.bvh", "")
    assert json.loads((tmp_path / "out" / "wave.json").read_text())[motions.CLIP_HASH]


# --- the viewer


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--port", "70000"], "--port must be"),
        (["--from", "9"], "nothing to show"),
        (["--human", "no.bvh"], "no.bvh"),
        (["--robot", "nobody"], "there is no robot 'nobody'"),
        (["--rate", "nan"], "--rate must be"),
        (["--meshes", "nowhere.urdf", "--port", "0"], "nowhere.urdf"),
        (["--host", "203.0.113.9"], "cannot be listened on"),  # nobody's (RFC 5737)
    ],
)
def test_what_cannot_be_viewed_is_one_line(walk, options, message):
    said = run("view", walk, *([] if "--robot" in options else ROBOT), *options)
    assert said.exit_code == shell.UNREADABLE
    assert message in said.stderr and len(said.stderr.splitlines()) == 1


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """The viewer in a process of its own, and its address."""
    pytest.importorskip("viser")
    folder = tmp_path_factory.mktemp("served")
    clip = wave(folder, by=0.0)  # the human stands, so what moves is the robot
    walk = moving(folder, about=about_clip(clip, folder)).path
    with browser.serving(walk, *ROBOT) as found:
        yield found


@pytest.mark.wide
@pytest.mark.skipif(not browser.PATH, reason="no Chromium on this machine")
def test_the_page_plays_scrubs_and_shows_the_robot(served, tmp_path):
    _, address = served
    with browser.opened(tmp_path, 640, 420) as page:
        page.call("Page.navigate", url=address)
        page.says(r"0\.000 s, 1 of 30")
        first = canvas_of(page, lambda seen: colours(seen) > 200)  # not a blank one
        # The slider moves the robot.
        page.run("document.querySelector('[role=slider]').focus()")
        page.press("End", 35)
        page.says("30 of 30")
        canvas_of(page, lambda seen: differ(first, seen))
        # The closest pair is named.
        page.click("label", "closest pair")
        page.says("closest: .* and ")
        # It plays: the moment moves on by itself, and stops when told to.
        page.click("button", "Play")
        page.says(r"\b([2-9]|1[0-9]|2[0-9]) of 30")
        page.click("button", "Pause")
        page.wait("![...document.querySelectorAll('button')].some(e => e.innerText == 'Pause')")
        stands = page.run(browser.TEXT)
        assert page.run(browser.TEXT) == stands
    assert page.wrong == []
    assert page.asked and all(url.startswith((address, "data:", "blob:")) for url in page.asked)


def canvas_of(page, wanted):
    """What the scene shows, without the panel, once it is as wanted."""
    for _ in range(20):  # a page draws when it can
        if wanted(seen := _canvas(page)):
            return seen
        time.sleep(0.2)
    raise AssertionError("the canvas never showed it")


def _canvas(page):
    from io import BytesIO

    from PIL import Image

    shot = page.screenshot(x=0, y=0, width=330, height=420)
    with Image.open(BytesIO(shot)) as image:
        return np.array(image.convert("RGB")).astype(int)


def colours(seen):
    return len(np.unique(seen.reshape(-1, 3), axis=0))


def differ(a, b):
    return (np.abs(a - b).max(axis=2) > 40).sum() > 100


# Last, for it ends what the tests above look at.
def test_it_serves_until_ctrl_c_and_ends_cleanly(served):
    viewer, address = served
    with urllib.request.urlopen(address, timeout=30) as page:
        assert page.status == 200 and b"<html" in page.read()
    viewer.send_signal(signal.SIGINT)
    said, complaint = viewer.communicate(timeout=30)
    assert viewer.returncode == 0 and not said and not complaint.strip()
