"""Verdicts on cells: a bucket of an attribute, or a pair of buckets of two.

A cell is `broken` where its runs exclude that the claimed share of runs passes, `shown` where they exclude
that fewer do, `never driven` without a run, else `not shown`. Very many cells are judged at once:

- no cell at all is called broken wrongly, with the confidence of the claim: Holm 1979 over all cells.
- of the buckets called shown, and of the pairs, the expected share of wrong ones is at most 1 - confidence,
  however the cells hang together (they share runs): Benjamini & Yekutieli 2001, doi:10.1214/aos/1013699998.

The p-value of a cell is that of the exact binomial test. Its runs differ in the other attributes, so their
chances of passing do, too; the binomial test of their mean is then on the safe side (Hoeffding 1956,
doi:10.1214/aoms/1177728178). Where runs of the plan are missing, or it was made longer after a look, the
e-process of `verdict` takes its place: the reciprocal of its capital is a p-value at every moment.
"""

from dataclasses import dataclass
from functools import cache
from math import exp

import numpy as np

from swath.tools.function_test.case import Claim
from swath.tools.function_test.judging.paired import holm
from swath.tools.function_test.judging.verdict import (
    BROKEN,
    NOT_SHOWN,
    SHOWN,
    log_capital,
    needed,
    scipy_stats,
)
from swath.tools.function_test.odd.coverage import Coverage

Span = tuple[int, int]  # the first and the last of adjacent buckets of an attribute, numbered among all
NEVER = "never driven"
VERDICTS = (SHOWN, BROKEN, NOT_SHOWN, NEVER)


@dataclass(frozen=True)
class OddCell:
    """A judged cell. places: numbers of its one or two buckets among all; text: `side_slope 7 to 14, ...`.

    counted, failed: runs
    p_broken, p_shown: before the correction
    """

    places: tuple[int, ...]
    text: str
    layers: tuple[str, ...]
    counted: int
    failed: int
    metres: float
    seconds: float
    hits: int
    verdict: str
    p_broken: float
    p_shown: float

    ends: tuple[tuple[float, float], ...] = ()  # none: as `causes.Cause`

    @property
    def spans(self) -> tuple[Span, ...]:
        """Of each bucket its number twice: the first and the last."""
        return tuple((place, place) for place in self.places)


def judged(coverage: Coverage, claim: Claim, *, is_complete: bool) -> list[OddCell]:
    """All cells that the ODD has, buckets first. is_complete: the plan is, as it was made first."""
    odd = coverage.odd
    places = [(i, i) for i in range(odd.bucket_count) if odd.possible[i, i]]
    places += [(int(i), int(j)) for i, j in zip(*np.nonzero(np.triu(odd.possible, 1)), strict=True)]
    counted = np.array([coverage.counted[place] for place in places])
    failed = np.array([coverage.failed[place] for place in places])
    each = list(zip(counted.tolist(), failed.tolist(), strict=True))
    broken, shown = (np.array([p(n, k, claim, is_complete) for n, k in each]) for p in (p_broken, p_shown))
    wrong = 1.0 - claim.confidence
    surely_broken = holm(dict(enumerate(broken.tolist())), wrong)
    is_shown, is_pair = np.zeros(len(places), dtype=bool), np.array([i != j for i, j in places])
    for family in (is_pair, ~is_pair):
        is_shown[family] = scipy_stats().false_discovery_control(shown[family], method="by") <= wrong
    cells, driven = [], coverage.driven
    for number, (i, j) in enumerate(places):
        own = (i,) if i == j else (i, j)
        axes = [odd.bucket_axis[place] for place in own]
        verdict = (
            BROKEN if number in surely_broken else SHOWN if is_shown[number]
            else NOT_SHOWN if driven[i, j] else NEVER
        )  # fmt: skip
        cells.append(
            OddCell(own, named(coverage, own), tuple(axis.layer for axis, _ in axes), int(counted[number]),
                    int(failed[number]), float(coverage.metres[i, j]), float(coverage.seconds[i, j]),
                    int(coverage.hits[i, j]), verdict, float(broken[number]), float(shown[number]))
        )  # fmt: skip
    return cells


def named(coverage: Coverage, places: tuple[int, ...]) -> str:
    """A cell in words."""
    axes = [coverage.odd.bucket_axis[place] for place in dict.fromkeys(places)]
    return ", ".join(f"{axis.name} {axis.labels[b]}{axis.unit}" for axis, b in axes)


@cache
def p_broken(counted: int, failed: int, claim: Claim, is_complete: bool) -> float:
    """Chance of so many failures or more where the claimed share of runs passes."""
    if is_complete:
        return float(scipy_stats().binom.sf(failed - 1, counted, 1.0 - claim.pass_rate))
    return min(1.0, exp(-log_capital(counted - failed, counted, claim.pass_rate, is_for=False)))


@cache
def p_shown(counted: int, failed: int, claim: Claim, is_complete: bool) -> float:
    """Chance of so few failures where no more than the claimed share of runs passes."""
    if is_complete:
        return float(scipy_stats().binom.cdf(failed, counted, 1.0 - claim.pass_rate))
    return min(1.0, exp(-log_capital(counted - failed, counted, claim.pass_rate, is_for=True)))


def needed_each(count: int, claim: Claim) -> int:
    """Runs without a failure in each of `count` cells that show all of them."""
    correction = float(np.sum(1.0 / np.arange(1, count + 1)))  # of Benjamini & Yekutieli, all equally likely
    return needed(claim.pass_rate, 1.0 - (1.0 - claim.confidence) / correction)
