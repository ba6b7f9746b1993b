"""A guard's state, as it was stored: plain arrays by name, held against what they must be."""

from collections.abc import Mapping

import numpy as np

from s3le.errors import StateError

_MAY_BE_NAN = ("before", "asked", "pace")  # there was none yet


def checked(
    state: Mapping[str, np.ndarray], own: Mapping[str, np.ndarray], tag: str
) -> dict[str, np.ndarray]:
    """The arrays of a state, copies, by name; all but the robot's tag.

    Args:
        state: as it is given.
        own: a state of the guard itself, for kinds and shapes.
        tag: of its robot.

    Raises:
        StateError: something is missing, of another kind, or another robot's.
    """
    for name, like in own.items():
        if name not in state:
            raise StateError(f"a state lacks '{name}'")
        given = np.asarray(state[name])
        part = slice(1 if name == "out" else 0, None)  # a way out has any number of poses
        if given.dtype.kind != like.dtype.kind or given.shape[part] != like.shape[part]:
            raise StateError(f"a state's '{name}' is of another kind or shape")
        if given.dtype.kind == "f" and name not in _MAY_BE_NAN and not np.isfinite(given).all():
            raise StateError(f"a state's '{name}' is not finite")
    if str(state["robot"]) != tag:
        raise StateError(f"the state is of {state['robot']!s:.100}, not of {tag}")
    return {name: np.array(state[name]) for name in own if name != "robot"}
