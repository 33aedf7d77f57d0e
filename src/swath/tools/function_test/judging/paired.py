"""What pairs of runs say of two versions: is there a difference, how large, and what would have been seen.

A pair has the same case, point and seed, so the same field and the same noise. The question whether there is
a difference is put to Wilcoxon's signed ranks (1945, doi:10.2307/3001968), which one run that lost its edge
does not upset; verdicts to the exact test of McNemar (1947, doi:10.1007/BF02295996). The size is the estimate
of Hodges & Lehmann (1963, doi:10.1214/aoms/1177704172), the median of the means of all two differences, with
the interval that goes with Wilcoxon's test. Several questions at once: Holm 1979 (Scand. J. Statist. 6, 65).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan, sqrt
from typing import Any, TypeVar

import numpy as np

from swath.tools.function_test.judging.verdict import scipy_stats

Name = TypeVar("Name", str, int)
ALPHA = 0.05  # chance with which something is shown that is not there
POWER = 0.8  # with which the smallest difference would have been seen
EFFICIENCY = 0.955  # of Wilcoxon's test to Student's in normal differences, 3 / pi
MOST_PAIRS = 2000  # whose differences are all averaged with each other; of more, every so-manieth


@dataclass(frozen=True)
class Difference:
    """New minus old of one number over pairs. estimate, low, high: with its interval.

    within: the smallest margin in which it is shown to lie (two one-sided tests at 5 %)
    smallest: the difference that so many pairs would have shown with a chance of 80 %
    p: of Wilcoxon's test
    """

    count: int
    estimate: float
    low: float
    high: float
    within: float
    smallest: float
    p: float


def difference(values: Sequence[float], confidence: float = 1.0 - ALPHA) -> Difference:
    """Difference that pairs show, (n,), finite. confidence: of the interval."""
    stats = scipy_stats()
    d = np.asarray(values, dtype=float)
    n = len(d)
    if n == 0:
        return Difference(0, nan, nan, nan, nan, nan, 1.0)
    sd = float(np.std(d, ddof=1)) if n > 1 else nan
    if not d.any():
        return Difference(n, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    method = "exact" if n <= 50 and len(np.unique(np.abs(d))) == n and d.all() else "approx"
    p = float(stats.wilcoxon(d, zero_method="pratt", method=method).pvalue) if n > 1 else 1.0
    some = np.sort(d)[:: -(-n // MOST_PAIRS)]
    walsh = np.sort(((some[:, None] + some[None, :]) / 2.0)[np.triu_indices(len(some))])
    low, high = _interval(walsh, len(some), confidence)
    inner = _interval(walsh, len(some), 0.90)
    smallest = float(stats.norm.ppf(0.975) + stats.norm.ppf(POWER)) * sd / sqrt(n * EFFICIENCY)
    within = max(abs(inner[0]), abs(inner[1]))
    return Difference(n, float(np.median(walsh)), low, high, within, smallest, p)


def _interval(walsh: Any, n: int, confidence: float) -> tuple[float, float]:
    """The Walsh averages that Wilcoxon's test does not refuse; without bounds where n is too small."""
    z = float(scipy_stats().norm.ppf(0.5 + 0.5 * confidence))
    rank = n * (n + 1) / 4.0 - z * sqrt(n * (n + 1) * (2 * n + 1) / 24.0)
    k = int(np.floor(rank))
    if k < 1:
        return -np.inf, np.inf
    return float(walsh[k - 1]), float(walsh[len(walsh) - k])


def verdict_test(better: int, worse: int) -> float:
    """P that verdicts change so unevenly, or more so, where neither version is better."""
    count = better + worse
    return float(scipy_stats().binomtest(better, count, 0.5).pvalue) if count else 1.0


def holm(p: Mapping[Name, float], level: float = ALPHA) -> set[Name]:
    """Names of what is shown, all together false with a chance of `level` at most."""
    shown: set[Name] = set()
    for rank, (name, value) in enumerate(sorted(p.items(), key=lambda item: item[1])):
        if not value <= level / (len(p) - rank):
            break
        shown.add(name)
    return shown


def paired_values(pairs: Sequence[tuple[Any, Any]], metric: str) -> list[float]:
    """New minus old of a metric, of the pairs in which both have it."""
    found = []
    for old, new in pairs:
        a, b = old["metrics"].get(metric), new["metrics"].get(metric)
        if a is not None and b is not None and isfinite(a) and isfinite(b):
            found.append(b - a)
    return found
