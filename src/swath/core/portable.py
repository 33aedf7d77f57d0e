"""Functions of arrays whose last bit is the same on every x86-64 processor with AVX2.

numpy has other code for `exp`, `log`, `arctan2`, `**` and others where the processor has AVX-512, and
OpenBLAS, behind `@` and most of `numpy.linalg`, chooses its code by the processor; the last bit follows. Here
elementary functions are those of the C library, one element after the other (about 40 ns each), and products
add in a fixed order. Safe as they are: `numpy.sin`, `cos`, `tanh`, `hypot` and `sqrt`, sums and means,
`einsum`, `linalg.norm` with an axis, and `math` for single numbers. `sum` of floats is compensated from
Python 3.12 on: `math.fsum` is the same everywhere.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def exp(x: Any) -> Array:
    """Exponential e ** x, elementwise; inf where that is too large."""
    return _each(math.exp, np.exp, x)


def log(x: Any) -> Array:
    """Natural logarithm, elementwise; -inf of 0, nan below."""
    return _each(math.log, np.log, x)


def log1p(x: Any) -> Array:
    """log(1 + x), elementwise; -inf of -1, nan below."""
    return _each(math.log1p, np.log1p, x)


def tan(x: Any) -> Array:
    """Tangent of angles [rad], elementwise."""
    return _each(math.tan, np.tan, x)


def arctan(x: Any) -> Array:
    """Arc tangent [rad], elementwise."""
    return _each(math.atan, np.arctan, x)


def arcsin(x: Any) -> Array:
    """Arc sine [rad], elementwise; nan outside [-1, 1]."""
    return _each(math.asin, np.arcsin, x)


def arctan2(y: Any, x: Any) -> Array:
    """Angle [rad] of (x, y), elementwise, in [-pi, pi]."""
    return _each(math.atan2, np.arctan2, y, x)


def power(x: Any, y: Any) -> Array:
    """Power x ** y, elementwise; inf of 0 to a negative power, nan of x < 0 to a power that is not whole."""
    return _each(math.pow, np.power, x, y)


def median(x: Any) -> float:
    """Median of finite values, (n,), n > 0: the number that `numpy.median` gives, which takes much longer
    for some hundreds of them.
    """
    ordered = np.sort(x)
    half = len(ordered) // 2
    return float(ordered[half] if len(ordered) % 2 else 0.5 * (ordered[half - 1] + ordered[half]))


def geomspace(first: float, last: float, count: int) -> Array:
    """Numbers from first > 0 to last > 0 whose ratios are equal, (count,)."""
    return exp(np.linspace(math.log(first), math.log(last), count))


def product(a: Any, b: Any) -> Any:
    """`a @ b`: of matrices (..., n, k) and (..., k, m), or of vectors where one has a single axis."""
    a, b = np.asarray(a), np.asarray(b)
    if a.ndim == 1:
        return np.einsum("k,k->" if b.ndim == 1 else "k,...km->...m", a, b)
    return np.einsum("...nk,k->...n" if b.ndim == 1 else "...nk,...km->...nm", a, b)


def solve(matrix: Any, right: Any) -> Array:
    """Solution x of matrix @ x = right, shapes (n, n) and (n,), n small; elimination with pivots.

    Raises ZeroDivisionError for a singular matrix.
    """
    rows = [
        [*row, float(last)] for row, last in zip(np.asarray(matrix, np.float64).tolist(), right, strict=True)
    ]
    n = len(rows)
    for i in range(n):
        pivot = max(range(i, n), key=lambda r: abs(rows[r][i]))
        rows[i], rows[pivot] = rows[pivot], rows[i]
        for below in rows[i + 1 :]:
            share = below[i] / rows[i][i]
            for j in range(i, n + 1):
                below[j] -= share * rows[i][j]
    x = [0.0] * n
    for i in reversed(range(n)):
        residual = rows[i][n]
        for j in range(i + 1, n):
            residual -= rows[i][j] * x[j]
        x[i] = residual / rows[i][i]
    return np.array(x)


def inverse(matrix: Any) -> Array:
    """Inverse of a small matrix (n, n), a column at a time by `solve`."""
    return np.column_stack([solve(matrix, unit) for unit in np.eye(len(matrix))])


def _each(function: Callable[..., float], limits: Callable[..., Any], *values: Any) -> Array:
    """A function of each element; limits: numpy's, asked where `math` raises: its inf and nan."""
    arrays = tuple(np.asarray(v, dtype=np.float64) for v in values)
    arrays = arrays if len(arrays) == 1 else np.broadcast_arrays(*arrays)
    columns = [a.ravel().tolist() for a in arrays]
    try:
        found = list(map(function, *columns))
    except (ValueError, OverflowError):
        found = [_one(function, limits, *row) for row in zip(*columns, strict=True)]
    return np.array(found, dtype=np.float64).reshape(arrays[0].shape)


def _one(function: Callable[..., float], limits: Callable[..., Any], *values: float) -> float:
    try:
        return function(*values)
    except (ValueError, OverflowError):
        with np.errstate(all="ignore"):
            return float(limits(*values))
