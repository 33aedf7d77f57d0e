"""Maximum-likelihood step: two populations of heights, each with its own mean and variance.

The heights of a profile in lateral order are cut where two normal populations explain them best. This is the
likelihood form of choosing the split of a series of distances by the standard deviations of its two parts
(US 10,225,984). Every beam is one independent look and counts once, so the density of the beams needs no
correction; between two beams the edge is uniform.
"""

import numpy as np

from swath.control.edge._detector import EdgeDetector, EdgeParams
from swath.core.registry import Level
from swath.core.signals import F64

FLOOR = 0.03  # m, standard deviation no population may fall below: range noise and soil roughness


def split_by_likelihood(z: F64, min_points: int) -> tuple[F64, float]:
    """Log-likelihood of a step up before each of the points 1..n-1, and the best one's gain over no step.

    z: heights in lateral order, stubble first [m], shape (n,). For a split into n1 and n2 points with
    variances v1 and v2: -(n1 ln v1 + n2 ln v2) / 2, up to a constant. Shape (n - 1,), -inf where a side has
    fewer than `min_points` or the step goes down. The gain is 0 when no split is allowed.
    """
    n = len(z)
    if n < 2 * min_points:
        return np.full(max(n - 1, 0), -np.inf), 0.0
    centred = z - z.mean()
    first = np.cumsum(centred)
    second = np.cumsum(centred * centred)
    low_count = np.arange(1, n, dtype=np.float64)
    high_count = n - low_count
    low = first[:-1] / low_count
    high = (first[-1] - first[:-1]) / high_count
    low_var = np.maximum(second[:-1] / low_count - low * low, 0.0) + FLOOR**2
    high_var = np.maximum((second[-1] - second[:-1]) / high_count - high * high, 0.0) + FLOOR**2
    score = -0.5 * (low_count * np.log(low_var) + high_count * np.log(high_var))
    allowed = (low_count >= min_points) & (high_count >= min_points) & (high > low)
    if not allowed.any():
        return np.full(n - 1, -np.inf), 0.0
    score[~allowed] = -np.inf
    return score, float(score.max() + 0.5 * n * np.log(second[-1] / n + FLOOR**2))


class MaxLikelihood(EdgeDetector):
    """Maximum-likelihood step per scan, robust parabola over several scans."""

    split = staticmethod(split_by_likelihood)


LEVEL = Level(
    MaxLikelihood,
    EdgeParams,
    summary="step between two height populations by maximum likelihood, tracked over several scans",
    cost="under 1 ms per scan",
    tolerance="offset within 0.05 m RMS of the true edge at 500 stems/m2",
)
