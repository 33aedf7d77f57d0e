"""What pairs of runs say of two versions: is there a difference, how large, and what would have been seen.

A pair has the same case, point and seed, so the same field and the same noise. Settings are chosen by means,
so the difference of the means is what is estimated, given an interval and decided by. Its interval is the
wider one, at each end, of Student's and of the interval of Hall's transformation (1992, doi:10.1111/
j.2517-6161.1992.tb01872.x), which takes the skewness out of Student's t: a few runs that go wild make a
difference skewed, and Student's interval alone then leaves the mean out too often. `benchmarks/decisions.py`
holds both, and others, against drawn differences. Verdicts are put to the exact test of McNemar (1947,
doi:10.1007/BF02295996). Several questions at once: Holm 1979 (Scand. J. Statist. 6, 65).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, fsum, inf, isfinite, nan, sqrt
from typing import Any, TypeVar

import numpy as np

from swath.core.number_text import percent_of
from swath.tools.function_test.judging.verdict import scipy_stats

Name = TypeVar("Name", str, int)
ALPHA = 0.05  # chance with which something is shown that is not there
POWER = 0.8  # with which the smallest difference would have been seen
UNSEEN = 3.0  # what n runs never met occurs in up to 3/n of runs, with 95 % (rule of three)
SYMMETRIC = 1e-9  # skewness below which differences are symmetric, for the sake of the division by it
WORST = 0.1  # share of the pairs that is told of beside what is better


@dataclass(frozen=True)
class Difference:
    """New minus old of one number over pairs. estimate, low, high: the mean, with its interval.

    within: the smallest margin in which it is shown to lie (two one-sided tests at 5 %)
    smallest: the difference that so many pairs would have shown with a chance of 80 %
    p: of the test that goes with the interval
    tails: means over the lowest and the highest tenth of the pairs
    """

    count: int
    estimate: float
    low: float
    high: float
    within: float
    smallest: float
    p: float
    tails: tuple[float, float]

    def worst_tenth(self, better: str) -> float:
        """Mean over the tenth of the pairs that is worst; better: `lower` or `higher`."""
        return self.tails[better == "lower"]


def difference(values: Sequence[float], confidence: float = 1.0 - ALPHA) -> Difference:
    """Difference that pairs show, (n,), finite. confidence: of the interval; unbounded where n signs, all
    alike, are not rare enough for it.
    """
    d = np.sort(np.asarray(values, dtype=float))
    n = len(d)
    if n == 0:
        return Difference(0, nan, nan, nan, nan, nan, 1.0, (nan, nan))
    tenth = ceil(WORST * n)
    tails = fsum(d[:tenth]) / tenth, fsum(d[-tenth:]) / tenth
    if not d.any():
        return Difference(n, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, tails)
    mean = fsum(d) / n
    low, high = mean_interval(d, confidence)
    within = max(map(abs, mean_interval(d, 0.90)))
    chance = 2.0 ** (1 - n)
    if chance > 1.0 - confidence:
        low, high = -inf, inf
    if chance > 0.10:
        within = inf
    spread = _moments(d)[1] / sqrt(n) if n > 1 else nan
    smallest = float(scipy_stats().t.ppf([0.975, POWER], n - 1).sum()) * spread
    return Difference(n, mean, low, high, within, smallest, max(chance, p_of_mean(d)), tails)


def mean_interval(values: Any, confidence: float = 1.0 - ALPHA) -> tuple[float, float]:
    """Interval of the mean of what values (n,), n > 1, are drawn from, where few of them may be far off."""
    n = len(values)
    mean, sd, skew = _moments(values)
    q = float(scipy_stats().t.ppf(0.5 + 0.5 * confidence, n - 1)) / sqrt(n)
    above, below = (max(q, _from_symmetric(q, skew, n)), min(-q, _from_symmetric(-q, skew, n)))
    return mean - sd * above, mean - sd * below


def p_of_mean(values: Any) -> float:
    """Least 1 - confidence at which the interval of the mean does not hold 0."""
    n = len(values)
    if n < 2:
        return 1.0
    mean, sd, skew = _moments(values)
    if sd == 0.0:
        return float(mean == 0.0)
    s = mean / sd
    t = sqrt(n) * np.array([s, s + skew * s**2 / 3.0 + skew**2 * s**3 / 27.0 + skew / (6.0 * n)])
    of = scipy_stats().t
    return float(min(1.0, 2.0 * min(of.sf(t, n - 1).max(), of.cdf(t, n - 1).max())))


def _moments(values: Any) -> tuple[float, float, float]:
    """Mean, standard deviation and skewness."""
    off = np.asarray(values, dtype=float)
    mean = fsum(off) / len(off)
    off = np.sort(off) - mean
    if off[-1] == off[0]:
        return mean, 0.0, 0.0
    square = float(np.mean(off**2))
    skew = float(np.mean(off**3)) / square**1.5
    return mean, sqrt(square * len(off) / (len(off) - 1)), skew


def _from_symmetric(q: float, skew: float, n: int) -> float:
    """(mean - true mean) / sd at which Hall's transformation, over the root of n, is q."""
    if abs(skew) < SYMMETRIC:
        return q
    return 3.0 / skew * (float(np.cbrt(1.0 + skew * (q - skew / (6.0 * n)))) - 1.0)


def not_excluded(count: int) -> float:
    """Share of runs in which a harm may occur that so many pairs would, with 95 %, not have met once."""
    return min(1.0, UNSEEN / count)


def caveat(count: int, worst: str) -> str:
    """What stands beside what `count` pairs show to be better; worst: of them, in words."""
    return f"{count} pairs cannot exclude harm in {percent_of(not_excluded(count))} of runs, {worst}"


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
