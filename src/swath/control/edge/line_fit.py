"""The edge as a parabola over the machine's x axis, and its robust fit."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from swath.control.edge.shared import shared
from swath.core.packed_state import saved_type
from swath.core.portable import median, product, solve
from swath.signals import F64

TUKEY = 4.685  # 95 % efficiency on normal errors; Beaton & Tukey 1974, doi:10.1080/00401706.1974.10489171
MAD = 1.4826  # normal standard deviation / median absolute deviation


@saved_type()
class Line(NamedTuple):
    """u(x) = offset + slope (x - x0) + bend (x - x0)^2 / 2, all in metres of the (x, u) frame."""

    x0: float
    offset: float
    slope: float
    bend: float

    def at(self, x: F64 | float) -> F64 | float:
        """u [m] at x [m]."""
        ahead = x - self.x0
        return self.offset + ahead * (self.slope + 0.5 * self.bend * ahead)

    def slope_at(self, x: F64 | float) -> F64 | float:
        """du/dx [1] at x [m]."""
        return self.slope + self.bend * (x - self.x0)

    def moved(self, distance: float, turn: float) -> "Line":
        """The same edge after the machine drove `distance` [m] and turned `turn` [rad] toward +u.

        First order in `turn`: for steps of a scan period.
        """
        offset = self.offset + distance * (self.slope + 0.5 * self.bend * distance)
        slope = self.slope + self.bend * distance
        turned = offset - self.x0 * turn + slope * offset * turn
        return Line(self.x0, turned, slope - turn * (1.0 + slope * slope), self.bend)


@dataclass(frozen=True)
class Prior:
    """How far an edge may be from straight ahead: standard deviations of slope [1] and bend [1/m]."""

    slope: float = 0.07
    bend: float = 0.02


# x, u [m], variance [m2], (n,) each, x0 [m], prior, line to start from -> line, remaining weights (n,)
LineFit = Callable[[F64, F64, F64, float, Prior, Line | None], tuple[Line, F64]]


def _key(x: F64, u: F64, variance: F64, x0: float, prior: Prior, start: Line | None) -> Hashable:
    return x.tobytes(), u.tobytes(), variance.tobytes(), x0, prior, start


@shared(_key)
def fit_line(x: F64, u: F64, variance: F64, x0: float, prior: Prior, start: Line | None) -> tuple[Line, F64]:
    """Weighted robust parabola through edge points, and each point's remaining weight (0 = outlier).

    x, u [m], variance [m2], shape (point_count,), at least one point. Iteratively reweighted least squares
    with Tukey's biweight around `start` (around the weighted median when there is none). The prior keeps
    slope and bend near zero while the points are too few or too close together to tell.
    """
    ahead = x - x0
    base = 1.0 / variance
    ridge = np.diag([0.0, 1.0 / prior.slope**2, 1.0 / prior.bend**2])
    if start is None:
        line = Line(x0, median(u), 0.0, 0.0)
    else:
        line = start
    robust = np.ones_like(u)
    basis = np.stack([np.ones_like(ahead), ahead, 0.5 * ahead * ahead])
    for _ in range(4):
        residual = u - line.at(x)
        spread = np.sqrt(variance + (MAD * median(np.abs(residual))) ** 2)
        robust = np.maximum(1.0 - (residual / (TUKEY * spread)) ** 2, 0.0) ** 2
        if float(robust.sum()) < 0.5:
            robust = np.ones_like(u)
        weighted = basis * (base * robust)
        normal = product(weighted, basis.T) + ridge
        offset, slope, bend = solve(normal, product(weighted, u))
        line = Line(x0, float(offset), float(slope), float(bend))
    return line, robust
