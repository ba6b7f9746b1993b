"""The tour, command by command: whoever follows it sees no error."""

import re
import shlex
import signal
import subprocess
import urllib.request
from pathlib import Path

import browser
import numpy as np
import pytest
from command import ROOT
from filmed import REAL, film
from handmade import bvh, deepmimic, write
from streaming import DEFAULT, stored
from test_bundle import an_index
from worlds import coman

from s3le.cli.main import app
from s3le.retarget import exported
from s3le.video import process
from s3le.video.decode import Video

ESTIMATOR = ROOT / process.ENVIRONMENT
PAGES = ("README.md", "docs/tour.md", "docs/README.md", "docs/results.md")
README = (ROOT / "README.md").read_text(encoding="utf-8")
TOUR = (ROOT / "docs" / "tour.md").read_text(encoding="utf-8")
COMMANDS = "\n".join(re.findall(r"```\n(.*?)```", TOUR, re.S)).splitlines()
WANTS_VIDEO = "phone"

pytestmark = pytest.mark.wide


def blocks():
    """The tour's commands in order, those on a video apart from the others."""
    lines = [line for line in COMMANDS if line]
    return (
        [line for line in lines if WANTS_VIDEO not in line],
        [line for line in lines if WANTS_VIDEO in line],
    )


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """What a folder holds after `make repro`, with few poses, and a person's own clips."""
    folder = tmp_path_factory.mktemp("tour")
    skeleton = an_index(stored()[1])
    exported.save(folder / "data/retargeter", coman(), "skeleton", "l2", DEFAULT, skeleton, None)
    dance = deepmimic(*({8: [np.cos(a), np.sin(a), 0, 0]} for a in np.linspace(0, 0.6, 12)))
    write(folder / "data/downloads/demo/dance_b.txt", dance)
    rows = [[0, 0, 0, 0, 0, 0, -2 * k, 0, 0, 0, 0, 0] for k in range(12)]
    write(folder / "walk.bvh", bvh(rows, order="ZXY", step=f"{1 / 30:.9f}"))
    return folder


def run(line):
    """One line, as a shell would split it; the command line answers in this process."""
    from typer.testing import CliRunner

    program, *words = shlex.split(line)
    assert program == "s3le", line
    if words[0] == "view":
        viewed(words)
        return
    said = CliRunner().invoke(app, words)
    assert said.exit_code == 0, said.output


def viewed(words):
    """The viewer serves its page until it is told to end."""
    with browser.serving(*words[1:]) as (viewer, address):
        with urllib.request.urlopen(address, timeout=30) as page:
            assert page.status == 200
        viewer.send_signal(signal.SIGINT)
        assert viewer.wait(timeout=30) == 0


def made_by_make(line):
    return line.startswith("make ") or line == ". .venv/bin/activate"


def test_every_command_up_to_a_video_runs_as_it_is_written(place, monkeypatch):
    pytest.importorskip("viser")
    monkeypatch.chdir(place)
    lines = [line for line in blocks()[0] if not made_by_make(line)]
    assert len(lines) >= 6
    for line in lines:
        run(line)
    for name in ("strip.png", "dance.gif", "motions/walk.gmr.npz", "motions/walk.mjlab.csv"):
        assert (place / name).stat().st_size > 1000


@pytest.mark.skipif(
    not (REAL.is_file() and (ESTIMATOR / "bin" / "python").exists()),
    reason="needs make video and make videos",
)
def test_every_command_on_a_video_runs_as_it_is_written(place, monkeypatch):
    pytest.importorskip("viser")
    pictures = []
    for picture in Video(REAL).pictures():
        pictures.append(picture.rgb)
        if len(pictures) == 36:
            break
    film(place / "phone.mp4", pictures)
    (place / process.ENVIRONMENT).symlink_to(ESTIMATOR)
    monkeypatch.chdir(place)
    if not Path("motions/walk.parquet").exists():
        run("s3le retarget walk.bvh --out motions")
    lines = blocks()[1]
    assert len(lines) == 3
    for line in lines:
        run(line)
    assert Path("motions/phone.parquet").is_file()


@pytest.mark.parametrize("line", [line for line in blocks()[0] if made_by_make(line)])
def test_what_make_is_asked_for_it_knows(line):
    if line.startswith("make "):
        said = subprocess.run(
            ["make", "-n", *line.split()[1:]], cwd=ROOT, capture_output=True, text=True, check=False
        )
        assert said.returncode == 0, said.stderr


@pytest.mark.parametrize("page", PAGES)
def test_every_picture_and_page_that_is_shown_is_there(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    named = re.findall(r"\]\(([^)#]+\.(?:png|gif|svg|md|html|cff))\)", text)
    assert named
    for path in named:
        file = (ROOT / page).parent / path
        assert file.is_file(), f"{page} shows {path}"
        assert file.stat().st_size < 1_500_000


def test_the_readme_is_short():
    """At most 700 words before the index of documents, and at most eight rows of numbers."""
    assert len(README.split("\n## Documents")[0].split()) <= 700
    numbers = README.split("\n## Numbers\n")[1].split("\n## ")[0]
    assert len([line for line in numbers.splitlines() if line.startswith("| ")]) <= 1 + 8
