"""Otsu step: a height threshold first, then the place that separates high from low echoes best.

Otsu 1979 (doi:10.1109/TSMC.1979.4310076) picks the threshold that maximises the variance between two classes;
Zhao et al. 2016 (IJABE 9(2):21) used it per profile with a line over several, for wheat.
"""

from math import log

import numpy as np

from swath.control.edge.detector import EdgeDetector, EdgeParams
from swath.core.registry import Level
from swath.signals import F64

ERROR_ODDS = 3.0  # nat: log odds of an echo being on the right side of the threshold, 95 %


def otsu_threshold(z: F64) -> tuple[float, float]:
    """(threshold [m], share of the variance that lies between the two classes) of values, shape (n,)."""
    n = len(z)
    ordered = np.sort(z)
    centred = np.cumsum(ordered - ordered.mean())[:-1]
    low_count = np.arange(1, n, dtype=np.float64)
    between = centred**2 / (low_count * (n - low_count))
    best = int(np.argmax(between))
    total = float(np.var(z))
    share = float(between[best]) / total if total > 0.0 else 0.0
    return 0.5 * float(ordered[best] + ordered[best + 1]), share


def split_by_otsu(z: F64, min_points: int) -> tuple[F64, float]:
    """`split_at` the threshold of these very heights."""
    return split_at(otsu_threshold(z)[0] if len(z) > 1 else 0.0, z, min_points)


def split_at(threshold: float, z: F64, min_points: int) -> tuple[F64, float]:
    """Log-odds of a step before each of the points 1..n-1 from the echoes it would leave on the wrong side.

    threshold [m]; z: heights in lateral order, stubble first [m], shape (n,). Shape (n - 1,), -inf where a
    side has fewer than `min_points`. The gain [nat] is the log-likelihood of the best split over no step,
    both with an echo's side as a coin of its observed chance.
    """
    n = len(z)
    if n < 2 * min_points:
        return np.full(max(n - 1, 0), -np.inf), 0.0
    is_high = z > threshold
    high_before = np.cumsum(is_high)[:-1]
    low_after = (n - is_high.sum()) - (np.arange(1, n) - high_before)
    wrong = high_before + low_after
    score = -ERROR_ODDS * wrong.astype(np.float64)
    count = np.arange(1, n)
    allowed = (count >= min_points) & (n - count >= min_points)
    score[~allowed] = -np.inf
    best = int(np.argmax(score))
    gain = _coin(int(is_high.sum()), n) - _coin(int(wrong[best]), n)
    return score, max(gain, 0.0)


def _coin(count: int, n: int) -> float:
    """Entropy [nat] of n draws of which `count` fell on one side."""
    share = min(max(count / n, 1e-9), 1.0 - 1e-9)
    return -n * (share * log(share) + (1.0 - share) * log(1.0 - share))


class Otsu(EdgeDetector):
    """Otsu threshold per scan, robust parabola over several scans."""

    split = staticmethod(split_by_otsu)


LEVEL = Level(
    Otsu,
    EdgeParams,
    summary="step at a height threshold after Otsu, tracked over several scans",
    cost="1 ms per scan",
    tolerance="offset within 0.05 m RMS of the true edge at 500 stems/m2; less in thin crop",
)
