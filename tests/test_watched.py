"""What `robot new` watches: the robot stands and moves, and no more than it must is passed over."""

from types import SimpleNamespace

import numpy as np
import pytest
from figures import figure
from onboarded import new
from worlds import MARGIN

from s3le.cli import audit
from s3le.onboard import stand, tight, touching
from s3le.robot import pairs

FAT = figure(torso='<box size="0.3 0.24 0.3"/>')  # one capsule of it reaches the hanging arms


def clear(robot, q):
    return robot.certifier().one(q)[0]


def fine(robot):
    return [body for body in robot.bodies if body.fine]


def test_usual_bodies_that_forbid_the_stand_get_finer_ones_in_those_pairs_alone(tmp_path):
    robot = new(tmp_path, FAT, most=1).robot
    asked = robot.description.finer
    assert asked and fine(robot) and {body.link for body in fine(robot)} <= set().union(*asked)
    assert clear(robot, robot.stand) >= MARGIN
    assert robot.description.baselines
    assert not any(why == pairs.OVERLAP for *_, why in robot.unwatched())


def test_a_robot_whose_usual_bodies_do_has_no_others(tmp_path):
    pelvis = '<box size="0.14 0.2 0.12"/>', '<capsule radius="0.07" length="0.06"/>'
    thin = figure(torso='<capsule radius="0.08" length="0.1"/>', legs=False).replace(*pelvis)
    robot = new(tmp_path, thin).robot
    assert not fine(robot) and not robot.description.finer
    assert clear(robot, robot.stand) >= MARGIN


def test_finer_bodies_that_would_lock_it_all_the_same_are_taken_back_and_the_pair_off(
    tmp_path, monkeypatch
):
    before = new(tmp_path / "a", FAT, most=1).robot
    monkeypatch.setattr(touching, "LOCKED", -1.0)  # one lost pose in a hundred locks nothing here
    monkeypatch.setattr(touching, "LOST", -1.0)
    made = new(tmp_path / "b", FAT, most=1)
    taken = {pair for pair, why in made.robot.disabled.items() if "for nothing" in why}
    assert taken & before.description.finer
    assert not taken & made.robot.description.finer
    assert len(fine(made.robot)) < len(fine(before))
    names = [" and ".join(sorted(pair)) for pair in taken]
    assert all(any(line.startswith(f"{name} are taken off") for line in made.proposal.look)
               for name in names)  # fmt: skip


def test_where_bodies_forbid_the_stand_all_the_same_arms_hang_farther_outwards(
    tmp_path, monkeypatch
):
    free = new(tmp_path / "a", FAT, most=1)
    monkeypatch.setattr(tight.Work, "tighten", lambda *_: (set(), []))
    held = new(tmp_path / "b", FAT, most=1)
    assert not fine(held.robot)
    assert clear(held.robot, free.robot.stand) < MARGIN <= clear(held.robot, held.robot.stand)
    down = [stand.hanging(robot, robot.stand) for robot in (free.robot, held.robot)]
    assert down[0] > down[1] > stand.HANGS
    assert any(line.startswith("stand: arms hanging, ") for line in held.proposal.sure)


@pytest.mark.parametrize(
    ("reason", "shared", "own"),
    [
        ("disabled by the SRDF (touch; watched, 62% of poses would be forbidden)", ..., ""),
        ("overlap at the anchor, and given joints alone move them", ..., ""),
        ("neighbours on both sides of a joint, seen to overlap by 1 to 3 mm over its range",
         "neighbours on both sides of a joint", ": seen to overlap by 1 to 3 mm over its range"),
        ("overlap by design, proven so, 12.1 mm deep", "overlap by design, proven so",
         ": 12.1 mm deep"),
    ],
)  # fmt: skip
def test_the_audit_tells_a_reason_once_and_the_numbers_of_each_pair(reason, shared, own):
    robot = SimpleNamespace(unwatched=lambda: [("a", "b", "", reason), ("a", "c", "", reason)])
    shared = reason if shared is ... else shared
    assert audit._closing(robot, [], [])[:3] == [
        f"not covered, 2 pairs ({shared}):", f"  a and b{own}", f"  a and c{own}"
    ]  # fmt: skip


@pytest.mark.parametrize("lost", [0.05, 0.2])
def test_what_is_off_says_why(lost):
    apart = touching.Locked(frozenset("ab"), 0.3, lost, (0.012, -0.004))
    assert apart.off == (lost > touching.LOST) and not apart.touches
    word = "would be" if apart.off else "are"
    assert apart.why() == (
        "bodies overlap where drawings are 12 mm apart (they overlap by up to 4 mm); watched, "
        f"{lost:.0%} of poses {word} forbidden for nothing"
    )
    built = apart._replace(gap=(0.001, -0.02))
    assert built.off and "touch by design" in built.why()


def test_how_far_bodies_reach_is_no_reason_for_a_worse_beginning(tmp_path):
    made = new(tmp_path, FAT, most=4, finer=True)
    usual, finer = ([b for b in made.robot.bodies if b.link == "waist_pitch_link" and b.fine == f]
                    for f in (False, True))  # fmt: skip
    assert len(finer) >= len(usual) > 1
    assert np.max([b.radius for b in finer]) <= np.max([b.radius for b in usual]) + 1e-9
