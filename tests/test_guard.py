"""The guard by itself: whatever a proof does not say yes to is no, at every place that asks one.

On the robot of two planar arms, whose obstacles are its trunk and its other arm. With no budget
for a second look, most long paths are undecided: as good a no as a collision.
"""

from functools import cache

import numpy as np
import pytest
from worlds import MARGIN, relaxed, write_arms

from s3le.kernels import batch
from s3le.retarget import around, guard
from s3le.retarget.guard import AROUND, DETOUR, HELD, LIMITED, SHORTENED, TURN, WANTED, WARM
from s3le.retarget.refine import Rule
from s3le.robot.robot import Robot
from s3le.safety import segment
from s3le.safety.segment import CERTIFIED, COLLIDES, UNDECIDED
from s3le.safety.swept import swept

BETWEEN = 0.0005  # [m]
RULE = Rule(
    target=0.004, margin=MARGIN, between=BETWEEN, ridge=1e-3, pull=0.3, toll=0.003, steps=6,
    budget=200,
)  # fmt: skip
SPENT, FEW = RULE._replace(budget=0), RULE._replace(budget=3)
HASTY = RULE._replace(steps=1, target=MARGIN)  # one linear step, which may end too close
NOES = {200: {COLLIDES}, 3: {COLLIDES, UNDECIDED}, 0: {UNDECIDED}}  # that a budget can say
DT, FAST = 0.1, 80.0  # [s], [rad/s]: 8 rad in a step, from anywhere to anywhere


@cache
def world(tmp):
    made = Robot.from_file(write_arms(tmp), MARGIN, "midpoint")
    return made, made.chain, swept(made.chain), segment.scratch(made.chain)


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    return world(tmp_path_factory.mktemp("arms"))


@pytest.fixture(scope="module")
def poses(arms):
    """Feasible poses, about half of them nearly as close to a collision as allowed."""
    made = arms[0]
    return batch.project(made.chain, made.anchor, relaxed(made, 20, 4), MARGIN + 1e-5).q


@pytest.fixture(scope="module")
def ways(arms, poses):
    """Pairs of feasible poses, near and far."""
    made, rng, out = arms[0], np.random.default_rng(5), pairs(poses) + pairs(poses, 7)
    for size in (0.2, 0.6, 1.5):
        q = np.clip(poses + rng.uniform(-size, size, poses.shape), made.lower,
                    made.upper)  # fmt: skip
        q = batch.project(made.chain, made.anchor, q, MARGIN + 1e-5).q
        out += list(zip(poses, q, strict=True))
    return out


def says(arms, q0, q1, rule):
    _, chain, bounds, scratch = arms
    return segment.prove(chain, bounds, scratch, q0, q1, rule.between, rule.budget)


def pairs(poses, shift=1):
    return list(zip(poses, np.roll(poses, -shift, axis=0), strict=True))


# --- what the joints may do in a step


@pytest.mark.parametrize("dt", [1 / 30, 0.001, 0.2])
@pytest.mark.parametrize("brake", [5.0, 60.0])
@pytest.mark.parametrize("far", [0.0, 1e-6, 0.01, 0.3, 2.0])
def test_so_fast_that_the_way_left_is_just_enough_to_stop(far, brake, dt):
    v = guard.slowly(far, dt, brake)
    assert v * dt + v * v / (2.0 * brake) == pytest.approx(far, abs=1e-12)
    assert guard.slowly(-far, dt, brake) == pytest.approx(0.0, abs=1e-12)


def box(arms, q0, v0, want, brake, dt):
    low, high = np.empty(4), np.empty(4)
    guard.reachable(arms[1], q0, v0, want, dt, np.full(4, 4.0), brake, low, high)
    return low, high


def test_without_a_brake_the_box_is_speed_times_time_within_the_limits(arms):
    robot, q0 = arms[0], arms[0].anchor.copy()
    q0[0], q0[3] = robot.upper[0] - 0.1, robot.lower[3]
    low, high = box(arms, q0, np.full(4, 3.9), -q0, np.inf, 0.1)
    assert np.allclose(low, np.maximum(q0 - 0.4, robot.lower), rtol=0, atol=1e-8)
    assert np.allclose(high, np.minimum(q0 + 0.4, robot.upper), rtol=0, atol=1e-8)
    assert (high - q0 <= 0.4).all() and (q0 - low <= 0.4).all()
    assert high[0] == robot.upper[0] and low[3] == robot.lower[3]


@pytest.mark.parametrize("dt", [1 / 30, 0.01])
@pytest.mark.parametrize("brake", [10.0, 60.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_joint_that_goes_as_fast_as_it_may_stops_where_it_is_wanted(arms, dt, brake, sign):
    robot = arms[0]
    for want in (1.1, 0.05, 1e-4, 9.0):  # the last beyond the limit, where it stops
        q, v, aim = np.zeros(4), np.zeros(4), np.full(4, sign * want)
        stop = np.clip(aim, robot.lower, robot.upper)
        fastest, took = 0.0, 0
        while np.abs(stop - q).max() > 1e-6 and took < 2000:
            low, high = box(arms, q, v, aim, brake, dt)
            then = high if sign > 0 else low
            now = (then - q) / dt
            assert np.abs(now - v).max() <= brake * dt * (1 + 1e-6) + 1e-9
            assert (sign * (stop - then) >= -1e-9).all()  # never beyond
            assert np.abs(now).max() <= 4.0
            fastest, took, q, v = max(fastest, np.abs(now).max()), took + 1, then, now
        assert took < 2000
        if want > 1.0:  # it gets going, and a brake is no more than half of the way
            assert fastest > 0.7 * min(4.0, np.sqrt(brake * np.abs(stop).min()))
        low, high = box(arms, q, v, aim, brake, dt)
        assert (low <= q + 1e-5).all() and (high >= q - 1e-5).all()


def test_a_joint_that_is_too_fast_to_stop_slows_down_as_much_as_it_may(arms):
    for v0 in (3.0, -3.0):
        want = np.full(4, 1e-9 * v0)
        low, high = box(arms, np.zeros(4), np.full(4, v0), want, 10.0, 0.1)
        assert np.allclose(low, high) and np.allclose(low, (v0 - np.sign(v0)) * 0.1)
    low, high = box(arms, np.zeros(4), np.full(4, 9.0), np.zeros(4), 10.0, 0.1)
    assert np.allclose(low, high) and np.allclose(low, 0.4)  # never faster than it may


# --- steps


def advance(arms, q0, want, rule, dt=DT, alike=None):
    """A step to the pose `want`, of a human whose skeleton is that of the pose `alike`."""
    made, chain, bounds, scratch = arms
    q, out = np.full(4, np.nan), np.full(2, np.nan)
    x = batch.skeletons(chain, (want if alike is None else alike)[None])[0]
    how = guard.advance(
        chain, bounds, scratch, x, want, q0, np.zeros(4), dt, np.full(4, FAST), np.inf, rule, q,
        out,
    )  # fmt: skip
    return how, q, out


RULES = pytest.mark.parametrize("rule", [RULE, FEW, SPENT], ids=["a budget", "a few", "none"])


@pytest.mark.parametrize(
    "rule", [RULE, FEW, SPENT, HASTY], ids=["a budget", "a few", "none", "in haste"]
)
def test_a_step_is_proven_whichever_way_it_came_about(arms, ways, rule):
    made, seen, refused = arms[0], set(), set()
    for k, (q0, want) in enumerate(ways):
        dt = DT if k % 3 else 0.01
        how, q, out = advance(arms, q0, want, rule, dt)
        status, bound = says(arms, q0, q, rule)[:2]
        assert status == CERTIFIED and out[0] == bound >= BETWEEN
        assert (np.abs(q - q0) <= FAST * dt).all()
        assert (made.lower <= q).all() and (q <= made.upper).all()
        assert made.certifier().check(q[None]).clearance[0] >= MARGIN
        assert how != WANTED or (q == want).all()
        assert how != HELD or (q == q0).all()
        seen.add(how)
        refused.add(says(arms, q0, want, rule)[0])
    assert {WANTED, LIMITED, DETOUR, SHORTENED} <= seen
    assert refused == {CERTIFIED} | NOES[rule.budget]


def test_a_wanted_pose_whose_path_is_only_undecided_is_not_gone_to(arms, ways):
    """Free by the whole proof: the budget alone says no."""
    held_back = 0
    for q0, want in ways:
        if says(arms, q0, want, SPENT)[0] == UNDECIDED:
            how, q, _ = advance(arms, q0, want, SPENT)
            assert how >= DETOUR and (q != want).any()
            if says(arms, q0, want, RULE)[0] == CERTIFIED:
                assert advance(arms, q0, want, RULE)[0] == WANTED
                held_back += 1
    assert held_back > 3


def rare(arms, row):
    """A step of ten thousand, of which one in a thousand is of its kind."""
    made = arms[0]
    some = relaxed(made, 4000, 9)[row : row + 2]
    return batch.project(made.chain, made.anchor, some, MARGIN + 1e-5).q


def test_the_first_part_of_a_refused_step_is_proven_anew(arms):
    """What is proven up to there need not be proven by as many looks at other places."""
    tight = RULE._replace(budget=5)
    q0, want = rare(arms, 3939)
    status, _, until = says(arms, q0, want, tight)[:3]
    first = q0 + min(0.999 * until, 0.95) * (want - q0)
    assert status == UNDECIDED and batch.clearances(arms[1], first[None])[0] > MARGIN + 1e-5
    assert says(arms, q0, first, tight)[0] == UNDECIDED
    how, q, out = advance(arms, q0, want, tight, alike=first)  # no other pose is as near
    assert says(arms, q0, q, tight)[:2] == (CERTIFIED, out[0]) and how >= DETOUR


@pytest.mark.parametrize("row", [514, 701, 3274])
def test_the_first_part_of_a_refused_step_ends_at_the_margin_of_poses(arms, row):
    """What is proven keeps the margin of paths alone; where that ends no pose may stay."""
    q0, want = rare(arms, row)
    status, _, until = says(arms, q0, want, RULE)[:3]
    first = q0 + min(0.999 * until, 0.95) * (want - q0)
    assert status == COLLIDES and BETWEEN < batch.clearances(arms[1], first[None])[0] < MARGIN
    assert says(arms, q0, first, RULE)[0] == CERTIFIED
    how, q, _ = advance(arms, q0, want, RULE, alike=first)
    assert how >= DETOUR and arms[0].certifier().check(q[None]).clearance[0] >= MARGIN


def go_straight(arms, q0, goal, rule, dt=DT):
    _, chain, bounds, scratch = arms
    q, out = np.full(4, np.nan), np.zeros(2)
    went = guard.straight(
        chain, bounds, scratch, q0, np.zeros(4), goal, dt, np.full(4, FAST), np.inf, rule, q, out
    )
    return went, q, out


@RULES
def test_straight_on_is_a_yes_exactly_where_the_path_is_proven(arms, ways, rule):
    counts = dict.fromkeys((CERTIFIED, COLLIDES, UNDECIDED), 0)
    for q0, goal in ways:
        went, q, out = go_straight(arms, q0, goal, rule)
        found = says(arms, q0, q, rule)
        counts[found[0]] += 1
        assert went == (found[0] == CERTIFIED)
        assert np.allclose(q, goal)  # clear, and within reach
        assert out[1] == found[6] and (not went or out[0] == found[1] >= BETWEEN)
    assert {status for status, n in counts.items() if n > 5} == {CERTIFIED} | NOES[rule.budget]


def test_straight_on_stays_on_the_line_and_within_what_the_joints_may_do(arms, ways):
    moved = 0
    for q0, goal in ways:
        went, q, _ = go_straight(arms, q0, goal, RULE, dt=0.01)  # 0.8 rad at most
        if went:
            far = np.abs(goal - q0) > 1e-3
            share = (q - q0)[far] / (goal - q0)[far]
            assert np.ptp(share) < 1e-9 and 0.0 < share[0] <= 1.0
            assert np.abs(q - q0).max() <= FAST * 0.01
            moved += share[0] < 1.0
    assert moved > 9


def test_straight_on_is_no_where_the_pose_there_is_below_the_margin(arms):
    made = arms[0]
    low, high = made.anchor, made.anchor.copy()
    high[made.joint_names.index("r_shoulder")] = 1.0  # into the trunk
    for _ in range(50):
        middle = (low + high) / 2
        clear = made.certifier().check(middle[None]).clearance[0] >= 0.001
        low, high = (middle, high) if clear else (low, middle)
    assert says(arms, made.anchor, low, RULE)[0] == CERTIFIED
    assert not go_straight(arms, made.anchor, low, RULE)[0]


# --- around what is in the way


def remember(q, want, way=(), turn=0):
    m = guard.memory(4)
    m.q[:], m.want[:], m.last[:] = q, want, want
    m.flag[:] = 1, len(way), turn
    for row, pose in enumerate(reversed(way)):
        m.way[row] = pose
    return m


def pursue(arms, m, rule, dt=DT, starts=None):
    made, chain, bounds, scratch = arms
    x = batch.skeletons(chain, m.want[None])[0]
    starts = np.empty((0, 4)) if starts is None else starts
    return guard.pursue(
        chain, bounds, scratch, m, x, starts, made.anchor, dt, np.full(4, FAST), np.inf,
        rule, m.out[:2],
    )  # fmt: skip


def pick(arms, ways, spent, whole, more=lambda q0, q1: True):
    """Two poses between which a proof without and with a budget says this."""
    for q0, q1 in ways:
        if (says(arms, q0, q1, SPENT)[0], says(arms, q0, q1, RULE)[0]) == (spent, whole):
            if more(q0, q1):
                return q0, q1
    raise AssertionError("no such poses among the samples")


def near(arms, q0):
    """A pose to which the way from q0 is proven at the first look."""
    for size in (0.3, 0.1, 0.03):
        for sign in np.vstack([np.eye(4), -np.eye(4)]):
            q = np.clip(q0 + size * sign, arms[0].lower, arms[0].upper)
            clear = batch.clearances(arms[1], q[None])[0] > MARGIN + 1e-4
            if clear and (q != q0).any() and says(arms, q0, q, SPENT)[0] == CERTIFIED:
                return q
    raise AssertionError("nowhere to go")


def test_it_leaves_its_way_around_only_when_the_straight_path_is_proven(arms, ways):
    q0, want = pick(arms, ways, UNDECIDED, CERTIFIED)
    by = near(arms, q0)
    m = remember(q0, want, [by])
    assert pursue(arms, m, SPENT) == DETOUR
    assert m.flag[AROUND] == 1 and np.allclose(m.next, by)
    m = remember(q0, want, [by])
    assert pursue(arms, m, RULE) == WANTED
    assert m.flag[AROUND] == 0 and (m.next == want).all()


def test_it_passes_the_first_pose_by_only_when_the_path_to_the_second_is_proven(arms, poses, ways):
    def blocked(q0, _):
        return any(says(arms, q0, want, RULE)[0] == COLLIDES for want in poses)

    q0, second = pick(arms, ways, UNDECIDED, CERTIFIED, blocked)
    want = next(w for w in poses if says(arms, q0, w, RULE)[0] == COLLIDES)
    first = near(arms, q0)
    m = remember(q0, want, [first, second])
    assert pursue(arms, m, SPENT) == DETOUR
    assert m.flag[AROUND] == 2 and np.allclose(m.next, first)
    m = remember(q0, want, [first, second])
    assert pursue(arms, m, RULE) == DETOUR
    assert m.flag[AROUND] == 1 and np.allclose(m.next, second)


def test_a_pose_that_is_reached_is_ticked_off(arms, poses, ways):
    q0, second = pick(arms, ways, CERTIFIED, CERTIFIED)
    want = next((w for w in poses if says(arms, q0, w, RULE)[0] == COLLIDES), None)
    m = remember(q0, second if want is None else want, [q0, second])
    pursue(arms, m, SPENT)
    assert m.flag[AROUND] < 2


@pytest.mark.parametrize("rule", [RULE, FEW], ids=["a budget", "a small one"])
def test_every_leg_of_a_way_around_is_proven(arms, poses, ways, rule):
    made, chain, bounds, scratch = arms
    found, kinds = 0, set()
    for k, (q, want) in enumerate(ways):
        way = np.full((2, 4), np.nan)
        some = poses[k % 18 : k % 18 + 2]
        left = around.seek(chain, bounds, scratch, q, want, some, made.anchor, rule, k, way)
        if left:
            assert left == 2
            legs = [q, way[1], way[0], want]
            for a, b in zip(legs, legs[1:], strict=False):
                assert says(arms, a, b, rule)[0] == CERTIFIED
            report = made.certifier().check(way)
            assert (report.clearance >= MARGIN).all() and (report.limit_margin >= 0.0).all()
            found += 1
            kinds.add(bool((way[0] == way[1]).all()))
    assert found > 20 and kinds == {True, False}


@pytest.mark.parametrize("rule", [SPENT, FEW], ids=["no budget", "a small one"])
def test_what_it_sets_out_on_is_proven_to_the_end(arms, poses, ways, rule):
    set_out = 0
    for k, (q, want) in enumerate(ways):
        m = remember(q, want, turn=k)
        how = pursue(arms, m, rule, starts=poses[k % 18 : k % 18 + 2].copy())
        assert says(arms, q, m.next, rule)[0] == CERTIFIED
        if left := m.flag[AROUND]:
            assert how == DETOUR and m.flag[WARM] == 1
            legs = [q, *(m.way[row] for row in reversed(range(left)))]
            legs += [] if (legs[-1] == want).all() else [want]
            for a, b in zip(legs, legs[1:], strict=False):
                assert says(arms, a, b, rule)[0] == CERTIFIED
            set_out += 1
        elif how >= DETOUR:
            assert m.out[0] == says(arms, q, m.next, rule)[1]
            assert m.flag[TURN] in (k, k + around.TRIES)
    assert set_out > 2


def test_a_way_that_can_not_be_gone_is_given_up_for_a_proven_step(arms, poses, ways):
    q0, want = next((a, b) for a, b in ways if says(arms, a, b, SPENT)[0] != CERTIFIED)
    goal = next(b for b in poses if says(arms, q0, b, SPENT)[0] != CERTIFIED)
    m = remember(q0, want, [goal])
    pursue(arms, m, SPENT)
    assert says(arms, q0, m.next, SPENT)[0] == CERTIFIED
    assert m.flag[AROUND] == 0 or (m.way[m.flag[AROUND] - 1] != goal).any()
