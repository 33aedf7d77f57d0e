"""The boundary of failure: where in the ranges of some parameters runs stop keeping their limits.

The margin of a run to its limits, -1..1 and < 0 where it fails, is a Gaussian process over the parameters.
The next runs are where its sign is least known: the largest 1.96 sd - |mean|, the straddle of Bryan et al.
2005 (Advances in Neural Information Processing Systems 18). Runs that are done at the same time are chosen
one after the other, each as if those before had come out as expected (the kriging believer of Ginsbourger et
al. 2010, doi:10.1007/978-3-642-10701-6_6).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import nan

import numpy as np

from swath.core.errors import Extra, InputError
from swath.signals import F64
from swath.tools.function_test.search.gaussian_process import GaussianProcess, fit

SURE = 1.96  # standard deviations between the margin and 0 from which its sign counts as known
CANDIDATES = 4096  # points that the next runs are taken from, and that shares are counted over
FIRST = 4  # runs for each parameter that are spread evenly before the search begins


def sobol_points(count: int, dimensions: int) -> F64:
    """Points of Sobol's sequence in the unit cube, (count, dimensions), without its first one, a corner."""
    with Extra("test", "spreading runs evenly"):
        from scipy.stats import qmc
    sequence = qmc.Sobol(dimensions, scramble=False)
    sequence.fast_forward(1)
    return np.asarray(sequence.random(count))


def first_points(dimensions: int, budget: int) -> F64:
    """Where a search begins, (n, d), half of its budget at most."""
    return sobol_points(max(2, min(FIRST * dimensions, budget // 2)), dimensions)


def next_points(points: F64, margins: F64, count: int) -> F64:
    """The points to run next, (count, d), after those that were run, (n, d); margins: (n,), nan where a run
    said nothing. InputError where none did.
    """
    is_known = np.isfinite(margins)
    if not is_known.any():
        raise InputError("search", None, "expected a run that is judged: all came to an error, or to nothing")
    process = fit(points[is_known], margins[is_known])
    for point in points[~is_known]:  # is not asked again
        process = process.and_at(point, float(process.predict(point[None])[0][0]))
    candidates = sobol_points(CANDIDATES, points.shape[1])
    chosen = []
    for _ in range(count):
        mean, sd = process.predict(candidates)
        best = int(np.argmax(SURE * sd - np.abs(mean)))
        chosen.append(candidates[best])
        process = process.and_at(candidates[best], float(mean[best]))
    return np.stack(chosen)


@dataclass(frozen=True)
class Boundary:
    """What the runs of a search say.

    names: names of the parameters
    points: in the unit cube, (n, d)
    margins: margins of the limits, (n,)
    """

    names: Sequence[str]
    points: F64
    margins: F64

    @cached_property
    def process(self) -> GaussianProcess:
        """The margin over the parameters."""
        return fit(self.points, self.margins)

    @cached_property
    def _everywhere(self) -> tuple[F64, F64, F64]:
        spread = sobol_points(CANDIDATES, len(self.names))
        return spread, *self.process.predict(spread)

    def passes(self, at: F64) -> F64:
        """Whether runs at points (m, d) are expected to pass, (m,) of bool."""
        return np.asarray(self.process.predict(at)[0] >= 0.0)

    @property
    def shares(self) -> tuple[float, float]:
        """Share of the ranges in which runs pass, and share in which that is not known with 95 %."""
        _, mean, sd = self._everywhere
        return float(np.mean(mean >= 0.0)), float(np.mean(np.abs(mean) < SURE * sd))

    @property
    def right_of_left_out(self) -> float:
        """Share of the runs whose verdict the others foretell: near the boundary, so less than elsewhere."""
        return float(np.mean((self.process.left_out() >= 0.0) == (self.margins >= 0.0)))

    def sensitivities(self) -> list[tuple[str, float, float]]:
        """For each parameter: its share of the margin's variance alone, and with all that it acts with.

        Sobol's first and total index of the fitted margin by the estimators of Saltelli et al. 2010
        (doi:10.1016/j.cpc.2009.09.018, table 2b and 2f), parameters uniform in their ranges; nan where the
        margins of all runs are alike.
        """
        if np.ptp(self.margins) == 0.0:
            return [(name, nan, nan) for name in self.names]
        count = len(self.names)
        both = sobol_points(2048, 2 * count)
        a, b = both[:, :count], both[:, count:]
        of_a, of_b = self._clipped(a), self._clipped(b)
        variance = float(np.var(np.concatenate([of_a, of_b]))) or 1.0
        found = []
        for i, name in enumerate(self.names):
            mixed = a.copy()
            mixed[:, i] = b[:, i]
            of_mixed = self._clipped(mixed)
            first = float(np.mean(of_b * (of_mixed - of_a))) / variance
            total = 0.5 * float(np.mean((of_a - of_mixed) ** 2)) / variance
            found.append((name, min(1.0, max(0.0, first)), min(1.0, max(0.0, total))))
        return found

    def map_of(self, x: int, y: int, bins: int) -> F64:
        """Over two parameters, (bins, bins) with y first: the share of the other ones' ranges that passes."""
        spread, _, _ = self._everywhere
        others = spread[:64]
        centres = (np.arange(bins) + 0.5) / bins
        out = np.zeros((bins, bins))
        for row, v in enumerate(centres):
            at = np.repeat(others[None, :, :], bins, axis=0)
            at[:, :, x], at[:, :, y] = centres[:, None], v
            out[row] = self.passes(at.reshape(-1, len(self.names))).reshape(bins, -1).mean(axis=1)
        return out

    def _clipped(self, at: F64) -> F64:
        return np.clip(self.process.predict(at)[0], -1.0, 1.0)
