"""Robots that are proposed, written and read again, and the way through the earliest stages."""

from typing import NamedTuple

import numpy as np
import pytest
from figures import write
from worlds import MARGIN, people

from s3le.kernels import batch
from s3le.onboard import propose
from s3le.robot.robot import Robot
from s3le.skeleton import cosine_distance, features
from s3le.tuples.ik import ground_truth

SIDES = {"r": "right", "l": "left"}
ALL_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")


class Added(NamedTuple):
    proposal: propose.Proposal
    robot: Robot


def proposed(folder, text, name="figure", **options) -> propose.Proposal:
    return propose.propose(write(folder, text), name, MARGIN, "midpoint", **options)


def new(folder, text, **options) -> Added:
    """Proposed, written and read again."""
    made = proposed(folder, text, **options)
    propose.write(made, folder / "robots", force=True)
    return Added(made, Robot.from_file(folder / "robots" / "figure.yaml", MARGIN, "midpoint"))


def arm_joints(arms="lr", names="{side}_{part}"):
    return {names.format(side=SIDES[s], part=p) for s in arms for p in ALL_ARM}


def through(made: Robot, n: int = 40) -> None:
    """The earliest stages and a look-up: poses, certified, and people answered with them."""
    q = np.random.default_rng(3).uniform(made.lower, made.upper,
                                         (n, made.n_dof))  # fmt: skip
    found = batch.project(made.chain, made.anchor, q, MARGIN)
    made.certifier().require(found.q, MARGIN)
    x = batch.skeletons(made.chain, found.q)
    assert np.linalg.norm(x.reshape(n, 7, 3), axis=2) == pytest.approx(1.0, abs=1e-9)
    seen, ok = features(people(3, 5))
    assert ok.all()
    seen = made.seen(seen)
    far = np.array([cosine_distance(x, human, made.followed).min() for human in seen])
    best, to_human = ground_truth(made, seen, 4, 1e-4, np.random.default_rng(0))
    made.certifier().require(best, MARGIN)
    assert (to_human <= far + 1e-6).all()
