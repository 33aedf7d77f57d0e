"""How alike two samples of measured heights are: the numbers that LiDAR models are judged by.

A sample is an array of heights [m]; nan (no return) is left out. `model` is compared with `real`: what is
trusted more. Limits that count as good: `lab/comparison.py`.
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


def compare(model: ArrayLike, real: ArrayLike) -> Agreement:
    """All numbers at once; std_ratio is nan when the real deviation is 0."""
    a, b = _sample(model), _sample(real)
    below = float(b.std())
    return Agreement(
        wasserstein_m=wasserstein1(model, real),
        ks=ks_distance(model, real),
        intersection=histogram_intersection(model, real),
        p95_bias_m=float(np.percentile(a, 95.0) - np.percentile(b, 95.0)),
        mean_bias_m=float(a.mean() - b.mean()),
        std_ratio=float(a.std()) / below if below > 0.0 else float("nan"),
        ground_bias=float(np.mean(a < GROUND_BELOW)) - float(np.mean(b < GROUND_BELOW)),
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
