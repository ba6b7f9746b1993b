"""Where a robot's hip, shoulders, elbows and hands are, from names and from the tree's geometry.

What names say is held against what geometry says. An elbow is the joint that changes the distance
from shoulder to hand most; a shoulder is where the axes before it meet; a hand is the first joint
beyond that bends the wrist, or a fixed frame.
"""

import re
from dataclasses import dataclass, field

import numpy as np

from s3le.errors import RobotError
from s3le.onboard import trunks, upright
from s3le.onboard.source import Source
from s3le.onboard.tree import Tree, main_chain, mirrored_pairs, named_pairs

SHORTEST_ARM = 0.12  # [m]
_LEANS = np.radians(8.0)  # [rad], a hip farther ahead or behind is put below the neck
_DEEPER = 1.5  # of a trunk's length down to the legs, a base that lies lower is no hip
_HAND = re.compile(r"hand|wrist|palm|grip|tool|tcp|ee_|_ee|tip", re.I)
_SENSOR = re.compile(
    r"cam|imu|force|sensor|(^|_)ft(_|$)|torque|skin|optical|thumb|index|finger", re.I
)

Point = str | dict  # a frame's name, or {frame: name, offset: [x, y, z]}


@dataclass
class Limbs:
    """What was found; sure and look are sentences for a person."""

    points: dict[str, Point]
    waist: list[int]  # joints, pinocchio's index
    arms: dict[str, list[int]]  # "r", "l" -> joints up to the hand
    base: np.ndarray  # (3, 3): base frame -> x forward, y left, z up
    sure: list[str] = field(default_factory=list)
    look: list[str] = field(default_factory=list)


@dataclass
class _Arm:
    chain: list[int]
    shoulder: np.ndarray
    elbow: np.ndarray
    hand: np.ndarray
    points: dict[str, Point]
    used: list[int]


def find(source: Source) -> Limbs:
    """Propose the points.

    Raises:
        RobotError: no arm of at least a shoulder and an elbow that bends is found.
    """
    tree = Tree(source.model)
    sure: list[str] = []
    look: list[str] = []
    roots = _arm_roots(tree, source, sure, look)
    arms = {side: _arm(tree, source, side, root, sure, look) for side, root in roots.items()}
    first = next(iter(roots.values()))
    shared = tree.path(first)[:-1]
    for root in roots.values():
        shared = [j for j in shared if j in tree.path(root)]
    trunk = shared[-1] if shared else 0
    legs = trunks.legs(tree, set(roots.values()))
    shoulders = np.mean([arm.shoulder for arm in arms.values()], axis=0)
    lengths = [np.linalg.norm(a.elbow - a.shoulder) + np.linalg.norm(a.hand - a.elbow)
               for a in arms.values()]  # fmt: skip
    waist, lowest = trunks.waist(tree, shared, legs, shoulders, float(max(lengths)), look)
    low = lowest != waist[:1]
    if waist:
        link = tree.link(waist[0])
    elif legs and tree.path(legs[0])[:-1] == shared:  # legs and arms hang on one stiff trunk
        link = tree.link(legs[0])
    else:
        link = _body(tree, trunk, list(roots.values()))
    middle = shoulders
    points: dict[str, Point] = {}
    axes = [tree.axis(j) for j in range(1, tree.model.njoints) if tree.turns(j)]
    up = np.eye(3)[2]
    if legs or waist or len(arms) == 2:
        foot = tree.link(lowest[0]) if lowest else link
        below = _centre(tree, foot, legs) if legs or waist else np.zeros(3)
        if len(arms) == 2:  # first joints stand on the trunk, wherever the arms point
            left = tree.at(roots["l"]) - tree.at(roots["r"])
            if not np.linalg.norm(left) > 0.02:
                raise RobotError(
                    f"{source.path}: the arms at '{tree.name(roots['l'])}' and "
                    f"'{tree.name(roots['r'])}' begin in one place, so left cannot be told; write "
                    "the robot file by hand, see docs/robots.md"
                )
            left = left / np.linalg.norm(left)
            axes = [axis for axis in axes if abs(axis @ left) < 0.1]
            middle = middle - (middle - tree.at(roots["r"])) @ left * left
            middle = middle + (tree.at(roots["l"]) - tree.at(roots["r"])) / 2
        up = upright.up_of(middle - below, axes)
    if len(arms) == 1:
        left = np.cross(up, upright.forward_of(up))
        middle = middle - (middle - _centre(tree, link, legs)) @ left * left
    base = upright.base_of(left, up, look)
    up, left = base[2], base[1]
    if low:  # the link that the waist hangs on begins at a joint that is held as a leg is
        points["hip"] = _offset(tree, link, tree.at(waist[0]))
    else:
        points["hip"] = _hip(tree, link, legs, middle, base, float(max(lengths)), look)
    points["neck"] = _neck(tree, trunk, middle, arms, left, look)
    for arm in arms.values():
        points |= arm.points
    turned = [tree.name(j) for j in trunks.between(tree, legs, shared)]
    if turned and not waist:
        look.append(
            f"waist: none that carries the arms; {', '.join(turned)} turns the legs against the "
            "trunk, which is the root, and is held"
        )
    elif low:
        look.append(f"waist: {', '.join(map(tree.name, waist))}; is it where a trunk bends?")
    else:
        sure.append(
            "waist: " + (", ".join(map(tree.name, waist)) if waist else "none, the trunk is stiff")
        )
    angle = np.degrees(np.arccos(np.clip((np.trace(base) - 1) / 2, -1, 1)))
    if angle > 1.0:
        look.append(
            f"base: turned by {angle:.0f} deg so that x is forward, y left, z up; is the robot's "
            "front really there?"
        )
    return Limbs(points, waist, {s: arm.used for s, arm in arms.items()}, base, sure, look)


def _arm_roots(tree: Tree, source: Source, sure: list[str], look: list[str]) -> dict[str, int]:
    """First joint of each arm, by side."""

    def long_enough(j: int) -> bool:
        return tree.turns(j) and len(main_chain(tree, j)) >= 2 and tree.reach(j) >= SHORTEST_ARM

    for pairs, named in ((named_pairs(tree), True), (mirrored_pairs(tree), False)):
        good = [pair for pair in pairs if long_enough(pair[0]) and long_enough(pair[1])]
        # A limb that begins inside another good limb is its hand, not an arm.
        inner = {j for a, b in good for r in (a, b) for j in tree.below(r)[1:]}
        good = [pair for pair in good if pair[0] not in inner]
        good = [pair for pair in good if tree.resembles_arm(pair[0]) >= 0]
        if good:
            best = max(good, key=lambda p: (tree.resembles_arm(p[0]) > 0, *_high(tree, p)))
            if named:
                begin = " and ".join(tree.name(j) for j in best[::-1])
                sure.append(f"arms: begin at {begin}, by name")
            else:
                look.append(
                    f"arms: names tell no sides; '{tree.name(best[0])}' lies towards +y and is "
                    "taken for the left one"
                )
            return {"r": best[1], "l": best[0]}
    single = [j for j in range(1, tree.model.njoints) if long_enough(j)]
    single = [
        j for j in single
        if len(main_chain(tree, j)) >= (3 if tree.resembles_arm(j) > 0 else 4)
        and tree.reach(j) >= 0.3 and tree.resembles_arm(j) >= 0
    ]  # fmt: skip
    if not single:
        raise RobotError(
            f"{source.path}: no arm is found (a chain of turning joints of {SHORTEST_ARM:g} m and "
            "more, best in pairs whose names differ in left and right); write the robot file by "
            "hand, see docs/robots.md"
        )
    most = max(tree.resembles_arm(j) for j in single)
    alike = [j for j in single if tree.resembles_arm(j) == most]
    # A waist has all of the arm's names below it; the arm begins where its own name is one.
    root = alike[-1] if tree.named_like_arm(alike[-1]) else max(alike, key=tree.reach)
    chain = main_chain(tree, root)
    if not tree.path(root)[:-1]:  # an arm that stands by itself
        chain_names = " ".join(tree.name(j) for j in chain)
    else:
        chain_names = tree.name(chain[-1])
    is_left = re.search(r"left|(^|_)l_|^L[A-Z_]", chain_names) is not None
    side = "l" if is_left else "r"
    look.append(
        f"arms: one only, it begins at {tree.name(root)} and is taken for the "
        f"{'left' if is_left else 'right'} one; four vectors are followed at most"
    )
    return {side: root}


def _high(tree: Tree, pair: tuple[int, int]) -> tuple[int, float]:
    return tree.resembles_arm(pair[0]), float(tree.at(pair[0])[2])


def _arm(
    tree: Tree, source: Source, side: str, root: int, sure: list[str], look: list[str]
) -> _Arm:
    chain = main_chain(tree, root)
    if len(chain) < 2:
        raise RobotError(
            f"{source.path}: the arm at '{tree.name(root)}' has one joint, so no elbow; write the "
            "robot file by hand, see docs/robots.md"
        )
    # The last joint is in the wrist, where there is one; where it is not, the far end tells.
    for tip in (tree.at(chain[-1]), _tip(tree, chain), _solid_tip(tree, source, chain)):
        bend = [_influence(tree, chain, k, tip) for k in range(len(chain))]
        k = int(np.argmax(bend))
        if bend[k] > 0.05:
            break
    named = [i for i, j in enumerate(chain) if re.search(r"elb", tree.name(j), re.I)]
    if named and k not in named:
        best = max(named, key=lambda i: bend[i])
        if bend[best] > 0.03:
            if bend[best] < 0.5 * bend[k]:
                look.append(
                    f"{side}_elbow: '{tree.name(chain[best])}' by name, though "
                    f"'{tree.name(chain[k])}' changes the distance from shoulder to hand more"
                )
            k = best
    elif named:
        sure.append(f"{side}_elbow: {tree.name(chain[k])}, by name and by geometry")
    else:
        look.append(f"{side}_elbow: {tree.name(chain[k])}, by geometry alone (no name says elbow)")
    if k == 0 or bend[k] < 0.02:
        raise RobotError(
            f"{source.path}: no joint of the arm at '{tree.name(root)}' bends it: the distance "
            f"from shoulder to hand changes by {bend[k] * 1e3:.0f} mm at most; has it an elbow, "
            "and limits that let it move?"
        )
    shoulder = _meeting(tree, chain[max(0, k - 3) : k])
    elbow = tree.at(chain[k])
    hand, used, at = _hand(tree, source, side, chain, k, tip, shoulder, look)
    points = {f"{side}_shoulder": tree.name(shoulder), f"{side}_elbow": tree.name(chain[k]),
              f"{side}_hand": hand}  # fmt: skip
    upper = float(np.linalg.norm(elbow - tree.at(shoulder)))
    lower = float(np.linalg.norm(at - elbow))
    if not 0.4 < upper / max(lower, 1e-9) < 2.5:
        look.append(
            f"{side} arm: upper {upper * 1e3:.0f} mm, forearm {lower * 1e3:.0f} mm: unusual"
        )
    return _Arm(chain, tree.at(shoulder), elbow, at, points, used)


def _tip(tree: Tree, chain: list[int]) -> np.ndarray:
    """The spot farthest along the arm, (3,), fixed to the chain's last joint."""
    spots = [tree.at(j) for j in tree.below(chain[-1])]
    spots += [tree.place(f) for f in tree.frames([chain[-1]])]
    return max(spots, key=lambda spot: float(np.linalg.norm(spot - tree.at(chain[-1]))))


def _solid_tip(tree: Tree, source: Source, chain: list[int]) -> np.ndarray:
    """The corner of what is solid or drawn farthest along the arm, (3,)."""
    origin = tree.at(chain[-1])
    best = origin
    for frame in tree.frames([chain[-1]]):
        at = tree.data.oMi[frame.parentJoint] * frame.placement
        for shape in [*source.shapes.get(frame.name, []), *source.drawn.get(frame.name, [])]:
            corners = shape.triangles.reshape(-1, 3)
            corners = corners if len(corners) else shape.translation[None]
            spots = corners @ at.rotation.T + at.translation
            far = spots[int(np.argmax(np.linalg.norm(spots - origin, axis=1)))]
            if np.linalg.norm(far - origin) > np.linalg.norm(best - origin):
                best = far
    return best


def _influence(tree: Tree, chain: list[int], k: int, tip: np.ndarray) -> float:
    """By how much joint k changes the distance from shoulder to tip over its range [m]."""
    joint = tree.model.joints[chain[k]]
    low, high = -np.pi, np.pi
    if joint.nq == 1:
        low = tree.model.lowerPositionLimit[joint.idx_q]
        high = tree.model.upperPositionLimit[joint.idx_q]
        if not high - low < 2 * np.pi:
            low, high = -np.pi, np.pi
    now = tree.still[joint.idx_q] if joint.nq == 1 else 0.0
    if k == 0:
        return 0.0
    shoulder, pivot, axis = tree.at(chain[1]), tree.at(chain[k]), tree.axis(chain[k])
    far = []
    for angle in np.linspace(low, high, 9) - now:
        rel = tip - pivot
        turned = (
            rel * np.cos(angle) + np.cross(axis, rel) * np.sin(angle)
            + axis * (axis @ rel) * (1 - np.cos(angle))
        )  # fmt: skip
        far.append(np.linalg.norm(pivot + turned - shoulder))
    return float(max(far) - min(far))


def _meeting(tree: Tree, joints: list[int]) -> int:
    """Of a shoulder's joints the one whose origin lies nearest to the axes of all."""

    def off(j: int) -> float:
        rel = [tree.at(j) - tree.at(k) for k in joints]
        return sum(
            float(np.linalg.norm(r - (r @ tree.axis(k)) * tree.axis(k)))
            for r, k in zip(rel, joints, strict=True)
        )

    best = min(off(j) for j in joints)
    same = [j for j in joints if off(j) < best + 1e-3]
    return same[min(1, len(same) - 1)]


def _hand(
    tree: Tree, source: Source, side: str, chain: list[int], k: int, tip: np.ndarray,
    shoulder: int, look: list[str],
) -> tuple[Point, list[int], np.ndarray]:  # fmt: skip
    """The hand point, the joints up to it, and where it is."""
    elbow = tree.at(chain[k])
    upper = float(np.linalg.norm(elbow - tree.at(shoulder)))
    after = [(i, tree.at(chain[i])) for i in range(k + 1, len(chain))]
    far = max((float(np.linalg.norm(at - elbow)) for _, at in after), default=0.0)
    least = max(0.5 * far, 0.3 * upper)
    bending = [
        (i, at) for i, at in after
        if np.linalg.norm(at - elbow) >= least
        and abs(tree.axis(chain[i]) @ (at - elbow)) < 0.7 * np.linalg.norm(at - elbow)
    ]  # fmt: skip
    twisting = [(i, at) for i, at in after if np.linalg.norm(at - elbow) >= max(least, 0.5 * upper)]
    for i, at in [*bending[:1], *twisting[-1:]]:
        return tree.name(chain[i]), chain[:i], at
    under = tree.below(chain[-1])
    frames = [
        (f, tree.place(f)) for f in tree.frames([*chain[k:], *under])
        if np.linalg.norm(tree.place(f) - elbow) >= 0.3 * upper and not _SENSOR.search(f.name)
    ]  # fmt: skip
    if named := [(f, at) for f, at in frames if _HAND.search(f.name)]:
        frame, at = min(named, key=lambda item: abs(np.linalg.norm(item[1] - elbow) - upper))
        look.append(f"{side}_hand: the fixed frame '{frame.name}', no wrist joint bends there")
        return frame.name, [j for j in chain if j in tree.path(frame.parentJoint)], at
    # Nothing is named there: the far end of what is solid beyond the elbow, along its middle.
    best, found = 0.0, None
    for f in tree.frames([*chain[k:], *under]):
        at = tree.data.oMi[f.parentJoint] * f.placement
        for shape in source.shapes.get(f.name, []):
            corners = shape.triangles.reshape(-1, 3)
            corners = corners if len(corners) else shape.translation[None]
            spots = corners @ at.rotation.T + at.translation
            far = float(np.linalg.norm(spots - elbow, axis=1).max())
            if far > best:
                way = (spots.min(axis=0) + spots.max(axis=0)) / 2 - elbow
                best, found = far, (f, elbow + far * way / max(float(np.linalg.norm(way)), 1e-9))
    for f, spot in frames:
        if np.linalg.norm(spot - elbow) > best:
            best, found = float(np.linalg.norm(spot - elbow)), (f, spot)
    if found is None or best < 0.05:
        raise RobotError(
            f"{source.path}: nothing lies beyond the elbow '{tree.name(chain[k])}' that could be "
            "its hand; add a fixed frame there or write the robot file by hand"
        )
    frame, spot = found
    look.append(f"{side}_hand: the far end of '{frame.name}', for want of a wrist or a hand's name")
    used = [j for j in chain if j in tree.path(frame.parentJoint)]
    return _offset(tree, frame.name, spot), used, spot


def _offset(tree: Tree, link: str, spot: np.ndarray) -> dict:
    frame = next(f for f in tree.model.frames if f.name == link)
    at = tree.data.oMi[frame.parentJoint] * frame.placement
    return {"frame": link, "offset": [round(float(v), 5) for v in at.actInv(spot)]}


def _link_at(tree: Tree, link: str) -> np.ndarray:
    return tree.place(next(f for f in tree.model.frames if f.name == link))


def _centre(tree: Tree, link: str, legs: list[int]) -> np.ndarray:
    return np.mean([tree.at(j) for j in legs], axis=0) if legs else _link_at(tree, link)


def _body(tree: Tree, trunk: int, roots: list[int]) -> str:
    """The link that both arms hang on, else the first one of the trunk."""
    links = {tree.link(root) for root in roots}
    if len(links) == 1:
        return links.pop()
    return next(f.name for f in tree.frames([trunk]) if f.name != "universe")


def _hip(
    tree: Tree, link: str, legs: list[int], middle: np.ndarray, base: np.ndarray, arm: float,
    look: list[str],
) -> Point:  # fmt: skip
    origin, (forward, _, up) = _link_at(tree, link), base
    rel = middle - origin
    length = float(np.linalg.norm(rel))
    below = length > 0.1 and rel @ up > np.cos(np.radians(25)) * length
    spot = np.mean([tree.at(j) for j in legs], axis=0) if legs else middle - 0.3 * up
    trunk = float((middle - spot) @ up) if legs else arm * trunks.LONGEST / _DEEPER
    if below and length <= _DEEPER * trunk:
        ahead = float(rel @ forward)
        if abs(ahead) <= np.sin(_LEANS) * length:
            return link
        look.append(
            f"hip: {abs(ahead) * 1e3:.0f} mm {'before' if ahead > 0 else 'behind'} '{link}', for "
            "a trunk is upright at zero"
        )
        return _offset(tree, link, origin + ahead * forward)
    why = "not below the shoulders"
    if below:
        why = f"{length * 1e3:.0f} mm below the shoulders, farther than a trunk is long"
    where = "midway between the legs" if legs else "300 mm below the shoulders"
    look.append(f"hip: {where}, for '{link}' is {why}")
    return _offset(tree, link, spot)


def _neck(
    tree: Tree, trunk: int, middle: np.ndarray, arms: dict[str, _Arm], left: np.ndarray,
    look: list[str],
) -> Point:  # fmt: skip
    """Midway between the shoulders, on the trunk."""
    frames = [f for f in tree.frames([trunk]) if f.name != "universe"]
    if len(arms) == 1:
        side, arm = next(iter(arms.items()))
        out = left if side == "l" else -left
        if (arm.shoulder - middle) @ out < 0.03:
            middle = arm.shoulder - 0.15 * out
            look.append("neck: 150 mm inward of the one shoulder, which stands in the middle")
    arm_link = tree.link(next(iter(arms.values())).chain[0])
    link = arm_link if any(f.name == arm_link for f in frames) else frames[0].name
    return _offset(tree, link, middle)
