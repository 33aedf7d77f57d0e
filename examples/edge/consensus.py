"""Random sample consensus: the straight line that most edge points of the last metres agree with.

    edge: {level: examples/edge/consensus.py:Consensus}

After Cho et al. 2014 (EAEF 7(3):115), who fit a line by RANSAC (Fischler & Bolles 1981,
doi:10.1145/358669.358692) to the boundary in a map of several scans. Points of a scan come from Otsu's
threshold. No pairs are drawn: all pairs of some points of the window are tried.
"""

import numpy as np

from swath.control.edge.detector import EdgeDetector
from swath.control.edge.line_fit import Line, Prior
from swath.control.edge.otsu import split_by_otsu
from swath.core.portable import product, solve
from swath.signals import F64

CLOSE = 0.10  # m from the line: a point agrees
POINTS = 24  # of the window whose pairs are tried
STEEPEST = 0.5  # slope of a line that is tried


def fit_consensus(
    x: F64, u: F64, variance: F64, x0: float, prior: Prior, start: Line | None
) -> tuple[Line, F64]:
    """The line that most points agree with, by least squares through those; each point's weight, 0 or 1.

    As `line_fit.fit_line`; a line has no bend, and `variance`, `start` do not count.
    """
    some = np.linspace(0, len(x) - 1, min(POINTS, len(x))).round().astype(np.int64)
    first, second = (some[k] for k in np.triu_indices(len(some), 1))
    way = x[second] - x[first]
    apart = np.abs(way) > 0.2
    slope = np.zeros(1)
    through = np.array([int(np.argsort(u, kind="stable")[len(u) // 2])])
    if apart.any():
        slope = np.append(slope, (u[second] - u[first])[apart] / way[apart])
        through = np.append(through, first[apart])
        slope = np.where(np.abs(slope) < STEEPEST, slope, 0.0)
    beside = u - u[through][:, None] - slope[:, None] * (x - x[through][:, None])
    agree = np.abs(beside) < CLOSE
    weight = agree[int(np.argmax(agree.sum(axis=1)))].astype(np.float64)
    basis = np.stack([np.ones_like(x), x - x0])
    normal = product(basis * weight, basis.T) + np.diag([1e-9, CLOSE**2 / prior.slope**2])
    offset, steep = solve(normal, product(basis * weight, u)).tolist()
    return Line(x0, offset, steep, 0.0), weight


class Consensus(EdgeDetector):
    """Otsu threshold per scan, the line of most agreement over several scans."""

    split = staticmethod(split_by_otsu)
    fit = staticmethod(fit_consensus)
