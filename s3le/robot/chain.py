"""A robot as flat arrays, the form that compiled code wants."""

from typing import NamedTuple

import numpy as np

from s3le.robot.model import Geometry
from s3le.skeleton import ABSENT, BONES, POINTS


class Chain(NamedTuple):
    """A robot's tree, points and capsules; frame 0 is the base, frame j + 1 moves with joint j."""

    parent: np.ndarray  # int64 (n,), frame before joint j
    rotation: np.ndarray  # (n, 3, 3), joint frame in the parent's at angle zero
    translation: np.ndarray  # [m], (n, 3)
    axis: np.ndarray  # (n, 3), unit, in the joint's frame
    moves: np.ndarray  # bool (n + 1, n): does joint j move frame f
    lower: np.ndarray  # [rad], (n,)
    upper: np.ndarray  # [rad], (n,)
    base: np.ndarray  # (3, 3): base frame -> x forward, y left, z up
    tail: np.ndarray  # (7, 2): the two points whose mean a bone starts at
    head: np.ndarray  # (7, 2): the two points whose mean a bone ends at
    point_frame: np.ndarray  # int64 (10 + k,), ordered as skeleton.POINTS; then what stands for
    point: np.ndarray  # [m], (10 + k, 3), in that frame; bones that the robot lacks
    body_frame: np.ndarray  # int64 (b,)
    body_a: np.ndarray  # [m], (b, 3), capsule ends in the body's frame
    body_b: np.ndarray  # [m], (b, 3)
    body_radius: np.ndarray  # [m], (b,)
    pair: np.ndarray  # int64 (p, 2), watched pairs of bodies
    slack: np.ndarray  # [m], (p,), added to the distance of a pair that overlaps by design; else 0
    floor: np.ndarray  # [m], (p,), distance that such a pair keeps on the paths between poses


def watching(chain: Chain, kept: np.ndarray) -> Chain:
    """The same robot of which only some watched pairs are watched: kept, bool (p,)."""
    pair = np.ascontiguousarray(chain.pair[kept])
    return chain._replace(pair=pair, slack=chain.slack[kept], floor=chain.floor[kept])


def build(
    robot: Geometry,
    watched: np.ndarray,
    neck: str,
    slack: np.ndarray | None = None,
    floor: np.ndarray | None = None,
) -> Chain:
    """Flatten a robot.

    Args:
        robot: as read from its files.
        watched: body indices of the watched pairs, int64 (p, 2).
        neck: "midpoint" of the shoulders or "joint" (skeleton.NECKS).
        slack, floor: of pairs that overlap by design, see Chain; without them there are none.
    """
    n = robot.n_dof
    moves = np.zeros((n + 1, n), np.bool_)
    for frame in range(1, n + 1):
        moves[frame, robot.path_to(frame - 1)] = True
    # The pelvis points do not enter any bone; a robot has none, so they sit at the hip.
    roles = [role if role in robot.points else "hip" for role in POINTS]
    at = {role: i for i, role in enumerate(POINTS)}
    between = {role: (at[role], at[role]) for role in POINTS}
    if neck == "midpoint" and len(robot.arms) == 2:
        between["neck"] = (at["r_shoulder"], at["l_shoulder"])
    tails = ("hip", "neck", "r_shoulder", "r_elbow", "neck", "l_shoulder", "l_elbow")
    heads = ("neck", "r_shoulder", "r_elbow", "r_hand", "l_shoulder", "l_elbow", "l_hand")
    frames = [robot.points[role].joint + 1 for role in roles]
    places = [robot.points[role].offset for role in roles]
    tail, head = [between[role] for role in tails], [between[role] for role in heads]
    for b, bone in enumerate(BONES):
        if heads[b] not in robot.points:  # two points of the base, a constant direction apart
            frames += [0, 0]
            places += [np.zeros(3), robot.base_rotation.T @ ABSENT[bone]]
            tail[b], head[b] = (len(frames) - 2,) * 2, (len(frames) - 1,) * 2
    return Chain(
        parent=np.array([joint.parent + 1 for joint in robot.joints], np.int64),
        rotation=np.array([joint.rotation for joint in robot.joints]),
        translation=np.array([joint.translation for joint in robot.joints]),
        axis=np.array([joint.axis for joint in robot.joints]),
        moves=moves,
        lower=robot.lower,
        upper=robot.upper,
        base=np.ascontiguousarray(robot.base_rotation),
        tail=np.array(tail, np.int64),
        head=np.array(head, np.int64),
        point_frame=np.array(frames, np.int64),
        point=np.array(places),
        body_frame=np.array([body.joint + 1 for body in robot.bodies], np.int64),
        body_a=np.array([body.a for body in robot.bodies]),
        body_b=np.array([body.b for body in robot.bodies]),
        body_radius=np.array([body.radius for body in robot.bodies]),
        pair=np.ascontiguousarray(watched, np.int64),
        slack=np.zeros(len(watched)) if slack is None else slack,
        floor=np.zeros(len(watched)) if floor is None else floor,
    )
