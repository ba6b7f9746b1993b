"""Finer bodies: they stand for their link in the pairs that ask for them, and in no other."""

import pytest
from worlds import MARGIN, ROBOTS, edited

from s3le.errors import RobotError
from s3le.robot.pairs import KEPT, OTHERWISE
from s3le.robot.robot import Robot

URDF = (ROBOTS / "urdf" / "coman_covered.urdf").read_text(encoding="utf-8")
YAML = (ROBOTS / "coman_covered.yaml").read_text(encoding="utf-8")
PAIR = "finer: [[DWYTorso, Waist]]\n"
PLAIN = edited(YAML, (PAIR, ""))


def made(folder, yaml=YAML, urdf=URDF):
    (folder / "urdf").mkdir(parents=True, exist_ok=True)
    (folder / "urdf" / "coman_covered.urdf").write_text(urdf, encoding="utf-8")
    (folder / "coman_covered.yaml").write_text(yaml, encoding="utf-8")
    return Robot.from_file(folder / "coman_covered.yaml", MARGIN)


def of(robot, a, b):
    """Reasons of all pairs of bodies of two links: (fine or not, fine or not) -> reasons."""
    found = {}
    for pair in robot.pairs:
        one, other = sorted((robot.bodies[pair.a], robot.bodies[pair.b]), key=lambda x: x.link)
        if (one.link, other.link) == tuple(sorted((a, b))):
            found.setdefault((one.fine, other.fine), set()).add(pair.reason)
    return found


def test_a_pair_that_asks_is_watched_by_the_finer_bodies_and_others_by_the_usual_ones(tmp_path):
    robot = made(tmp_path)
    assert sum(body.fine for body in robot.bodies) == 15
    asked = of(robot, "DWYTorso", "Waist")
    assert asked[False, False] == {OTHERWISE} and asked[True, True] <= set(KEPT)
    assert asked[True, False] == asked[False, True] == {OTHERWISE}
    other = of(robot, "DWYTorso", "LForearm")
    assert other[False, False] == {"watched"} and other[True, False] == {OTHERWISE}
    assert not any("by other bodies" in why for *_, why in robot.unwatched())


def test_it_is_another_robot(tmp_path):
    digests = {
        made(tmp_path / "a").digest,
        made(tmp_path / "b", PLAIN).digest,
        made(tmp_path / "c", urdf=URDF.replace('"fine"', '"other"', 1)).digest,
    }
    assert len(digests) == 3


def test_a_robot_that_is_sent_keeps_them(tmp_path):
    robot = made(tmp_path)
    again = Robot.from_bytes(robot.to_bytes())
    assert again.pairs == robot.pairs and again.digest == robot.digest


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("finer: [[LForearm, RForearm]]\n", 'of which neither has a <collision name="fine">'),
        ("finer: [[DWYTorso, Wasit]]\n", "finer names 'Wasit', which is no link of"),
        ("finer: [[DWYTorso]]\n", "finer must be pairs of links"),
        ("finer: [DWYTorso, Waist]\n", "finer must be pairs of links"),
        ("finer: DWYTorso\n", "finer must be pairs of links"),
        ("finer: [[1, Waist]]\n", "finer must be pairs of links"),
    ],
)
def test_what_cannot_be_meant_is_refused(tmp_path, text, words):
    with pytest.raises(RobotError) as refusal:
        made(tmp_path, PLAIN + text)
    assert words in str(refusal.value) and str(tmp_path) in str(refusal.value)


def test_a_link_with_finer_bodies_alone_is_refused(tmp_path):
    link = '<link name="LForearm">\n    <collision'
    only = edited(URDF, (link, f'{link} name="fine"'))
    with pytest.raises(RobotError, match="link 'LForearm' has bodies that are `fine` and no other"):
        made(tmp_path, PLAIN, only)
