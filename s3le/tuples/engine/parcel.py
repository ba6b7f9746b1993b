"""What a worker found in a file, as bytes: a tree of JSON and arrays, or why there is nothing."""

import io
import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from s3le.errors import EngineError

_TREE = "tree"


class Refusal(NamedTuple):
    """Why there is no answer for a file."""

    unreadable: bool  # else it was read, and no motion was found that holds
    why: str


def pack(tree: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> bytes:
    """A tree and arrays as bytes.

    Args:
        tree: what JSON can hold.
        arrays: numbers and words by name; none is called "tree".

    Raises:
        EngineError: the tree is no JSON, or holds a number that is not finite.
    """
    sink = io.BytesIO()
    try:
        words = np.array(json.dumps(tree, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise EngineError(f"what was found cannot be sent as JSON ({error})") from None
    np.savez(sink, allow_pickle=False, **{_TREE: words}, **arrays)
    return sink.getvalue()


def unpack(data: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What `pack` made bytes of."""
    with np.load(io.BytesIO(data), allow_pickle=False) as held:
        arrays = {name: held[name] for name in held.files}
    return json.loads(str(arrays.pop(_TREE))), arrays
