"""Which pairs of bodies are watched, which are not and why, and that the anchor is feasible."""

import re
from itertools import combinations

import numpy as np
import pytest
from worlds import (
    ARMS_URDF,
    ARMS_YAML,
    MARGIN,
    ROBOTS,
    coal_distance,
    coman,
    edited,
    placed,
    write_arms,
)

from s3le.errors import RobotError
from s3le.robot.pairs import FIXED, OVERLAP, WATCHED, all_pairs, body_kinds
from s3le.robot.robot import PAIRS, Robot
from s3le.robot.table import ROBOT_PAIRS

GEOMETRY = 1e-9  # [m]
NAMES = ("coman", "coman_authors")


def named(made: Robot, reason: str, kind: str | None = None) -> set[frozenset[str]]:
    links = [body.name.rpartition("_")[0] for body in made.bodies]
    return {
        frozenset((links[p.a], links[p.b]))
        for p in made.pairs
        if p.reason == reason and kind in (None, p.kind)
    }


@pytest.mark.parametrize("name", NAMES)
def test_every_pair_of_bodies_is_listed_once_in_order(name):
    made = coman(name=name)
    listed = [(p.a, p.b) for p in made.pairs]
    assert listed == list(combinations(range(len(made.bodies)), 2))


@pytest.mark.parametrize("name", NAMES)
def test_watched_and_dropped_are_all_pairs_and_each_has_a_reason(name):
    made = coman(name=name)
    reasons = [p.reason for p in made.pairs]
    assert set(reasons) == {WATCHED, FIXED, OVERLAP}
    assert len(made.watched) + reasons.count(FIXED) + reasons.count(OVERLAP) == len(reasons)
    assert [tuple(pair) for pair in made.watched] == [
        (p.a, p.b) for p in made.pairs if p.reason == WATCHED
    ]


def test_the_only_limb_trunk_pairs_that_are_dropped_are_torso_and_shoulders():
    made = coman()
    assert named(made, OVERLAP, "limb-trunk") == {
        frozenset(("DWYTorso", link)) for link in ("LShp", "LShr", "RShp", "RShr")
    }
    assert named(made, FIXED, "limb-trunk") == set()
    assert named(made, OVERLAP, "limb-limb") == set()


def test_forearms_hands_and_upper_arms_are_watched_against_all_of_the_trunk():
    made = coman()
    kinds = body_kinds(made)
    links = [body.name.rpartition("_")[0] for body in made.bodies]
    trunk = {link for link, kind in zip(links, kinds, strict=True) if kind == "trunk"}
    watched = named(made, WATCHED)
    for side in "LR":
        for limb in ("Shy", "Elb", "Forearm", "WrMot2", "WrMot3", "SoftHand"):
            for link in trunk:
                assert frozenset((side + limb, link)) in watched, (side + limb, link)


def test_what_cannot_move_is_not_watched_and_what_can_is_not_called_fixed():
    made = coman()
    for p in made.pairs:
        same = made.bodies[p.a].joint == made.bodies[p.b].joint
        assert (p.reason == FIXED) == same


def test_arms_are_right_or_left_and_the_rest_is_trunk():
    made = coman()
    for body, kind in zip(made.bodies, body_kinds(made), strict=True):
        arm = any(part in body.name for part in ("Sh", "Elb", "Forearm", "Wr", "SoftHand"))
        assert kind == ({"L": "left", "R": "right"}[body.name[0]] if arm else "trunk"), body.name


def test_the_stated_clearance_is_the_distance_at_the_anchor():
    made = coman()
    ends = placed(made, made.anchor)[3]
    for p in made.pairs:
        radii = (made.bodies[p.a].radius, made.bodies[p.b].radius)
        want = coal_distance(ends[p.a, :2], ends[p.b, :2], *radii)
        assert p.clearance == pytest.approx(want, abs=GEOMETRY)


def test_a_pair_is_dropped_exactly_where_grown_capsules_overlap():
    made = coman()
    ends = placed(made, made.anchor)[3]
    grow = made.pair_inflation
    for p in made.pairs:
        if p.reason == FIXED:
            continue
        grown, radii = [], []
        for body in (p.a, p.b):
            middle = ends[body, :2].mean(axis=0)
            grown.append(middle + (ends[body, :2] - middle) * grow)
            radii.append(made.bodies[body].radius * grow)
        assert (coal_distance(*grown, *radii) <= 0.0) == (p.reason == OVERLAP), p


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("margin", [0.0, MARGIN, 0.01], ids=["0", "2 mm", "10 mm"])
def test_the_anchor_is_feasible(name, margin):
    made = coman(margin, name)
    made.certifier().require(made.anchor[None], margin)


def test_more_inflation_never_watches_more(tmp_path):
    watched = []
    for grow in ("1.0", "1.1", "1.5", "2.5"):
        file = write_arms(tmp_path / grow, edited(ARMS_YAML, ("1.1", grow)))
        watched.append({tuple(pair) for pair in Robot.from_file(file, MARGIN, "midpoint").watched})
    assert all(more >= fewer for more, fewer in zip(watched, watched[1:], strict=False))
    assert watched[0] > watched[-1]


def test_an_anchor_that_collides_is_refused_with_the_pair(tmp_path):
    inward = edited(ARMS_YAML, ("r_shoulder: -1.5", "r_shoulder: -0.3, r_elbow: 2.0"))
    with pytest.raises(RobotError) as refusal:
        Robot.from_file(write_arms(tmp_path, inward), MARGIN, "midpoint")
    assert str(refusal.value) == (
        f"{tmp_path / 'arms.yaml'}: at the anchor body_0 and r_lower_0 overlap by 39.68 mm; "
        "give an anchor that does not collide"
    )


def test_an_anchor_with_its_hands_in_each_other_is_refused(tmp_path):
    crossed = edited(
        ARMS_YAML, ("r_shoulder: -1.5, l_shoulder: 1.5", "r_shoulder: 0.6, l_shoulder: -0.6")
    )
    long = edited(ARMS_URDF, ('xyz="0 0 0.25"', 'xyz="0.5 0 0.25"'))
    with pytest.raises(RobotError, match="at the anchor l_lower_0 and r_lower_0 overlap by"):
        Robot.from_file(write_arms(tmp_path, crossed, long), MARGIN, "midpoint")


def test_an_anchor_closer_than_the_margin_is_refused_with_the_pair(tmp_path):
    with pytest.raises(RobotError) as refusal:
        Robot.from_file(write_arms(tmp_path), 0.5, "midpoint")
    assert re.fullmatch(
        r".*/arms.yaml: at the anchor \w+ and \w+ are \d+\.\d\d mm apart, the margin is 500 mm; "
        "give another anchor or a smaller margin",
        str(refusal.value),
    )


def test_coman_with_its_arms_down_is_no_anchor(tmp_path):
    text = (ROBOTS / "coman.yaml").read_text()
    down = re.sub(r"anchor: \{.*\}", "anchor: {}", text).replace(
        "urdf/coman.urdf", str(ROBOTS / "urdf" / "coman.urdf")
    )
    (tmp_path / "coman.yaml").write_text(down)
    with pytest.raises(RobotError, match=r"at the anchor \w+ and \w+ overlap by [\d.]+ mm"):
        Robot.from_file(tmp_path / "coman.yaml", MARGIN, "midpoint")


def test_a_margin_that_the_anchor_just_keeps_is_taken_and_a_little_more_is_refused(tmp_path):
    file = write_arms(tmp_path)
    made = Robot.from_file(file, 0.0, "midpoint")
    kept = float(made.certifier().check(made.anchor[None]).clearance[0])
    Robot.from_file(file, kept, "midpoint")
    with pytest.raises(RobotError, match="give another anchor or a smaller margin"):
        Robot.from_file(file, np.nextafter(kept, 1.0), "midpoint")


@pytest.mark.parametrize("margin", [float("nan"), float("inf")], ids=str)
def test_a_margin_that_no_pose_can_keep_is_refused(tmp_path, margin):
    with pytest.raises(RobotError):
        Robot.from_file(write_arms(tmp_path), margin, "midpoint")


def test_a_robot_of_which_no_pair_is_left_is_refused(tmp_path):
    urdf = re.sub(r"<collision>.*?</collision>", "", ARMS_URDF, count=4, flags=re.DOTALL)
    with pytest.raises(RobotError) as refusal:
        Robot.from_file(write_arms(tmp_path, urdf=urdf), MARGIN, "midpoint")
    file = tmp_path / "arms.yaml"
    assert str(refusal.value) == f"{file}: no pair of bodies is left to watch at this anchor"


def test_the_readable_list_names_every_pair_with_its_reason(tmp_path):
    from s3le.store import tables

    coman().write(tmp_path)
    rows = tables.read(ROBOT_PAIRS, tmp_path / PAIRS, coman().tag)
    assert len(rows["reason"]) == len(coman().pairs)
    assert set(rows["reason"]) == {WATCHED, FIXED, OVERLAP}


def test_the_decision_is_the_same_each_time():
    assert all_pairs(coman()) == all_pairs(coman())
