"""One path at a time, proven by the door that proves many."""

from typing import NamedTuple

import numpy as np

from s3le.safety import paths
from s3le.safety.paths import certify

BETWEEN = 0.0005  # [m]


class Proof(NamedTuple):
    """What is known of one path; see paths.Segments."""

    status: int
    bound: float
    until: float
    t: float
    pair: int
    clearance: float
    used: int


def prove(made, q0, q1, margin=BETWEEN, budget=paths.BUDGET):
    found = certify(made, np.stack([q0, q1]), margin, budget)
    return Proof(*(column[0].item() for column in found))
