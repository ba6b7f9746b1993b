"""`s3le guard` on every layout: what comes out is certified, and then stays."""

import numpy as np
import pytest
from command import run
from guarding import snapshot
from layouts import KINDS

from s3le.cli import shell
from s3le.guard.layouts.door import open_layout
from s3le.robot.robot import Robot
from s3le.safety import audit


@pytest.mark.parametrize("kind", KINDS)
def test_every_layout_comes_out_certified_and_then_stays(tmp_path, kind):
    it = KINDS[kind]
    if kind == "hdf5":
        pytest.importorskip("h5py")
    robot, words = Robot.load(it.robot), ["--robot", it.robot, "--jobs", 1]
    for option, value in it.options.items():
        given = ",".join(value) if option == "joints" else value
        words += [f"--{option}"] if value is True else [f"--{option}", given]
    (tmp_path / "was").mkdir()
    source = it.make(tmp_path / "was")
    layout = open_layout(source, robot, **it.options)
    wide = [np.clip(3.0 * (one.q - robot.anchor) + robot.anchor, -3, 3) for one in layout.episodes]
    target = tmp_path / "in" / source.name
    target.parent.mkdir()
    layout.write(target, wide)
    assert run("guard", target, *words, "--check").exit_code == shell.BROKEN
    said = run("guard", target, *words, "--out", tmp_path / "out")
    assert said.exit_code == shell.OK, said.output
    came = open_layout(tmp_path / "out" / source.name, robot, **it.options)
    wanted = audit.demands(robot, acceleration=60.0)
    for one in came.episodes:
        assert audit.audit(robot, one.time, one.q, wanted).holds
    again = run("guard", tmp_path / "out" / source.name, *words, "--out", tmp_path / "twice")
    assert again.exit_code == shell.OK and " 0.0 % touched" in again.output
    if it.same:
        assert snapshot(tmp_path / "out").keys() == snapshot(tmp_path / "twice").keys()
    twice = open_layout(tmp_path / "twice" / source.name, robot, **it.options)
    for one, two in zip(came.episodes, twice.episodes, strict=True):
        assert (one.q == two.q).all()
