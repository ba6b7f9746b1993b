"""One independent random stream per purpose, all from the one seed.

Drawing more in one stage does not shift another, and a row's numbers do not depend on workers.
"""

import zlib

import numpy as np


def stream(seed: int, purpose: str, *part: int) -> np.random.Generator:
    """Generator for one purpose (a stage's name) or a numbered part of it (a shard).

    The same seed, purpose and part give the same numbers.
    """
    words = [seed, zlib.crc32(purpose.encode()), *part]
    return np.random.default_rng(np.random.SeedSequence(words))
