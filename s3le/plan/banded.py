"""Symmetric positive definite systems with a band, compiled: what a plan over time comes down to.

Joint i of frame t is unknown number t n + i. A frame's own weight matrix couples unknowns less
than n apart, a speed two frames, n apart, an acceleration three, so that half the band is 2 n wide
and the cost of a factor grows with the length of the motion, not with its cube.
"""

from s3le.kernels.compiled import compiled


@compiled
def factor(A, tiny):
    """Cholesky factor in place.

    Args:
        A: (m, b + 1), the matrix column by column from the diagonal down, A[j, k] = M[j + k, j];
            what would lie below the last row is not read.
        tiny: least pivot; one that is smaller is raised to it.

    Returns:
        False where a pivot was not finite.
    """
    m, width = A.shape
    for j in range(m):
        pivot = A[j, 0]
        if not pivot > tiny:
            if not pivot > -1e300:  # NaN, or beyond repair
                return False
            pivot = tiny
        if not pivot < 1e300:
            return False
        scale = 1.0 / pivot**0.5
        reach = min(width, m - j)
        column = A[j]
        for k in range(reach):
            column[k] *= scale
        column[0] = 1.0 / scale
        for r in range(1, reach):
            c = column[r]
            if c != 0.0:
                row = A[j + r]
                for k in range(reach - r):
                    row[k] -= c * column[r + k]
    return True


@compiled
def solve_with(A, x):
    """Solve in place, x (m,), with the factor A."""
    m, width = A.shape
    for j in range(m):
        reach = min(width, m - j)
        column = A[j]
        v = x[j] / column[0]
        x[j] = v
        for k in range(1, reach):
            x[j + k] -= column[k] * v
    for j in range(m - 1, -1, -1):
        reach = min(width, m - j)
        column = A[j]
        first = x[j]
        second = 0.0
        k = 1
        while k + 1 < reach:
            first -= column[k] * x[j + k]
            second -= column[k + 1] * x[j + k + 1]
            k += 2
        if k < reach:
            first -= column[k] * x[j + k]
        x[j] = (first + second) / column[0]
