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

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import exp

import numpy as np

from swath.tools.function_test.case import Claim
from swath.tools.function_test.odd.coverage import Coverage
from swath.tools.function_test.paired import holm
from swath.tools.function_test.verdict import BROKEN, NOT_SHOWN, SHOWN, log_capital, needed

NEVER = "never driven"
VERDICTS = (SHOWN, BROKEN, NOT_SHOWN, NEVER)


@dataclass(frozen=True)
class OddCell:
    """A judged cell. places: numbers of its one or two buckets among all; text: `side_slope 7 to 14, ...`

    counted, failed: runs; p_broken, p_shown: before the correction; cause: the text of the cell that explains
    its failures, "" where none does
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
    cause: str = ""


def judged(coverage: Coverage, claim: Claim, *, is_complete: bool) -> list[OddCell]:
    """All cells that the ODD has, buckets first. is_complete: the plan is, as it was made first"""
    from scipy.stats import false_discovery_control

    odd = coverage.odd
    places = [(i, i) for i in range(odd.bucket_count) if odd.possible[i, i]]
    places += [(int(i), int(j)) for i, j in zip(*np.nonzero(np.triu(odd.possible, 1)), strict=True)]
    counted = np.array([coverage.counted[place] for place in places])
    failed = np.array([coverage.failed[place] for place in places])
    broken = np.array(
        [p_broken(int(n), int(k), claim, is_complete) for n, k in zip(counted, failed, strict=True)]
    )
    shown = np.array(
        [p_shown(int(n), int(k), claim, is_complete) for n, k in zip(counted, failed, strict=True)]
    )
    wrong = 1.0 - claim.confidence
    surely_broken = holm(dict(enumerate(broken.tolist())), wrong)
    is_shown, is_pair = np.zeros(len(places), dtype=bool), np.array([i != j for i, j in places])
    for family in (is_pair, ~is_pair):
        is_shown[family] = false_discovery_control(shown[family], method="by") <= wrong
    causes = causes_of(coverage, [place for n, place in enumerate(places) if n in surely_broken], claim)
    cells, driven = [], coverage.driven
    for number, (i, j) in enumerate(places):
        own = (i,) if i == j else (i, j)
        axes = [odd.bucket_axis[place] for place in own]
        verdict = (
            BROKEN if number in surely_broken else SHOWN if is_shown[number]
            else NOT_SHOWN if driven[i, j] else NEVER
        )  # fmt: skip
        cause = causes.get((i, j))
        cells.append(
            OddCell(own, named(coverage, own), tuple(axis.layer for axis, _ in axes), int(counted[number]),
                    int(failed[number]), float(coverage.metres[i, j]), float(coverage.seconds[i, j]),
                    int(coverage.hits[i, j]), verdict, float(broken[number]), float(shown[number]),
                    "" if cause is None else named(coverage, cause))
        )  # fmt: skip
    return cells


def named(coverage: Coverage, places: tuple[int, ...]) -> str:
    """A cell in words."""
    axes = [coverage.odd.bucket_axis[place] for place in dict.fromkeys(places)]
    return ", ".join(f"{axis.name} {axis.labels[b]}{axis.unit}" for axis, b in axes)


@cache
def p_broken(counted: int, failed: int, claim: Claim, is_complete: bool) -> float:
    """Chance of so many failures or more where the claimed share of runs passes."""
    from scipy.stats import binom

    if is_complete:
        return float(binom.sf(failed - 1, counted, 1.0 - claim.pass_rate))
    return min(1.0, exp(-log_capital(counted - failed, counted, claim.pass_rate, is_for=False)))


@cache
def p_shown(counted: int, failed: int, claim: Claim, is_complete: bool) -> float:
    """Chance of so few failures where no more than the claimed share of runs passes."""
    from scipy.stats import binom

    if is_complete:
        return float(binom.cdf(failed, counted, 1.0 - claim.pass_rate))
    return min(1.0, exp(-log_capital(counted - failed, counted, claim.pass_rate, is_for=True)))


def needed_each(count: int, claim: Claim) -> int:
    """Runs without a failure in each of `count` cells that show all of them."""
    correction = float(np.sum(1.0 / np.arange(1, count + 1)))  # of Benjamini & Yekutieli, all equally likely
    return needed(claim.pass_rate, 1.0 - (1.0 - claim.confidence) / correction)


def causes_of(
    coverage: Coverage, broken: list[tuple[int, int]], claim: Claim
) -> dict[tuple[int, int], tuple[int, ...]]:
    """Of each broken cell the cell that explains it, itself where nothing else does.

    The cell with the least likely failures comes first, of equals the simpler one; its runs are taken away,
    and what is then no more broken by itself, at the claim's confidence, is explained by it; and so on with
    the rest.
    """
    runs = [(set(coverage.main(run).tolist()), run.passes) for run in coverage.runs if run.counts]
    left, found = list(broken), dict[tuple[int, int], tuple[int, ...]]()
    while left:
        chances = {cell: _chance(cell, runs, claim) for cell in left}
        first = min(left, key=lambda cell: (chances[cell], cell[0] != cell[1], cell))
        runs = [(main, passes) for main, passes in runs if not main >= set(first)]
        limit = 1.0 - claim.confidence
        explained = [cell for cell in left if cell == first or _chance(cell, runs, claim) > limit]
        found.update(dict.fromkeys(explained, tuple(dict.fromkeys(first))))
        left = [cell for cell in left if cell not in explained]
    return found


def _chance(cell: tuple[int, int], runs: Sequence[tuple[set[int], bool]], claim: Claim) -> float:
    inside = [passes for main, passes in runs if main >= set(cell)]
    return p_broken(len(inside), sum(not passes for passes in inside), claim, True)


def remaining(coverage: Coverage, cells: list[OddCell], claim: Claim, *, is_complete: bool) -> list[OddCell]:
    """All cells judged by the runs outside the causes of what is broken.

    The causes were found with the runs that then show the rest: a new campaign on what remains confirms it.
    """
    causes = {cell.cause for cell in cells if cell.verdict == BROKEN}
    broken = [cell.places for cell in cells if cell.text in causes]
    if not broken:
        return cells
    rest = Coverage(coverage.odd)
    for run in coverage.runs:
        if not any(coverage.is_in(run, places) for places in broken):
            rest.add(run)
    return judged(rest, claim, is_complete=is_complete)


def excluded(cells: list[OddCell], rest: list[OddCell]) -> list[OddCell]:
    """The cells to leave out of the ODD so that the function is shown in what remains: the causes of what is
    broken, buckets that are not shown by the runs outside of those (rest: as `remaining`), and pairs that
    nothing has driven.
    """
    causes = {cell.cause for cell in cells if cell.verdict == BROKEN}
    broken = [cell for cell in cells if cell.text in causes]
    buckets = [c for c in rest if len(c.places) == 1 and c.verdict != SHOWN and c.text not in causes]
    whole = {c.places[0] for c in (*buckets, *broken) if len(c.places) == 1}
    pairs = [c for c in cells if len(c.places) == 2 and c.verdict == NEVER and not whole & set(c.places)]
    return [*broken, *buckets, *pairs]
