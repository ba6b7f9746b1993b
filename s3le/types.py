"""Names for types that many rooms share."""

from collections.abc import Callable

import numpy as np

Progress = Callable[[int], object]  # called with numbers of further rows done
Columns = dict[str, np.ndarray]  # columns of a table by name, each (n,) or (n, width)
