"""Ways around what stands between two poses: all of a way is proven, and most blocks have one."""

from functools import cache

import numpy as np
from streaming import AGREEMENT, BETWEEN, DEFAULT, stored
from worlds import MARGIN, coman

from s3le.plan import around
from s3le.safety import segment
from s3le.safety.judge import Judge
from s3le.safety.paths import COLLIDES, certify
from s3le.safety.swept import swept


@cache
def blocked(count=30, most=1.5):
    """Pairs of feasible poses, no joint farther apart than `most`, whose straight path collides."""
    made, (q, _), rng = coman(), stored(), np.random.default_rng(3)
    found = []
    while len(found) < count:
        a, b = q[rng.integers(len(q), size=(2, 2000))]
        b = np.clip(b, a - most, a + most)
        free = made.certifier().check(b).clearance >= MARGIN + 1e-5
        for one, other in zip(a[free], b[free], strict=True):
            if certify(made, np.array([one, other]), BETWEEN).status[0] == COLLIDES:
                found.append((one, other))
    return found[:count]


def seek(q, want, starts, turn):
    made = coman()
    way = np.full((2, made.n_dof), np.nan)
    left = around.seek(
        made.chain, swept(made.chain), segment.scratch(made.chain), q, want, starts,
        made.anchor, DEFAULT.planning().care(made), turn, way,
    )  # fmt: skip
    return left, way


def test_most_blocks_have_a_way_and_all_of_it_is_clear():
    made, (pool, _) = coman(), stored()
    judge, found = Judge(made.certifier()), 0
    for number, (q, want) in enumerate(blocked()):
        starts = pool[number * 4 : number * 4 + 4]
        for turn in range(0, 15, around.TRIES):  # as frames do, one after the other
            left, way = seek(q, want, starts, turn)
            if left:
                break
        if not left:
            assert np.isnan(way).all()
            continue
        found += 1
        assert left == 2
        assert (made.certifier().check(way).clearance >= MARGIN).all()
        whole = np.array([q, way[1], way[0], want])
        for a, b in zip(whole[:-1], whole[1:], strict=True):
            assert judge.path(a, b).clearance >= BETWEEN - AGREEMENT
    assert found > 0.6 * len(blocked())


def test_what_cannot_be_gone_by_is_passed_over():
    made, (q, want) = coman(), blocked()[0]
    outside = np.full((4, made.n_dof), 9.0)
    nothing = np.full((4, made.n_dof), np.nan)
    for starts in (outside, nothing):
        left, way = seek(q, want, starts, 11)  # the proposals' turn
        assert left == 0 and np.isnan(way).all()


def test_opening_an_arm_leaves_the_rest():
    made, (pool, _) = coman(), stored()
    out = np.empty(made.n_dof)
    for group, prefix in ((1, "R"), (2, "L")):
        assert around.opened(made.chain, pool[0], made.anchor, group, 0.5, out)
        half = 0.5 * (pool[0] + made.anchor)
        for i, name in enumerate(made.joint_names):
            assert np.isclose(out[i], (half if name.startswith(prefix) else pool[0])[i])


def test_no_way_but_the_last_turns_the_trunk_aside():
    made, (pool, _) = coman(), stored()
    carries = np.array([name.startswith("Waist") for name in made.joint_names])
    assert carries.sum() == 3
    seen = 0
    for number, (q, want) in enumerate(blocked()):
        for turn in range(15):
            left, way = seek(q, want, pool[number * 4 : number * 4 + 4], turn)
            tried = {(turn + more) % 15 for more in range(around.TRIES)}
            if left and 10 not in tried:  # the anchor as it is
                assert (way[1, carries] == q[carries]).all()
                assert (way[0, carries] == want[carries]).all()
                seen += 1
    assert seen > 10
