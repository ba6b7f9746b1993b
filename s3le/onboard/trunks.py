"""What bends a trunk, and what carries all of it: waist and legs, by names and by geometry."""

import numpy as np

from s3le.onboard.tree import Tree, mirrored_pairs, named_pairs

_WAIST = 3  # joints at most that count as a waist
LONGEST = 1.4  # lengths of an arm that a trunk has at most, from waist to shoulders


def waist(
    tree: Tree, shared: list[int], legs: list[int], shoulders: np.ndarray, arm: float,
    look: list[str],
) -> tuple[list[int], list[int]]:  # fmt: skip
    """Joints that bend the trunk, and the lowest joint that might have, if any.

    Of those before the arms, the ones before the legs too move the whole robot, as a model of a
    floating base does; and those that lie farther down than a trunk is long are a leg of a kind.

    Args:
        tree: the robot.
        shared: joints before both arms, from the base up.
        legs: their first joints.
        shoulders: the middle between them [m], (3,).
        arm: length of an arm [m].
        look: takes what a person should look at.
    """
    carried = {j for leg in legs for j in tree.path(leg)[:-1]}
    if whole := [j for j in shared if j in carried]:
        look.append(
            f"held, for legs and arms hang on them alike: {', '.join(map(tree.name, whole))}"
        )
    shared = [j for j in shared if j not in carried]
    for j in shared:
        if not tree.turns(j):
            look.append(f"'{tree.name(j)}' before the arms does not turn (a lift?); it is held")
    turning = [j for j in shared if tree.turns(j)]
    last = turning[-_WAIST:]
    if held := [tree.name(j) for j in turning[:-_WAIST]]:
        look.append(f"waist: the last {_WAIST} joints before the arms move, not {', '.join(held)}")
    spots = [*(tree.at(j) for j in last), shoulders]
    steps = [float(np.linalg.norm(a - b)) for a, b in zip(spots, spots[1:], strict=False)]
    down = np.cumsum(steps[::-1])[::-1]  # [m] along the trunk from each joint to the shoulders
    near = [j for j, far in zip(last, down, strict=True) if far <= LONGEST * arm]
    if near and len(near) < len(last):
        low = [tree.name(j) for j in last if j not in near]
        look.append(
            f"held, for they lie more than {LONGEST:g} arms below the shoulders, as legs do: "
            f"{', '.join(low)}"
        )
        return near, last[:1]
    return last, last[:1]


def between(tree: Tree, legs: list[int], shared: list[int]) -> list[int]:
    """Turning joints that both legs hang on and the arms do not."""
    if not legs:
        return []
    paths = [tree.path(leg)[:-1] for leg in legs]
    return [
        j for j in paths[0]
        if tree.turns(j) and j not in shared and all(j in path for path in paths)
    ]  # fmt: skip


def legs(tree: Tree, arms: set[int]) -> list[int]:
    """First joints of the legs, left and right; empty: it has none."""
    pairs = [p for p in named_pairs(tree) or mirrored_pairs(tree) if not arms & set(p)]
    above = {k for root in arms for k in tree.below(root)}
    pairs = [
        p for p in pairs
        if p[0] not in above and tree.turns(p[0]) and tree.reach(p[0]) > 0.25
        and tree.resembles_arm(p[0]) < 0
    ]  # fmt: skip
    longest = max(pairs, key=lambda p: tree.reach(p[0]), default=())
    return list(longest)
