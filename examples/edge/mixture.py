"""Two normal populations of heights by expectation maximisation, carried from scan to scan.

    edge: {level: examples/edge/mixture.py:Mixture}

After Kneip et al. 2020 (RAS 123:103323): every echo gets its odds of being crop, Bayes' rule adds them up.
Theirs adds up in the cells of a grid; here along the lateral order, and successive scans meet in the track.
"""

from math import log
from typing import ClassVar

import numpy as np

from swath.control.edge.detector import EdgeDetector, EdgeParams
from swath.core import portable
from swath.core.component import Outputs
from swath.core.random import Stream
from swath.signals import F64
from swath.signals.setup import ControlSetup

STEPS = 3  # of EM for a scan, from the mixture of the scan before
FLOOR = 0.03  # m, standard deviation no population may fall below
SHARE, MOST = 0.1, 3.0  # each population has at least; nat that one echo is worth at most


class Mixture(EdgeDetector):
    """Two normals by expectation maximisation per scan, robust parabola over several scans."""

    kept: ClassVar[tuple[str, ...]] = (*EdgeDetector.kept, "_mixture")

    def __init__(self, params: EdgeParams, setup: ControlSetup) -> None:
        super().__init__(params, setup)
        self.split = self._split
        self._mixture: F64 = np.zeros((0, 2))

    def reset(self, stream: Stream) -> Outputs:
        self._mixture = np.zeros((0, 2))
        return super().reset(stream)

    def _split(self, z: F64, min_points: int) -> tuple[F64, float]:
        """Log-likelihood of a step up before each of the points 1..n-1, and the best one's gain over none."""
        n = len(z)
        if n < 2 * min_points:
            return np.full(max(n - 1, 0), -np.inf), 0.0
        self._mixture = fit_mixture(z, self._mixture)
        crop, stubble = density(z, self._mixture)
        worth = np.clip(stubble - crop, -MOST, MOST)
        score = np.cumsum(worth)[:-1]
        score[: min_points - 1] = score[n - min_points :] = -np.inf
        first = int(np.argmax(score)) + 1
        low, high = z[:first], z[first:]
        gain = _normal(z) - _normal(low) - _normal(high) if high.mean() > low.mean() else 0.0
        return score, max(gain, 0.0)


def _normal(z: F64) -> float:
    return 0.5 * len(z) * log(float(z.var()) + FLOOR**2)


def fit_mixture(z: F64, before: F64) -> F64:
    """Share, mean [m] and variance [m2] of crop and stubble, (3, 2), of heights (n,) [m]."""
    if before.size == 0:
        low, high = np.percentile(z, [10.0, 90.0]).tolist()
        before = np.array([[0.5, 0.5], [high, low], [0.1 * (high - low) ** 2 + FLOOR**2] * 2])
    mixture = before
    for _ in range(STEPS):
        joint = density(z, mixture) + portable.log(mixture[0])[:, None]
        part = portable.exp(joint - joint.max(axis=0))
        part /= part.sum(axis=0)
        weight = part.sum(axis=1)
        mean = (part * z).sum(axis=1) / np.maximum(weight, 1e-9)
        variance = (part * (z - mean[:, None]) ** 2).sum(axis=1) / np.maximum(weight, 1e-9) + FLOOR**2
        mixture = np.stack([np.clip(weight / len(z), SHARE, 1.0 - SHARE), mean, variance])
    return mixture if mixture[1, 0] > mixture[1, 1] else mixture[:, ::-1].copy()


def density(z: F64, mixture: F64) -> F64:
    """Log density [ln 1/m] of heights (n,) in crop and stubble, (2, n)."""
    mean, variance = mixture[1][:, None], mixture[2][:, None]
    return np.asarray(-0.5 * ((z - mean) ** 2 / variance + portable.log(variance) + log(2.0 * np.pi)))
