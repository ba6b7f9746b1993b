"""Robots and people with known answers; shared by the tests of robots, kernels and sampling."""

from functools import cache
from pathlib import Path

import coal
import numpy as np

from s3le.kernels.distance import near_pairs, place_capsules, reach
from s3le.kernels.kinematics import bones, place
from s3le.robot.known import READY
from s3le.robot.robot import Robot
from s3le.skeleton import POINTS

ROBOTS = READY
MARGIN = 0.002  # [m], params.yaml's default


@cache
def coman(margin: float = MARGIN, name: str = "coman", neck: str = "midpoint") -> Robot:
    return Robot.from_file(ROBOTS / f"{name}.yaml", margin, neck)


def inside_limits(made: Robot, n: int, seed: int) -> np.ndarray:
    """Poses uniform in the joint box, (n, n_dof) [rad]."""
    rng = np.random.default_rng(seed)
    return rng.uniform(made.lower, made.upper, (n, made.n_dof))


def relaxed(made: Robot, n: int, seed: int, alpha: float = 0.2) -> np.ndarray:
    """Poses uniform in the box that is alpha wider, (n, n_dof) [rad]."""
    low, high = made.lower, made.upper
    slack = alpha / 2 * (high - low)
    return np.random.default_rng(seed).uniform(low - slack, high + slack, (n, len(low)))


# --- a robot of two planar arms: all joints turn about x, so its kinematics are a line of algebra

UPPER, LOWER, HALF_WIDTH, HEIGHT = 0.3, 0.25, 0.2, 0.5  # [m]
ARMS_YAML = """\
name: arms
urdf: arms.urdf
base_rpy: [0.0, 0.0, 0.0]
points:
  hip: body
  neck: chest
  r_shoulder: r_shoulder
  r_elbow: r_elbow
  r_hand: r_hand
  l_shoulder: l_shoulder
  l_elbow: l_elbow
  l_hand: l_hand
joints: [r_shoulder, r_elbow, l_shoulder, l_elbow]
hold: {}
anchor: {r_shoulder: -1.5, l_shoulder: 1.5}
pair_inflation: 1.1
"""
LIMBS = """\
  <link name="{s}_upper"><collision><origin xyz="0 0 -0.15"/>
    <geometry><capsule radius="0.04" length="0.2"/></geometry></collision></link>
  <link name="{s}_lower"><collision><origin xyz="0 0 -0.125"/>
    <geometry><capsule radius="0.03" length="0.15"/></geometry></collision></link>
  <link name="{s}_hand"/>
  <joint name="{s}_shoulder" type="revolute"><parent link="body"/><child link="{s}_upper"/>
    <origin xyz="0 {y} 0.5"/><axis xyz="1 0 0"/>
    <limit lower="-3" upper="3" velocity="4" effort="1"/></joint>
  <joint name="{s}_elbow" type="revolute"><parent link="{s}_upper"/><child link="{s}_lower"/>
    <origin xyz="0 0 -0.3"/><axis xyz="1 0 0"/>
    <limit lower="-2.5" upper="2.5" velocity="4" effort="1"/></joint>
  <joint name="{s}_tip" type="fixed"><parent link="{s}_lower"/><child link="{s}_hand"/>
    <origin xyz="0 0 -0.25"/></joint>
"""
ARMS_URDF = (
    """\
<?xml version="1.0"?>
<robot name="arms" version="1.1">
  <link name="body"><collision><origin xyz="0 0 0.25"/>
    <geometry><capsule radius="0.1" length="0.3"/></geometry></collision></link>
  <link name="chest"/>
  <joint name="chest_joint" type="fixed"><parent link="body"/><child link="chest"/>
    <origin xyz="0 0 0.45"/></joint>
"""
    + LIMBS.format(s="r", y=-HALF_WIDTH)
    + LIMBS.format(s="l", y=HALF_WIDTH)
    + "</robot>\n"
)


def edited(text: str, *changes: tuple[str, str]) -> str:
    """The text with the first place of each old replaced by new; every old must be there."""
    for old, new in changes:
        assert old in text, f"{old!r} is not in the text to edit"
        text = text.replace(old, new, 1)
    return text


def write_arms(folder: Path, yaml: str = ARMS_YAML, urdf: str = ARMS_URDF) -> Path:
    """The two-armed robot in a folder; returns its robot file."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "arms.urdf").write_text(urdf)
    (folder / "arms.yaml").write_text(yaml)
    return folder / "arms.yaml"


def arms_points(q: dict[str, float]) -> dict[str, np.ndarray]:
    """Where the two-armed robot's points are, by hand [m]."""
    at = {"hip": np.zeros(3), "neck": np.array([0.0, 0.0, 0.45])}
    for side, y in (("r", -HALF_WIDTH), ("l", HALF_WIDTH)):
        first, second = q[f"{side}_shoulder"], q[f"{side}_shoulder"] + q[f"{side}_elbow"]
        shoulder = np.array([0.0, y, HEIGHT])
        elbow = shoulder + UPPER * np.array([0.0, np.sin(first), -np.cos(first)])
        hand = elbow + LOWER * np.array([0.0, np.sin(second), -np.cos(second)])
        at |= {f"{side}_shoulder": shoulder, f"{side}_elbow": elbow, f"{side}_hand": hand}
    return at


# --- the kernels, one pose at a time


def placed(made: Robot, q: np.ndarray) -> tuple[np.ndarray, ...]:
    """R, p, z and capsule ends of one pose as the kernels place them."""
    n, chain = made.n_dof, made.chain
    R, p, z = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n, 3))
    place(chain, np.ascontiguousarray(q, float), R, p, z)
    ends = np.empty((len(chain.body_radius), 3, 3))
    place_capsules(chain, R, p, ends)
    return R, p, z, ends


def pair_distances(made: Robot, q: np.ndarray, band: float) -> tuple[np.ndarray, np.ndarray]:
    """Distances [m] and gradients [m/rad] of the pairs within band that the solver sees."""
    _, p, z, ends = placed(made, q)
    n, chain = made.n_dof, made.chain
    d, G = np.empty(len(chain.pair)), np.empty((len(chain.pair), n))
    found = near_pairs(chain, ends, reach(chain), p, z, band, d, G)
    return d[:found], G[:found]


def skeleton_and_jacobian(made: Robot, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    R, p, z, _ = placed(made, q)
    x, J = np.empty(21), np.empty((21, made.n_dof))
    bones(made.chain, R, p, z, x, J)
    return x, J


# --- capsules by themselves: segments A and B, (2, 3) [m]

SEGMENT_PAIRS = (
    "generic",
    "touching",
    "nested",
    "parallel",
    "collinear",
    "nearly parallel",
    "crossing",
    "sphere and capsule",
    "two spheres",
    "tiny",
)


def segments(kind: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float, float]:
    """A random pair of capsules of one kind: their segments and radii [m]."""
    A, B = rng.normal(0.0, 0.15, (2, 2, 3))
    r1, r2 = rng.uniform(0.02, 0.13, 2)
    along = A[1] - A[0]
    if kind == "touching":  # ends meet on a shared direction
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        ahead = np.sign(along @ way) or 1.0
        B[0] = A[1] + way * ahead * (r1 + r2)
        B[1] = B[0] + way * ahead * 0.1
    elif kind == "nested":  # B's segment within A's capsule
        middle = A.mean(axis=0)
        B = middle + rng.normal(0.0, 0.01, (2, 3))
        r1, r2 = 0.13, 0.02
    elif kind == "parallel":
        B = A + rng.normal(0.0, 0.1, 3) + rng.normal() * along
        B = B[::-1] if rng.random() < 0.5 else B
    elif kind == "collinear":
        B = A + rng.uniform(-3.0, 3.0) * along
    elif kind == "nearly parallel":
        B = A + rng.normal(0.0, 0.1, 3) + rng.normal(0.0, 10.0 ** rng.uniform(-10, -4), (2, 3))
    elif kind == "crossing":
        middle, way = A.mean(axis=0), rng.normal(0.0, 0.1, 3)
        B = np.array([middle - way, middle + way * rng.uniform(0.2, 2.0)])
    elif kind == "sphere and capsule":
        B[1] = B[0]
    elif kind == "two spheres":
        A[1], B[1] = A[0], B[0]
    elif kind == "tiny":
        A[1] = A[0] + along * 1e-8
        B[1] = B[0] + (B[1] - B[0]) * 10.0 ** rng.uniform(-9, -5)
        r1, r2 = rng.uniform(1e-6, 1e-4, 2)
    return A, np.ascontiguousarray(B), float(r1), float(r2)


def coal_distance(A: np.ndarray, B: np.ndarray, r1: float, r2: float) -> float:
    """Signed distance of two capsules by coal [m]."""
    shapes = []
    for ends, radius in ((A, r1), (B, r2)):
        along = ends[1] - ends[0]
        length = float(np.linalg.norm(along))
        turn = turn_z_to(along / length) if length > 0 else np.eye(3)
        at = coal.Transform3s(turn, ends.mean(axis=0))
        shapes += [coal.Capsule(radius, length), at]
    result = coal.DistanceResult()
    coal.distance(*shapes, coal.DistanceRequest(), result)
    return float(result.min_distance)


def turn_z_to(way: np.ndarray) -> np.ndarray:
    """A rotation whose third column is the unit vector way, (3, 3)."""
    other = np.eye(3)[int(np.argmin(np.abs(way)))]
    first = np.cross(other, way)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(way, first), way])


# --- people


def people(n: int, seed: int) -> np.ndarray:
    """Random upper bodies, upright, facing anywhere: (n, 10, 3) [m], ordered as POINTS."""
    rng = np.random.default_rng(seed)
    rest = {
        "hip": (0, 0, 1.0), "r_pelvis": (0, -0.1, 0.95), "l_pelvis": (0, 0.1, 0.95),
        "neck": (0, 0, 1.5), "r_shoulder": (0, -0.2, 1.45), "r_elbow": (0, -0.5, 1.4),
        "r_hand": (0.1, -0.7, 1.3), "l_shoulder": (0, 0.2, 1.45), "l_elbow": (0, 0.5, 1.4),
        "l_hand": (0.1, 0.7, 1.3),
    }  # fmt: skip
    shaken = np.array([rest[name] for name in POINTS]) + rng.normal(0.0, 0.03, (n, len(POINTS), 3))
    return yawed(shaken, rng.uniform(-np.pi, np.pi, n)) + rng.normal(0.0, 2.0, (n, 1, 3))


def yawed(points: np.ndarray, yaw: np.ndarray | float) -> np.ndarray:
    """Points turned about the vertical through the origin by yaw [rad]."""
    yaw = np.broadcast_to(yaw, len(points))
    c, s, zero, one = np.cos(yaw), np.sin(yaw), np.zeros(len(points)), np.ones(len(points))
    turn = np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]])  # (3, 3, n)
    return np.einsum("ijn,npj->npi", turn, points)


def exact_distance(A: np.ndarray, B: np.ndarray) -> float:
    """Distance of two segments [m]: every end to the other segment, and the lines' common normal.

    Slow and in extended precision; shares nothing with the kernels but the definition.
    """
    A, B = A.astype(np.longdouble), B.astype(np.longdouble)
    found = [_to_segment(p, B) for p in A] + [_to_segment(p, A) for p in B]
    d1, d2, r = A[1] - A[0], B[1] - B[0], A[0] - B[0]
    a, b, e = d1 @ d1, d1 @ d2, d2 @ d2
    if (det := a * e - b * b) > 0:
        s, t = (b * (d2 @ r) - e * (d1 @ r)) / det, (a * (d2 @ r) - b * (d1 @ r)) / det
        if 0 <= s <= 1 and 0 <= t <= 1:
            found.append(_length(r + s * d1 - t * d2))
    return float(min(found))


def _to_segment(p: np.ndarray, segment: np.ndarray) -> float:
    along = segment[1] - segment[0]
    square = along @ along
    share = np.clip((p - segment[0]) @ along / square, 0, 1) if square > 0 else 0
    return _length(segment[0] + share * along - p)


def _length(v: np.ndarray) -> float:
    return np.sqrt(v @ v)


def all_clearances(made: Robot, ends: np.ndarray) -> np.ndarray:
    """Signed distance of every watched pair at one pose [m], without any shortcut."""
    radius = made.chain.body_radius
    found = np.array(
        [exact_distance(ends[a, :2], ends[b, :2]) - radius[a] - radius[b] for a, b in made.watched]
    )
    return found + made.slack()  # counted from the baseline, where bodies overlap by design
