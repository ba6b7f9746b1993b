"""A layout opened again beside the first, other joints for it, and the words of a refusal."""

from importlib.util import find_spec

import pytest
from layouts import KINDS, robot

from s3le.errors import TrajectoryError
from s3le.guard.layouts.door import open_layout

H5PY = pytest.mark.skipif(find_spec("h5py") is None, reason="no h5py")
ALL = [pytest.param(name, marks=H5PY) if name == "hdf5" else name for name in KINDS]
MOVED = range(5, 9)  # rows that a test moves


def opened(kind, path):
    return open_layout(path, robot(kind.robot), **kind.options)


def beside(path):
    return path.with_name(f"other{path.suffix}")


def moved(one):
    """Two joints elsewhere in some rows, by what no file holds to the last digit."""
    q = one.q.copy()
    q[MOVED, 0] += 0.05 / 3.0
    q[MOVED, 2] -= 0.04 / 3.0
    return q


def refused(path, *words, of="g1", **options):
    with pytest.raises(TrajectoryError) as error:
        open_layout(path, robot(of), **options)
    said = str(error.value)
    assert str(path) in said and "\n" not in said
    for word in words:
        assert word in said, said
