"""One independent random stream per purpose, all from the one seed.

Drawing more in one stage does not shift another, and a row's numbers do not depend on workers.
"""

import zlib

import numpy as np


def stream(seed: int, purpose: str) -> np.random.Generator:
    """Generator for one purpose (a stage's name): same seed and purpose, same numbers."""
    return np.random.default_rng(np.random.SeedSequence([seed, zlib.crc32(purpose.encode())]))
