"""A robot's own chain among joints that others move: where they stand, and what they may sweep.

Seen from the last frame that carries both bodies of a pair, given joints that move by no more than
u_j move a body by no more than the sum of u_j r_j over the given joints between, r_j as in
s3le/safety/swept.py: at any angles. So a body that is thicker by that much contains it wherever
they are, and what is proven of thicker bodies while the given joints stand holds for every motion
of theirs within u. How much that is depends on the other body of the pair, so a body stands in the
folded chain once for each set of given joints that may lie between.
"""

import numpy as np

from s3le.kernels.distance import reach
from s3le.kernels.fold import fold
from s3le.robot.chain import Chain
from s3le.robot.wholebody import WholeBody
from s3le.safety.swept import Swept, swept


class Folded:
    """One robot's chain of ours; its arrays are written anew by every call. One per thread."""

    chain: Chain  # of ours; pairs as in WholeBody.robot.watched
    swept: Swept

    def __init__(self, body: WholeBody) -> None:
        """Lay out the chain, given joints as the robot file holds them.

        Args:
            body: the robot, and which joints others move.
        """
        whole, own, given = body.robot.chain, body.own, body.others
        far = swept(whole)
        self._whole, self._own, self._given = whole, own, given
        depth = whole.moves[1:].sum(axis=1)
        before = np.where(whole.moves[:, own], depth[own], 0)  # (N + 1, n)
        last = np.where(before.any(axis=1), before.argmax(axis=1) + 1, 0)  # frames of `chain`
        self._near = np.concatenate([[0], own + 1])[last]
        kinds: dict[tuple[int, bytes], int] = {}
        pair, between = np.empty_like(whole.pair), []
        source: list[int] = []
        for row, bodies in enumerate(whole.pair):
            carried = whole.moves[far.carrier[row]]
            for side, one in enumerate(bodies):
                some = (whole.moves[whole.body_frame[one]] & ~carried)[given]
                kind = (int(one), some.tobytes())
                if kind not in kinds:
                    kinds[kind] = len(source)
                    source.append(int(one))
                    between.append(some * far.radius[one, given])
                pair[row, side] = kinds[kind]
        self._source = np.array(source, np.int64)
        self._share = np.array(between).reshape(len(source), len(given))  # [m/rad]
        self._thin = whole.body_radius[self._source]
        base, parts = body.base.chain, len(source)
        self.chain = base._replace(  # bodies of both are in the same order (with_joints)
            rotation=base.rotation.copy(),
            translation=base.translation.copy(),
            point=base.point.copy(),
            body_frame=base.body_frame[self._source],
            body_a=np.empty((parts, 3)),
            body_b=np.empty((parts, 3)),
            body_radius=self._thin.copy(),
            pair=np.ascontiguousarray(pair),
            slack=whole.slack,
            floor=whole.floor,
        )
        self._pose = np.zeros(len(whole.parent))
        self._place(body.robot.anchor[given])
        self._balls = reach(self.chain)
        # Levers of ours as they are at any angles of the given joints between.
        self.swept = swept(self.chain)._replace(
            radius=np.ascontiguousarray(far.radius[self._source][:, own]),
            balls=self._balls.copy(),
        )

    def stand(self, given: np.ndarray, within: np.ndarray | None = None) -> None:
        """Write where the given joints stand, and how far from there they may be.

        Args:
            given: angles [rad], (k,).
            within: how far each may be from there [rad], (k,); None: not at all.
        """
        self._place(given)
        thick = 0.0 if within is None else self._share @ within
        self.chain.body_radius[:] = self._thin + thick
        self.swept.balls[:] = self._balls + thick

    def _place(self, given: np.ndarray) -> None:
        self._pose[self._given] = given
        fold(self._whole, self._near, self._own, self._source, self._pose, self.chain)
