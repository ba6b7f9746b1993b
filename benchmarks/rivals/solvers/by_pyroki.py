"""PyRoki from a user's clones of chungmin99/pyroki and brentyi/jaxls: least squares in JAX.

Six points at weight 50, joint limits at weight 100, and a pull to the anchor at weight `rest`, as
its example for many targets has them (whose pull of 1 is to the middle of the ranges); each frame
begins at the last pose. Collisions are left off, as those who use it for retargeting leave them: a
solve with them takes a second and more on a processor. It is compiled before the first frame, which
counts into the seconds to the first motion.
"""

import io
from collections.abc import Callable

import numpy as np
from plain import POINTS, Goal, Plain, Writer

from solvers import versions


def about() -> dict[str, str]:
    """Versions."""
    return versions("jax", "jaxlib", "jaxlie", "jax_dataclasses")


def make(robot: Plain, dt: float, settings: dict) -> Callable[[Goal, np.ndarray], np.ndarray]:
    """What solves a frame."""
    import jax
    import jax.numpy as jnp
    import jaxlie
    import jaxls
    import pyroki as pk
    import yourdfpy

    written = Writer(robot).bare
    model = yourdfpy.URDF.load(io.StringIO(written.text), build_scene_graph=True)
    made = pk.Robot.from_urdf(model)
    own = list(made.joints.actuated_names)
    at = np.array([own.index(name) for name in robot.names])
    links = jnp.array([made.links.names.index(written.points[role]) for role in POINTS])
    rest = np.zeros(len(own))
    rest[at] = robot.anchor
    pull = float(settings.get("rest", 0.1))
    variable = made.joint_var_cls

    @jax.jit
    def solved(places: jax.Array, start: jax.Array) -> jax.Array:
        count = len(POINTS)
        turns = jaxlie.SO3(jnp.tile(jnp.array([1.0, 0.0, 0.0, 0.0]), (count, 1)))
        costs = [
            pk.costs.pose_cost_analytic_jac(
                jax.tree.map(lambda x: x[None], made),
                variable(jnp.zeros(count, int)),
                jaxlie.SE3.from_rotation_and_translation(turns, places),
                links,
                pos_weight=50.0,
                ori_weight=0.0,
            ),
            pk.costs.rest_cost(variable(0), rest_pose=jnp.array(rest), weight=pull),
            pk.costs.limit_cost(made, variable(0), jnp.array([100.0] * made.joints.num_joints)),
        ]
        found = (
            jaxls.LeastSquaresProblem(costs, [variable(0)])
            .analyze()
            .solve(
                initial_vals=jaxls.VarValues.make([variable(0).with_value(start)]),
                verbose=False,
                linear_solver="dense_cholesky",
                trust_region=jaxls.TrustRegionConfig(lambda_initial=10.0),
            )
        )
        return found[variable(0)]

    solved(jnp.zeros((len(POINTS), 3)), jnp.array(rest)).block_until_ready()

    def solve(goal: Goal, q: np.ndarray) -> np.ndarray:
        full = np.zeros(len(own))
        full[at] = q
        return np.asarray(solved(jnp.array(goal.points), jnp.array(full)), float)[at]

    return solve
