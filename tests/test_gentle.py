"""A jerk that is aimed at: kept where it can be, told in any case, never claimed."""

import json

import numpy as np
import pytest
from command import run, waving
from guarding import put
from handmade import write
from test_guard_clean import held, joint, still
from worlds import coman

from s3le.cli import shell
from s3le.errors import CertificateError, ParameterError
from s3le.guard.claim import claim
from s3le.guard.clean import Guard
from s3le.motion import files
from s3le.plan import gentle
from s3le.plan.flow import planner
from s3le.plan.limits import limits
from s3le.plan.settings import Settings
from s3le.safety import audit

LIMIT = 1200.0  # [rad/s^3]; 60 rad/s^2 one way and then the other make 3,600 at 30 Hz


def jumping(rows=60):
    """An arm that is asked to be elsewhere at once, time and again."""
    q = still(rows)
    q[:, joint("LShSag")] += 0.3 * (np.arange(rows) // 4 % 2)
    return q


def planned(wanted, jerk=0.0, curved=True):
    settings = Settings(check=False, curved=curved, jerk=jerk)
    return planner(coman(), limits(coman(), 60.0), settings).plan(time_of(wanted), wanted)


def time_of(q):
    return np.arange(len(q)) / 30.0


def test_of_a_polynomial_it_is_what_analysis_says():
    time = np.array([0.0, 0.1, 0.25, 0.3, 0.45])
    q, v = 2.0 * time[:, None] ** 3, 6.0 * time[:, None] ** 2
    # Mean accelerations of the steps of a cubic are those in their middles: 12 t there.
    assert gentle.jerks(time, q, v) == pytest.approx(np.full((3, 1), 12.0))
    even = np.arange(6) / 10.0
    assert gentle.jerks(even, 2.0 * even[:, None] ** 3) == pytest.approx(np.full((3, 1), 12.0))
    for rows in range(1, 4):
        assert gentle.jerks(even[:rows], np.zeros((rows, 2))).shape == (0, 2)
        told = gentle.about([(even[:rows], np.zeros((rows, 2)), None)], LIMIT)
        assert told["largest_rad_s3"] == 0.0 and told["beyond"] == 0


@pytest.mark.parametrize("curved", [True, False])
def test_a_plan_keeps_it_and_holds_and_is_farther_from_what_is_wanted(curved):
    wanted = jumping()
    made = {jerk: planned(wanted, jerk, curved) for jerk in (0.0, LIMIT)}
    off = {jerk: np.square(plan.q - wanted).sum() for jerk, plan in made.items()}
    most = {
        jerk: np.abs(gentle.jerks(time_of(wanted), plan.q, plan.v)).max()
        for jerk, plan in made.items()
    }
    assert most[0.0] > 2800.0 and most[LIMIT] <= LIMIT * (1.0 + 1e-6)
    assert off[0.0] < off[LIMIT] < 5.0 * off[0.0]
    asked = audit.demands(coman(), acceleration=60.0)
    plan = made[LIMIT]
    assert audit.audit(coman(), time_of(wanted), plan.q, asked, v=plan.v).holds


def test_what_cannot_be_had_is_told_and_not_refused(tmp_path):
    source = put(tmp_path / "a.csv", jumping())
    out = tmp_path / "out"
    said = run("guard", source, "--robot", "coman", "--jobs", 1, "--jerk", 1, "--out", out)
    told = json.loads((out / "a.csv.guard.json").read_text())
    assert said.exit_code == shell.OK and told["holds"]
    assert told["jerk"]["beyond"] > 0 and told["jerk"]["largest_rad_s3"] < 3000.0
    assert f"{told['jerk']['beyond']} of {told['jerk']['of']} steps beyond 1" in said.output
    assert "jerk" not in told["certificate"]


def test_a_file_that_holds_is_touched_for_it_and_one_that_keeps_it_is_not(tmp_path):
    hard = planned(jumping())
    one = held(hard.q, place=True)
    episode = one.episodes[0]._replace(v=hard.v)
    plain, asked = Guard(*claim(coman())), Guard(*claim(coman(), jerk=LIMIT))
    assert (plain.nearest(episode).q == hard.q).all()
    made = asked.nearest(episode)
    assert made.after.holds and made.v is not None and (made.q != hard.q).any()
    assert np.abs(gentle.jerks(episode.time, made.q, made.v)).max() <= LIMIT * (1.0 + 1e-6)
    again = held(made.q, place=True).episodes[0]._replace(v=made.v)
    assert (asked.nearest(again).q == made.q).all()


@pytest.mark.parametrize("fails", ["no plan", "a plan that does not hold"])
def test_straight_rows_that_hold_are_not_refused_for_it(monkeypatch, fails):
    file = held(planned(jumping(), curved=False).q)
    guard = Guard(*claim(coman(), straight=True, jerk=LIMIT))
    episode = file.episodes[0]
    eased = guard.nearest(episode)
    assert eased.after.holds and (eased.q != episode.q).any()

    def plan(episode, reserve, step, progress):
        if fails == "no plan":
            raise CertificateError("no motion was found")
        beyond = np.full_like(episode.q, 10.0)  # no joint goes there
        return beyond, np.ones(len(beyond), np.uint8), np.zeros(len(beyond), bool)

    monkeypatch.setattr(guard, "_plan", plan)
    kept = guard.nearest(episode)
    assert kept.after.holds and kept.after is kept.before and (kept.q == episode.q).all()


def test_a_command_takes_it_and_its_summary_tells(tmp_path):
    write(tmp_path / "walk.bvh", waving(40))
    for jerk in (None, 400.0):
        more = () if jerk is None else ("--jerk", jerk)
        out = tmp_path / str(jerk)
        said = run("retarget", tmp_path / "walk.bvh", "--out", out, "--jobs", 1, *more)
        assert said.exit_code == shell.OK, said.output
        told = json.loads((out / "walk.json").read_text())["jerk"]["planned"]
        motion = files.read(out / "walk.parquet")
        found = np.abs(gentle.jerks(motion.time, motion.q, motion.v)).max()
        assert told["largest_rad_s3"] == pytest.approx(found) and told["limit_rad_s3"] == jerk
        assert ("jerk at most" in said.output) == (jerk is not None)
        assert told["beyond"] == (None if jerk is None else int(found > jerk))


@pytest.mark.parametrize("value", [-1.0, float("nan"), 1e13])
def test_what_is_none_is_refused_in_a_line(tmp_path, value):
    with pytest.raises(ParameterError, match="jerk must be"):
        claim(coman(), jerk=value)
    source = put(tmp_path / "a.csv", still(4))
    for command in (("guard", source, "--robot", "coman"), ("retarget", tmp_path / "no.bvh")):
        said = run(*command, "--jerk", value, "--out", tmp_path / "out")
        assert said.exit_code == shell.UNREADABLE
        assert "jerk must be" in said.output
