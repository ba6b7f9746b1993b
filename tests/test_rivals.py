"""The benchmark of the field: all entrants are told the same, and what breaks is called so."""

import json
import sys
import xml.etree.ElementTree as ElementTree

import coal
import numpy as np
import pinocchio as pin
import pytest
from rivalled import ROOT, made_of, opened, task_of
from streaming import motion, retargeter
from worlds import coman, inside_limits

from s3le.kernels import batch

rooms = pytest.fixture(scope="module")(opened)


@pytest.fixture(scope="module")
def court(rooms):
    return rooms.verdict.Court(coman())


def colliding(n, seed=3):
    q = inside_limits(coman(), 4000, seed)
    return q[batch.clearances(coman().chain, q) < -0.01][:n]


# --- what entrants are told


def test_plain_robot_has_the_skeleton_of_the_robot(rooms):
    robot, told = coman(), rooms.tasks.plain_of(coman())
    for q in inside_limits(robot, 20, 1):
        at = told.where(q)
        x = batch.skeletons(robot.chain, q[None])[0].reshape(7, 3)
        for bone, (a, b) in {2: ("r_shoulder", "r_elbow"), 6: ("l_elbow", "l_hand")}.items():
            way = told.base_rotation @ (at[b] - at[a])
            np.testing.assert_allclose(way / np.linalg.norm(way), x[bone], atol=1e-12)


def test_plain_robot_survives_its_file(rooms, tmp_path):
    told = rooms.tasks.plain_of(coman())
    (tmp_path / "robot.json").write_text(json.dumps(rooms.plain.dump(told)))
    assert rooms.plain.dump(rooms.plain.load(tmp_path / "robot.json")) == rooms.plain.dump(told)


def test_goals_of_a_pose_are_where_its_points_are(rooms):
    robot, told = coman(), rooms.tasks.plain_of(coman())
    q = inside_limits(robot, 8, 2)
    q[:, :3] = robot.anchor[:3]  # the waist's bones keep their angles to each other there
    for pose, goal in zip(q, told.goals(batch.skeletons(robot.chain, q)), strict=True):
        at = told.where(pose)
        for row, role in enumerate(rooms.plain.POINTS):
            np.testing.assert_allclose(goal.points[row], at[role], atol=1e-3)


def test_hands_turn_with_their_forearms(rooms):
    told = rooms.tasks.plain_of(coman())
    x = batch.skeletons(coman().chain, coman().anchor[None])
    turn, _ = told.frames(told.anchor)
    goal = told.goals(x)[0]
    np.testing.assert_allclose(goal.turns[0], turn[told.points["r_hand"].joint], atol=1e-6)
    for goal in told.goals(motion(20)):
        np.testing.assert_allclose(goal.turns @ goal.turns.transpose(0, 2, 1), [np.eye(3)] * 2,
                                   atol=1e-9)  # fmt: skip


def test_written_robot_is_the_same_robot_in_another_reader(rooms):
    robot, told = coman(), rooms.tasks.plain_of(coman())
    written = rooms.plain.Writer(told).pieces
    model = pin.buildModelFromXML(written.text)
    geometry = pin.buildGeomFromUrdfString(model, written.text, pin.GeometryType.COLLISION)
    assert list(model.names)[1:] == told.names
    np.testing.assert_array_equal(model.lowerPositionLimit, robot.lower)
    pieces = {}
    for i, item in enumerate(geometry.geometryObjects):
        pieces.setdefault(int(item.name.split("_")[1]), []).append(i)
    data, placed = model.createData(), pin.GeometryData(geometry)
    q = inside_limits(robot, 1, 5)[0]
    pin.updateGeometryPlacements(model, data, geometry, placed, q)
    known = batch.pair_distances(robot.chain, q[None])[0]
    for row in range(0, len(known), 25):
        a, b = told.watched[row]
        least = min(
            coal.distance(
                geometry.geometryObjects[i].geometry, placed.oMg[i],
                geometry.geometryObjects[k].geometry, placed.oMg[k],
                coal.DistanceRequest(), coal.DistanceResult(),
            )
            for i in pieces[a] for k in pieces[b]
        )  # fmt: skip
        if min(least, known[row]) > 0.0:  # how deep is each library's own business
            np.testing.assert_allclose(least, known[row], atol=2e-5)


def test_capsules_can_be_written_as_they_are(rooms):
    told = rooms.tasks.plain_of(coman())
    text = rooms.plain.Writer(told).capsules.text
    root = ElementTree.fromstring(text)
    assert root.get("version") == "1.2"
    shapes = [
        link.find("collision/geometry")[0]
        for link in root.iter("link")
        if link.get("name").startswith("body_")
    ]
    assert len(shapes) == len(told.bodies)
    for shape, body in zip(shapes, told.bodies, strict=True):
        length = float(np.linalg.norm(body.b - body.a))
        assert float(shape.get("radius")) == body.radius
        assert float(shape.get("length", 0.0)) == pytest.approx(length, abs=1e-9)


def test_frames_that_are_none_are_the_one_before(rooms):
    x = motion(6).copy()
    x[0], x[3], x[4, :3] = np.nan, 1e300, 0.0
    found = rooms.tasks.usable(x)
    np.testing.assert_allclose(np.linalg.norm(found.reshape(-1, 7, 3), axis=2), 1.0)
    np.testing.assert_allclose(found[0], found[1])
    np.testing.assert_allclose(found[3], found[2])
    np.testing.assert_allclose(found[4], found[2])


def test_all_start_at_a_pose_that_is_clear(rooms):
    its = retargeter()
    for protocol in (1, 2):
        for one in rooms.tasks.adversarial(its, 3, protocol):
            report = coman().certifier().check(one.start[None])
            assert report.clearance[0] >= coman().margin and report.limit_margin[0] >= 0.0
    assert (one.start == coman().anchor).all()


# --- who runs


def test_every_entrant_has_an_adapter_and_settings(rooms):
    chosen = json.loads(rooms.entrants.CHOSEN.read_text())["chosen"]
    for one in rooms.entrants.ENTRANTS:
        if one.module != "ours":
            assert (ROOT / f"benchmarks/rivals/solvers/{one.module}.py").is_file()
            assert one.key in chosen or 1 not in one.protocols
    assert not set(rooms.entrants.NOT_RUN) & {one.label for one in rooms.entrants.ENTRANTS}


def test_lock_has_an_environment_for_every_entrant(rooms):
    lines = rooms.install.sections((ROOT / "requirements-rivals.lock").read_text())
    for one in rooms.entrants.ENTRANTS:
        if one.module != "ours" and not one.clone:
            names = [line.split("==")[0].lower() for line in lines[one.environment].split()]
            assert set(one.packages) <= set(names)
    with pytest.raises(SystemExit, match="under no heading"):
        rooms.install.sections("mink==1.3.0\n[field]\n")


def test_an_entrant_that_is_not_there_is_told_and_left_out(rooms, monkeypatch, tmp_path):
    one = rooms.entrants.by_key("mink")[0]
    monkeypatch.setattr(rooms.run.install, "python", lambda name: tmp_path / name)
    assert "not set up: make rivals" in rooms.run.missing(one, None)
    assert "no clone" in rooms.run.missing(rooms.entrants.by_key("sew")[0], tmp_path)
    assert rooms.run.missing(rooms.entrants.by_key("file")[0], None) is None
    with pytest.raises(SystemExit, match="no entrant is called 'curobo'"):
        rooms.entrants.by_key("curobo")


def test_what_is_installed_for_ours_is_what_the_project_requires(rooms):
    names, own = rooms.run.own()
    assert {"coal", "numba", "pin"} <= set(names) and "torch" not in names and own > 1e6
    found = rooms.run.sizes(rooms.entrants.by_key("file"))["file"]
    assert 300.0 < found < 2000.0


def test_a_motion_is_kept_under_all_that_decides_it(rooms):
    mink, pink = rooms.entrants.by_key("mink,pink")
    task = task_of(rooms, motion(5))
    key = rooms.kept.motion(mink, {"solves": 1}, "coman", task, 1)
    assert key == rooms.kept.motion(mink, {"solves": 1}, "coman", task, 1)
    others = [
        rooms.kept.motion(mink, {"solves": 2}, "coman", task, 1),
        rooms.kept.motion(pink, {"solves": 1}, "coman", task, 1),
        rooms.kept.motion(mink, {"solves": 1}, "g1", task, 1),
        rooms.kept.motion(mink, {"solves": 1}, "coman", task._replace(digest="1" * 16), 1),
        rooms.kept.motion(mink, {"solves": 1}, "coman", task, 2),
        rooms.kept.motion(mink, {"solves": 1}, "coman", task, 1, 1),
    ]
    assert len({key, *others}) == 7


# --- what is called broken


def test_colliding_poses_and_the_paths_to_them_are_broken(rooms, court):
    q = np.stack([coman().anchor, *colliding(2)])
    said = court.judge(task_of(rooms, motion(3)), made_of(q), repair=False)
    assert said["poses_broken"] == 2 and said["poses_denied"] == 0
    assert said["paths_broken"] == 2 and said["paths_unproven"] == 0
    assert said["depth_mm"] > 10.0


def test_a_path_through_the_body_is_broken_though_its_ends_are_clear(rooms, court):
    q = inside_limits(coman(), 3000, 8)
    q = q[batch.clearances(coman().chain, q) > 0.01]
    middle = batch.clearances(coman().chain, 0.5 * (q[:-1] + q[1:]))
    i = int(np.argmin(middle))
    assert middle[i] < -0.01
    said = court.judge(task_of(rooms, motion(2)), made_of(q[i : i + 2]), repair=False)
    assert said["poses_broken"] == 0 and said["paths_broken"] == 1
    assert said["fast"] == 1 and said["fastest"] > 1.0


def test_what_only_comes_near_is_unproven_not_broken(rooms, court):
    a, b = coman().anchor, colliding(1)[0]
    low, high = 0.0, 1.0
    for _ in range(60):  # to where the bodies are 0.2 mm apart: less than is proven, no collision
        share = 0.5 * (low + high)
        near = batch.clearances(coman().chain, ((1.0 - share) * a + share * b)[None])[0] > 2e-4
        low, high = (share, high) if near else (low, share)
    q = np.stack([(1.0 - low) * a + low * b, (1.0 - low) * a + low * b])
    q[1, 0] += 1e-7
    said = court.judge(task_of(rooms, motion(2)), made_of(q), repair=False)
    assert (said["paths_broken"], said["paths_unproven"]) == (0, 1)
    assert said["poses_broken"] == 0 and said["poses_near"] == 2


def test_hulls_of_meshes_are_a_judge_of_their_own(rooms, tmp_path):
    robot = coman()
    model, _ = robot.reduced()
    boxes = {}
    for k, body in enumerate(robot.bodies):  # half as thick as the capsules
        frame = model.frames[model.getFrameId(body.link, pin.FrameType.BODY)]
        corners = [
            frame.placement.actInv(end + 0.3 * body.radius * np.array(side))
            for end in (body.a, body.b + 1e-3)
            for side in np.ndindex(2, 2, 2)
        ]
        boxes[f"{body.link}/{k}"] = np.array(corners)
    np.savez(tmp_path / "hulls.npz", **boxes)
    court = rooms.verdict.Court(robot, tmp_path / "hulls.npz")
    assert "hulls" in court.others
    still = made_of(robot.anchor[None].repeat(2, 0))
    far = court.judge(task_of(rooms, motion(2)), still, repair=False)
    assert (far["hull_poses"], far["hull_paths"]) == (0, 0)
    q = colliding(200)
    nested = court.hulls.distances(robot.anchor[None])[0] < 0.0
    apart = court.hulls.distances(q)[:, ~nested].min(axis=1)
    deep = int(np.argmin(apart))
    assert apart[deep] < -1e-3
    near = made_of(np.stack([robot.anchor, q[deep]]))
    near = court.judge(task_of(rooms, motion(2)), near, repair=False)
    assert near["hull_poses"] == 1 and near["hull_paths"] == 1
    assert near["hull_depth_mm"] >= -1e3 * apart[deep] - 1e-6


def test_ours_is_whole_and_repaired_to_itself(rooms, court, monkeypatch):
    from importlib import import_module

    ours = import_module("ours")
    x = motion(40)
    for make in (ours.by_file, ours.by_stream):
        made = make(retargeter(), x, None)
        made["failed"] = np.zeros(len(x), bool)
        said = court.judge(task_of(rooms, x), made, repair=make is ours.by_file)
        assert said["poses_broken"] == said["paths_broken"] == said["paths_unproven"] == 0
        assert said["fast"] == said["outside"] == said["proven_broken"] == 0
        assert said["proven_probed"] > 0
        if make is ours.by_file:
            assert said["repair_moved"] == 0 and said["repair_left"] == 0
    monkeypatch.delitem(sys.modules, "ours")


def test_repair_leaves_nothing_of_a_broken_motion(rooms, court):
    from s3le.plan.limits import limits

    start, deep = coman().anchor, colliding(1)[0]
    share = np.sin(np.linspace(0.0, np.pi, 60))[:, None] ** 2
    q = start + share * (deep - start)
    assert np.isfinite(limits(coman()).speed).all()
    said = court.judge(task_of(rooms, motion(60)), made_of(q))
    assert said["poses_broken"] > 0
    assert said["repair_refused"] == 0 and said["repair_left"] == 0
    assert said["repair_moved"] > 0 and max(said["repair_off"]) > 1.0


def test_measures_of_motion(rooms, court):
    x = motion(30)
    q = np.repeat(coman().anchor[None], 30, axis=0)
    said = court.judge(task_of(rooms, x), made_of(q), repair=False)
    assert said["held"] == 29 and said["fast"] == 0 and max(said["jerk"]) == 0.0
    late = np.concatenate([x[:1].repeat(3, axis=0), x])[: len(x)]
    assert rooms.verdict._lag(late, x) == pytest.approx(3.0, abs=0.2)
    outside = q.copy()
    outside[4, 0] = coman().upper[0] + 0.1
    said = court.judge(task_of(rooms, x), made_of(outside), repair=False)
    assert said["outside"] == 1 and said["outside_most"] == pytest.approx(0.1)


# --- sums and the page


def case(rooms, key, clip, **said):
    known = {
        "frames": 10, "steps": 9, "failed": 0, "bones": {"hip_to_neck": 1.0}, "angle": 5.0,
        "angle_p95": 9.0, "far": 0.01, "trunk_off": 0, "lag_ms": 0.0, "outside": 0,
        "outside_most": 0.0, "fast": 0, "fastest": 0.5, "hard": 0, "acceleration": [1.0],
        "jerk": [2.0], "held": 0, "poses_broken": 0, "poses_denied": 0, "poses_near": 0,
        "depth_mm": 0.0, "paths_broken": 0, "paths_unproven": 0, "paths_depth_mm": 0.0,
        "proven_probed": 1, "proven_broken": 0, "hpp_heard": 0, "hpp_refused": 0,
        "us": [100.0] * 10, "repair_refused": 0, "repair_left": 0, "repair_moved": 0,
        "repair_off": [0.0] * 10,
    }  # fmt: skip
    about = {"about": {"tool": "1.0"}, "first": 2.0, "said": ""}
    label = {"file": "s3le, file", "mink": "mink <b>"}[key]
    return rooms.sums.Case(key, label, "coman", 1, clip, "cmu", 10, known | said, about, True)


def about(rooms):
    return {"quick": False, "frames": 240, "rate": 30.0, "entrants": {}, "not_run": {"GMR": "why"},
            "absent": []}  # fmt: skip


def test_intervals_are_over_clips(rooms):
    every = [{"bad": 0, "frames": 10}] * 9 + [{"bad": 10, "frames": 10}]
    found = rooms.sums.spread(every, lambda s: s["bad"], lambda s: s["frames"])
    assert found["value"] == pytest.approx(0.1)
    assert found["low"] == 0.0 and 0.2 <= found["high"] <= 0.4
    one = rooms.sums.spread(every[:1], lambda s: s["bad"], lambda s: s["frames"])
    assert one == {"value": 0.0, "low": None, "high": None}


def test_page_tells_our_losses_and_asks_no_network(rooms):
    cases = [case(rooms, "file", f"c{i}", angle=8.0 + i) for i in range(3)]
    cases += [case(rooms, "mink", f"c{i}", angle=2.0 + i, paths_broken=1) for i in range(3)]
    record = rooms.sums.record(cases, about(rooms), {"file": 300.0, "mink": 20.0})
    shown = rooms.book.page(record)
    assert "http" not in shown.replace("http-equiv", "").replace("http://www.w3.org", "")
    assert "<script" not in shown and "<b>" not in shown.split("<h2>Where we lose")[1][:400]
    told = rooms.changes.losses(record)
    assert "coman, protocol 1: nearer to the human: mink <b>." in told
    assert "coman, protocol 1: smaller to install: mink <b>." in told
    assert "nearer to the human: mink &lt;b&gt;" in shown
    assert "no rival is without a broken pose or path" in shown
    flat = rooms.book.rows(record)
    assert [row["paths_broken"] for row in flat] == [0.0, pytest.approx(1 / 9)]
    assert set(flat[0]) == set(flat[1]) and "angle_low" in flat[0]
    stream = [c._replace(key="stream", said=c.said | {"angle": 20.0}) for c in cases[:3]]
    both = [c._replace(said=c.said | {"angle": 1.0}) for c in cases[:3]] + stream + cases[3:]
    told = rooms.changes.losses(rooms.sums.record(both, about(rooms), {}))
    assert "coman, protocol 1: nearer to the human than our stream: mink <b>." in told
    better = [c._replace(said=c.said | {"angle": 1.0}) if c.key == "file" else c for c in cases]
    record = rooms.sums.record(better, about(rooms), {"file": 300.0, "mink": 20.0})
    assert not any("nearer" in line for line in rooms.changes.losses(record))


def test_a_motion_that_never_came_is_counted(rooms):
    lost = case(rooms, "mink", "c0")._replace(said=None, about={}, same=None)
    record = rooms.sums.record([lost, case(rooms, "mink", "c1")], about(rooms), {})
    row = record["rows"][0]
    assert (row["clips"], row["motions"], row["lost"]) == (2, 1, 10)
    record = rooms.sums.record([lost, case(rooms, "file", "c0")], about(rooms), {})
    assert "No motion came of: mink" in rooms.book.page(record)
