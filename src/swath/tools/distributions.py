"""How alike two samples of measured heights are: the numbers that LiDAR models are judged by.

A sample is an array of heights [m]; nan (no return) is left out. `model` is compared with `real`: what is
trusted more. Limits that count as good (heights of a ripe stand, two beams, three angles): Wasserstein-1
2 cm, KS 0.10, intersection 0.85, P95 bias 2 cm, std ratio 0.8 to 1.25, ground share within 0.05.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from swath.core.errors import InputError
from swath.signals import F64

GROUND_BELOW = 0.05  # returns lower than this above the ground count as ground [m]
BIN = 0.02  # of histograms [m]


@dataclass(frozen=True)
class Agreement:
    """model against real: wasserstein_m, p95_bias_m, mean_bias_m [m]; ks; intersection; std_ratio.

    ground_bias: difference of the shares of ground returns
    """

    wasserstein_m: float
    ks: float
    intersection: float
    p95_bias_m: float
    mean_bias_m: float
    std_ratio: float
    ground_bias: float

    @property
    def is_good(self) -> bool:
        """Within the limits of this module, the intersection aside."""
        return (
            self.wasserstein_m <= 0.02
            and self.ks <= 0.10
            and abs(self.p95_bias_m) <= 0.02
            and 0.8 <= self.std_ratio <= 1.25
            and abs(self.ground_bias) <= 0.05
        )


def compare(model: ArrayLike, real: ArrayLike, *, ground_below: float = GROUND_BELOW) -> Agreement:
    """All numbers at once."""
    return Agreement(
        wasserstein_m=wasserstein1(model, real),
        ks=ks_distance(model, real),
        intersection=histogram_intersection(model, real),
        p95_bias_m=percentile_bias(model, real, 95.0),
        mean_bias_m=float(_sample(model).mean() - _sample(real).mean()),
        std_ratio=std_ratio(model, real),
        ground_bias=ground_share(model, ground_below) - ground_share(real, ground_below),
    )


def wasserstein1(model: ArrayLike, real: ArrayLike) -> float:
    """Wasserstein-1 distance: the area between both empirical distribution functions."""
    a, b = np.sort(_sample(model)), np.sort(_sample(real))
    at = np.sort(np.concatenate([a, b]))
    return float(np.sum(np.abs(_gap(a, b, at[:-1])) * np.diff(at)))


def ks_distance(model: ArrayLike, real: ArrayLike) -> float:
    """Kolmogorov-Smirnov distance: the largest gap between both empirical distribution functions."""
    a, b = np.sort(_sample(model)), np.sort(_sample(real))
    return float(np.max(np.abs(_gap(a, b, np.concatenate([a, b])))))


def histogram_intersection(model: ArrayLike, real: ArrayLike) -> float:
    """Common area of both normalised histograms, 0..1. Bins start at whole multiples of their width."""
    a, b = (np.floor(_sample(s) / BIN).astype(np.int64) for s in (model, real))
    low = min(a.min(), b.min())
    count = int(max(a.max(), b.max()) - low) + 1
    share_a = np.bincount(a - low, minlength=count) / len(a)
    share_b = np.bincount(b - low, minlength=count) / len(b)
    return float(np.minimum(share_a, share_b).sum())


def percentile_bias(model: ArrayLike, real: ArrayLike, percent: float) -> float:
    """Difference of a percentile [m]."""
    return float(np.percentile(_sample(model), percent) - np.percentile(_sample(real), percent))


def std_ratio(model: ArrayLike, real: ArrayLike) -> float:
    """Ratio of the standard deviations; nan when the real one is 0."""
    below = float(_sample(real).std())
    return float(_sample(model).std()) / below if below > 0.0 else float("nan")


def ground_share(heights: ArrayLike, below: float = GROUND_BELOW) -> float:
    """Share of the returns that lie lower than `below` [m]."""
    return float(np.mean(_sample(heights) < below))


def _gap(a: F64, b: F64, at: F64) -> F64:
    """Difference of the empirical distribution functions of sorted samples."""
    below_a, below_b = np.searchsorted(a, at, side="right"), np.searchsorted(b, at, side="right")
    return np.asarray(below_a / len(a) - below_b / len(b))


def _sample(heights: ArrayLike) -> F64:
    values = np.asarray(heights, dtype=np.float64).ravel()
    values = values[~np.isnan(values)]
    if len(values) == 0:
        raise InputError("heights", None, "expected at least one return")
    return values
