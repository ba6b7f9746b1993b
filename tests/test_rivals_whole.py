"""Rivals that follow whole people, limits of acceleration, and the repair of what rivals make."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from rivalled import SHARED, made_of, opened, task_of
from streaming import motion, retargeter
from test_guard_curves import hurried
from worlds import coman

from s3le import Robot, retargeter_for
from s3le.errors import CertificateError
from s3le.guard.layouts.episode import Episode
from s3le.plan.limits import accelerations, limits

rooms = pytest.fixture(scope="module")(opened)
CLONES = os.environ.get("S3LE_RIVALS_CLONES", "")  # folder with GMR, newton-assets, ...
PUNCH = SHARED / "other/deepmimic/humanoid3d_punch.txt"


def skeletons(n, seed=4):
    """Skeletons of upright people, arms anywhere: (n, 21)."""
    u = np.random.default_rng(seed).normal(size=(n, 7, 3))
    u[:, 0] = [0.0, 0.0, 1.0] + 0.3 * u[:, 0]
    u[:, 1], u[:, 4] = [0.0, -1.0, 0.0] + 0.2 * u[:, 1], [0.0, 1.0, 0.0] + 0.2 * u[:, 4]
    return (u / np.linalg.norm(u, axis=2, keepdims=True)).reshape(n, 21)


# --- the person that stands


def test_turns_of_a_person_bring_its_bones_along_the_skeleton(rooms):
    turned = rooms.person.Turned()
    for x in skeletons(50):
        u, made = x.reshape(7, 3), turned.step(x)
        np.testing.assert_allclose(made.chest[:, 2], u[0], atol=1e-9)
        for side, (first, aside) in rooms.person.SIDES.items():
            rest, hinge = np.array([0.0, aside, 0.0]), np.array([0.0, 0.0, -aside])
            upper, fore = made.upper[side], made.fore[side]
            np.testing.assert_allclose(upper @ rest, u[first + 1], atol=1e-9)
            np.testing.assert_allclose(fore @ rest, u[first + 2], atol=1e-9)
            for turn in (made.chest, upper, fore):
                np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
                assert np.linalg.det(turn) > 0.0
            across = np.cross(u[first + 1], u[first + 2])
            if np.linalg.norm(across) > 0.5:  # bent: the forearm turns about the elbow's hinge
                assert across @ (upper @ hinge) / np.linalg.norm(across) > 0.9
        assert (made.of("L_Elbow") == made.of("L_Wrist")).all()
        assert (made.of("Pelvis") == np.eye(3)).all() and (made.of("R_Knee") == np.eye(3)).all()
        assert (made.of("Spine3") == made.chest).all()


def test_the_hinge_of_a_straight_arm_stays_as_it_was(rooms):
    still = skeletons(1)[0].reshape(7, 3)
    still[2] = [0.0, -1.0, 0.0]
    turned, seen = rooms.person.Turned(), []
    for angle in (1.2, 0.02, -0.02, 0.02, -0.02):  # [rad], of the elbow: noise about straight
        still[3] = [np.sin(angle), -np.cos(angle), 0.0]
        seen.append(turned.step(still.ravel()).upper["R"])
    for turn in seen[1:]:
        off = np.arccos(np.clip((np.trace(turn @ seen[0].T) - 1.0) / 2.0, -1.0, 1.0))
        assert off < np.radians(30.0)


def test_a_person_has_the_bones_of_the_skeleton(rooms):
    for x, at in zip(skeletons(5), rooms.person.points(skeletons(5)), strict=True):
        place = dict(zip(rooms.person.JOINTS, at, strict=True))
        for a, b, bone in (("Pelvis", "Neck", 0), ("R_Shoulder", "R_Elbow", 2),
                           ("L_Elbow", "L_Wrist", 6)):  # fmt: skip
            way = place[b] - place[a]
            np.testing.assert_allclose(way / np.linalg.norm(way), x.reshape(7, 3)[bone], atol=1e-9)
        assert place["L_Foot"][2] < 0.05 and place["Pelvis"][1] == 0.0


# --- who follows it


@pytest.mark.parametrize(("key", "part"), [("gmr", "GMR"), ("soma", "newton-assets")])
def test_who_has_no_clone_is_named_with_the_reason(rooms, tmp_path, key, part):
    one = rooms.entrants.by_key(key)[0]
    for folder in (None, tmp_path):
        assert rooms.run.missing(one, folder) == (
            f"no clone of it: --clones FOLDER with {part} in it"
        )
    told = rooms.run.about([], None, ["coman"], 45, [2], False, [])["not_run"]
    assert told[one.label].startswith("no clone of it")


@pytest.mark.wide
@pytest.mark.parametrize("key", ["gmr", "soma"])
def test_tools_for_whole_bodies_follow_a_person(rooms, tmp_path, key):
    one = rooms.entrants.by_key(key)[0]
    if not CLONES or (why := rooms.run.missing(one, Path(CLONES))):
        pytest.skip(why if CLONES else "S3LE_RIVALS_CLONES names no folder of clones")
    if not PUNCH.is_file():
        pytest.skip("no motions beside the checkout")
    its = retargeter_for(Robot.load("g1"))
    every = {2: rooms.tasks.clips(its, [PUNCH], "own", 12, 2)}
    todo = rooms.run.jobs([one], "g1", every, tmp_path, Path(CLONES))
    rooms.run.make(todo, "g1", tmp_path, 1, Path(CLONES))
    court = rooms.verdict.Court(Robot.load("g1"))
    first, again = [dict(np.load(job.out)) for job in todo]
    said = court.judge(every[2][0], first, repair=False)
    assert said["frames"] == 12 and said["failed"] == 0 and said["outside"] == 0
    assert said["angle"] < 8.0  # [deg]; a wrong frame of one joint makes tens of degrees
    assert np.ptp(first["q"], axis=0).max() > np.radians(5.0)
    assert (first["q"] == again["q"]).all()
    assert one.clone[0] in json.loads(str(first["about"]))["about"]  # its commit is told


# --- limits of acceleration


@pytest.mark.wide
@pytest.mark.parametrize("key", ["pink", "embodik", "roboplan"])
def test_rivals_that_are_asked_for_it_keep_limits_of_acceleration(rooms, tmp_path, key):
    one = rooms.entrants.by_key(key)[0]
    assert one.accelerations
    if why := rooms.run.missing(one, None):
        pytest.skip(why)
    task, most = task_of(rooms, motion(40)), limits(coman()).acceleration
    plain = {"closest": 0, "rows": 0, "solves": 1, "steps": 1}
    hard = []
    for turn, settings in enumerate((plain, plain | {"accelerations": True})):
        out = tmp_path / f"{turn}.npz"
        job = rooms.run.Job(one, settings, "coman", task, 1, turn, out)
        rooms.run.make([job], "coman", tmp_path, 1, None)
        with np.load(out) as made:
            bent = np.abs(accelerations(task.time, made["q"]))
        hard.append(int((bent > 1.1 * most).any(axis=1).sum()))
    assert hard[0] > 10 and hard[1] <= hard[0] // 5  # to the tolerance of a solver of programs


def test_what_limits_of_acceleration_cost_is_on_the_page(rooms):
    told = rooms.entrants.accelerations()
    assert set(told) == {one.label for one in rooms.entrants.ENTRANTS if one.accelerations}
    record = {"about": {"accelerations": told}}
    lines = rooms.book._costs(record)
    without, asked = told["pink"]["coman"]
    assert asked["hard"] < without["hard"]
    assert f"pink on coman: angle {without['angle']:.1f} to {asked['angle']:.1f}°" in lines[0]


# --- repair


def test_repair_writes_files_that_have_a_place_for_speeds(rooms, monkeypatch):
    court = rooms.verdict.Court(coman())
    seen: list[Episode] = []
    plain = court.guard.nearest
    monkeypatch.setattr(court.guard, "nearest", lambda one: seen.append(one) or plain(one))
    said = court.judge(task_of(rooms, motion(12)), made_of(hurried()))
    assert all(one.pace is not None for one in seen) and seen
    assert said["repair_refused"] == 0 and said["repair_left"] == 0 and said["repair_moved"] > 0


def test_what_the_guard_refuses_is_told_by_kind(rooms, monkeypatch):
    court = rooms.verdict.Court(coman())

    def refuse(episode):
        raise CertificateError(
            f"{episode.name}: what would be written does not hold: 0.3 s (row 9): LElbj turns at "
            "4.013 rad/s of 4"
        )

    monkeypatch.setattr(court.guard, "nearest", refuse)
    said = court.judge(task_of(rooms, motion(12)), made_of(hurried()))
    assert said["repair_refused"] == 1 and said["repair_why"] == "a joint would turn too fast"
    assert rooms.verdict._kind("the disk is full") == "the disk is full"
    case = rooms.sums.Case("mink", "mink", "coman", 1, "c", "cmu", 12, said, {}, None)
    row = rooms.sums.record([case, case], {}, {})["rows"][0]
    assert rooms.book._degrees(row) == "2 of 2 refused: 2 x a joint would turn too fast"


# --- clips, and what is kept


def test_a_clip_that_cannot_be_read_is_left_out_and_named(rooms, tmp_path, capsys):
    if not PUNCH.is_file():
        pytest.skip("no motions beside the checkout")
    bad = tmp_path / "fight1_subject2.bvh"
    bad.write_text("HIERARCHY\nROOT Hips\n{ cut")
    for _ in range(2):
        made = rooms.tasks.clips(retargeter(), [bad, PUNCH], "lafan", 10, 1)
        assert [one.name for one in made] == ["humanoid3d_punch"] and len(made[0].x) == 10
    assert capsys.readouterr().err.count("left out: ") == 1
    assert rooms.run.recordings(tmp_path) == [bad] and rooms.run.recordings(None) == []
    with pytest.raises(SystemExit, match="no .bvh is in"):
        rooms.run.recordings(tmp_path / "none")


def test_another_environment_leaves_motions_as_they_are(rooms, monkeypatch, tmp_path):
    mink, pyroki = rooms.entrants.by_key("mink,pyroki")
    task = task_of(rooms, motion(5))

    def keys(text):
        (tmp_path / "a.lock").write_text(text)
        monkeypatch.setattr(rooms.install, "LOCK", tmp_path / "a.lock")
        rooms.kept._code.cache_clear()
        return [rooms.kept.motion(one, {}, "coman", task, 2) for one in (mink, pyroki)]

    before = keys("[field]\nmink==1.3.0\n[jax]\njax==0.8.0\n")
    after = keys("[field]\nmink==1.3.0\n[jax]\njax==0.9.0\n[soma]\nnewton==1.0.0\n")
    assert before[0] == after[0] and before[1] != after[1]
    rooms.kept._code.cache_clear()


def test_a_clone_is_known_by_its_code_and_its_settings(rooms, tmp_path):
    (tmp_path / "a.py").write_text("1")
    (tmp_path / "a.json").write_text("{}")
    before = rooms.kept.clone([tmp_path])
    (tmp_path / "picture.png").write_bytes(b"1")
    assert rooms.kept.clone([tmp_path]) == before
    (tmp_path / "a.json").write_text("{ }")
    assert rooms.kept.clone([tmp_path]) != before


def test_the_commit_of_a_clone_is_told(rooms, tmp_path):
    clone, copy = tmp_path / "tool", tmp_path / "copy"
    (clone / "src").mkdir(parents=True)
    copy.mkdir()
    git = ["git", "-C", str(clone), "-c", "user.name=a", "-c", "user.email=a@b"]
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "commit", "-q", "--allow-empty", "-m", "first"], check=True)
    told = subprocess.run([*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True)
    found = rooms.solvers.commits([str(clone / "src"), str(copy)])
    assert set(found) == {"tool"} and told.stdout.startswith(found["tool"])
    assert len(found["tool"]) >= 7
