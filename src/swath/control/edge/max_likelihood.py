"""Maximum-likelihood step: two populations of heights, each with its own mean and variance.

The heights of a profile in lateral order are cut where two normal populations explain them best: the
likelihood form of a split by the standard deviations of both parts (US 10,225,984).
"""

from math import log

import numpy as np

from swath.control.edge.detector import EdgeDetector, EdgeParams
from swath.core import portable
from swath.core.registry import Level
from swath.signals import F64

FLOOR = 0.03  # m, standard deviation no population may fall below: range noise and soil roughness
STRAY_LOW, STRAY_HIGH = 0.05, 0.15  # share of echoes on either side that are something else: weeds, gaps
STRAY_DENSITY = 1.0  # 1/m, of stray heights: anywhere within a metre


def split_by_likelihood(z: F64, min_points: int) -> tuple[F64, float]:
    """Log-likelihood of a step up before each of the points 1..n-1, and the best one's gain over no step.

    z: heights in lateral order, stubble first [m], shape (n,). The populations come from the best split into
    n1 and n2 points with variances v1 and v2: -(n1 ln v1 + n2 ln v2) / 2. Then, with a share of strays in
    each, the place follows from the log-likelihood ratios of single echoes, so that a low echo in thin crop
    cannot pull it. -inf where a side has fewer than `min_points` or the step goes down; gain 0 with no split.
    """
    n = len(z)
    if n < 2 * min_points:
        return np.full(max(n - 1, 0), -np.inf), 0.0
    score, gain = _two_normals(z, min_points)
    if not np.isfinite(gain):
        return score, 0.0
    first = int(np.argmax(score)) + 1
    crop = _log_density(z, z[first:], STRAY_HIGH)
    stubble = _log_density(z, z[:first], STRAY_LOW)
    place = np.cumsum(stubble - crop)[:-1]
    return np.where(np.isfinite(score), place, -np.inf), gain


def _two_normals(z: F64, min_points: int) -> tuple[F64, float]:
    """(log-likelihood of every split with its own two means and variances, gain over one population)."""
    n = len(z)
    centred = z - z.mean()
    first = np.cumsum(centred)
    second = np.cumsum(centred * centred)
    low_count = np.arange(1, n, dtype=np.float64)
    high_count = n - low_count
    low = first[:-1] / low_count
    high = (first[-1] - first[:-1]) / high_count
    low_var = np.maximum(second[:-1] / low_count - low * low, 0.0) + FLOOR**2
    high_var = np.maximum((second[-1] - second[:-1]) / high_count - high * high, 0.0) + FLOOR**2
    score = -0.5 * (low_count * portable.log(low_var) + high_count * portable.log(high_var))
    allowed = (low_count >= min_points) & (high_count >= min_points) & (high > low)
    score[~allowed] = -np.inf
    return score, float(score.max() + 0.5 * n * log(second[-1] / n + FLOOR**2))


def _log_density(z: F64, population: F64, stray: float) -> F64:
    """Log density of heights [ln 1/m] in a normal population with a share of stray ones."""
    middle = float(population.mean())
    variance = float(population.var()) + FLOOR**2
    normal = portable.exp(-0.5 * (z - middle) ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)
    return np.asarray(portable.log((1.0 - stray) * normal + stray * STRAY_DENSITY))


class MaxLikelihood(EdgeDetector):
    """Maximum-likelihood step per scan, robust parabola over several scans."""

    split = staticmethod(split_by_likelihood)


LEVEL = Level(
    MaxLikelihood,
    EdgeParams,
    summary="step between two height populations by maximum likelihood, tracked over several scans",
    cost="1.1 ms per scan",
    tolerance="offset within 0.05 m RMS of the true edge at 500 stems/m2",
)
