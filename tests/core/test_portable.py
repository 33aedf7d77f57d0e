"""Portable arithmetic against the C library and numpy: values, limits, shapes."""

import math

import numpy as np
import pytest

from swath.core import portable

CASES = [
    (portable.exp, math.exp, (-40.0, 40.0)),
    (portable.log, math.log, (1e-9, 50.0)),
    (portable.log1p, math.log1p, (-0.99, 5.0)),
    (portable.tan, math.tan, (-1.5, 1.5)),
    (portable.arctan, math.atan, (-9.0, 9.0)),
    (portable.arcsin, math.asin, (-1.0, 1.0)),
]


@pytest.mark.parametrize(("ours", "one", "span"), CASES)
def test_elementary_functions_are_those_of_the_c_library(ours, one, span):
    x = np.linspace(*span, 60).reshape(3, 4, 5)
    assert np.array_equal(ours(x), np.array([one(v) for v in x.ravel()]).reshape(x.shape))
    assert ours(x[0, 0, 0]).shape == ()


def test_functions_of_two_numbers_broadcast():
    y, x = np.linspace(-1.0, 1.0, 5)[:, None], np.linspace(-2.0, 2.0, 4)
    assert np.array_equal(
        portable.arctan2(y, x), [[math.atan2(a, b) for b in x.tolist()] for a in y.ravel().tolist()]
    )
    assert np.array_equal(portable.power(np.array([0.0, 1.0, 4.0]), 0.5), [0.0, 1.0, 2.0])


def test_limits_are_those_of_numpy():
    inf, nan = np.inf, np.nan
    assert np.array_equal(
        portable.log([0.0, -1.0, inf, nan, 1.0]), [-inf, nan, inf, nan, 0.0], equal_nan=True
    )
    assert np.array_equal(portable.exp([1e4, -1e4, -inf, inf]), [inf, 0.0, 0.0, inf])
    assert np.array_equal(portable.log1p([-1.0, -2.0]), [-inf, nan], equal_nan=True)
    assert np.array_equal(portable.power([0.0, 0.0, -1.0], [-1.0, 0.0, 0.5]), [inf, 1.0, nan], equal_nan=True)
    assert np.array_equal(portable.arcsin([1.5, 1.0]), [nan, math.asin(1.0)], equal_nan=True)


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ((3,), (3,)),
        ((4, 3), (3,)),
        ((3,), (3, 5)),
        ((4, 3), (3, 5)),
        ((2, 4, 3), (3, 5)),
        ((2, 4, 3), (2, 3, 5)),
    ],
)
def test_product_is_that_of_matrices(a, b):
    rng = np.random.default_rng(1)
    left, right = rng.normal(size=a), rng.normal(size=b)
    assert portable.product(left, right) == pytest.approx(left @ right, rel=1e-12)


def test_solve_takes_the_largest_pivot_and_refuses_a_singular_matrix():
    rng = np.random.default_rng(2)
    for _ in range(20):
        matrix, x = rng.normal(size=(3, 3)), rng.normal(size=3)
        assert portable.solve(matrix, matrix @ x) == pytest.approx(x, rel=1e-9)
    assert portable.solve([[0.0, 1.0], [1.0, 0.0]], [2.0, 3.0]) == pytest.approx([3.0, 2.0])
    with pytest.raises(ZeroDivisionError):
        portable.solve(np.ones((2, 2)), np.ones(2))


def test_geomspace_has_equal_ratios():
    assert portable.geomspace(0.02, 0.3, 8) == pytest.approx(np.geomspace(0.02, 0.3, 8), rel=1e-14)
