"""Causes of failures, by contrast: where runs fail that were drawn there, and not elsewhere.

A cell is a cause where its runs fail more often than those outside it (Fisher's exact test, one-sided), and
exclude the claim by themselves, both after Bonferroni over all cells and all ranges of adjacent buckets. A
run belongs to the cell that it was drawn for: where it drove may be what the function made of it. The
strongest contrast comes first; the next cause has to contrast among the runs of none before, on both sides.
Neighbours of a cause along an attribute that pass the same two tests are one range with it.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from swath.tools.function_test.case import Claim
from swath.tools.function_test.odd.binding import Odd
from swath.tools.function_test.odd.cells import NEVER, OddCell, Span, p_broken
from swath.tools.function_test.odd.coverage import Coverage, Driven
from swath.tools.function_test.verdict import BROKEN, SHOWN, needed

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Cause:
    """spans: of its one or two attributes

    counted, failed: runs drawn there, rest_counted, rest_failed: drawn elsewhere, of those that belong to no
    stronger cause; p: of the contrast, after the correction
    """

    spans: tuple[Span, ...]
    text: str
    counted: int
    failed: int
    rest_counted: int
    rest_failed: int
    p: float

    def has(self, drawn: set[int]) -> bool:
        """Whether it holds a run that was drawn for these buckets."""
        return all(any(first <= place <= last for place in drawn) for first, last in self.spans)


def drawn_for(odd: Odd, run: Driven) -> set[int]:
    """Numbers of the buckets for which a run was drawn."""
    found = ((axis, axis.bucket_of(run.result["point"][axis.name])) for axis in odd.axes)
    return {axis.first + bucket for axis, bucket in found if bucket >= 0}


def causes_of(coverage: Coverage, claim: Claim, *, is_complete: bool) -> list[Cause]:
    """Strongest contrast first. is_complete: the plan is, as it was made first"""
    odd = coverage.odd
    runs = [run for run in coverage.runs if run.counts]
    drawn = np.zeros((len(runs), odd.bucket_count), dtype=bool)
    for row, run in zip(drawn, runs, strict=True):
        row[list(drawn_for(odd, run))] = True
    fails = np.array([not run.passes for run in runs], dtype=bool)
    left = np.ones(len(runs), dtype=bool)
    rows, columns = np.nonzero(np.triu(odd.possible))
    cells = [
        tuple((p, p) for p in dict.fromkeys(pair))
        for pair in zip(rows.tolist(), columns.tolist(), strict=True)
    ]
    ranges = list(_ranges(odd))
    cells += [(span,) for span in ranges]
    in_ranges = np.stack([_is_in(drawn, [span]) for span in ranges], axis=1) if ranges else drawn[:, :0]
    simpler = np.array([sum(last - first + 1 for first, last in spans) for spans in cells])
    wrong, found = 1.0 - claim.confidence, list[Cause]()

    def counts(some: Flags) -> NDArray[np.int64]:
        own = drawn[some].astype(np.int64)
        return np.concatenate([(own.T @ own)[rows, columns], in_ranges[some].sum(axis=0)])

    while True:
        counted, failed = counts(left), counts(left & fails)
        chances = _contrast(counted, failed, int(left.sum()), int((left & fails).sum()))
        p = np.minimum(1.0, len(cells) * chances)
        sure = (
            number
            for number in np.lexsort((simpler, p))
            if p[number] <= wrong
            and len(cells) * p_broken(int(counted[number]), int(failed[number]), claim, is_complete) <= wrong
        )
        if (best := next(sure, None)) is None:
            return found
        spans = _widened(odd, cells[best], drawn[left], fails[left], claim)
        is_in = _is_in(drawn, spans)
        here, there = left & is_in, left & ~is_in
        n, k, others, k_others = (int(some.sum()) for some in (here, here & fails, there, there & fails))
        chance = min(1.0, len(cells) * _contrast_of(n, k, n + others, k + k_others))
        found.append(Cause(spans, _text(odd, spans), n, k, others, k_others, chance))
        left = there


def _ranges(odd: Odd) -> Iterator[Span]:
    """Of each number two or more adjacent buckets inside the ODD, but not all."""
    for axis in odd.axes:
        inside = [n for n in range(axis.first, axis.first + axis.count) if odd.possible[n, n]]
        for first, last in combinations(inside if axis.edges else (), 2):
            if 1 < last - first + 1 < len(inside) and set(range(first, last)) <= set(inside):
                yield first, last


def _contrast(counted: NDArray[np.int64], failed: NDArray[np.int64], runs: int,
              failures: int) -> NDArray[np.float64]:  # fmt: skip
    """Chance of so many failures or more in cells, where all runs fail alike."""
    from scipy.stats import hypergeom

    kinds, which = np.unique(np.stack([counted, failed], axis=-1), axis=0, return_inverse=True)
    chances = hypergeom.sf(kinds[:, 1] - 1, runs, failures, kinds[:, 0])  # slow: each kind once
    return np.asarray(chances[which.ravel()], dtype=np.float64)


def _contrast_of(counted: int, failed: int, runs: int, failures: int) -> float:
    return float(_contrast(np.array([counted]), np.array([failed]), runs, failures)[0])


def _is_in(drawn: Flags, spans: Sequence[Span]) -> Flags:
    found = np.ones(len(drawn), dtype=np.bool_)
    for first, last in spans:
        found &= drawn[:, first : last + 1].any(axis=1)
    return found


def _widened(odd: Odd, spans: tuple[Span, ...], drawn: Flags, fails: Flags, claim: Claim) -> tuple[Span, ...]:
    """With the adjacent buckets that break the claim and contrast with the runs outside of both."""
    while True:
        tried = list(_neighbours(odd, spans))
        limit = (1.0 - claim.confidence) / max(1, len(tried))
        here, found = _is_in(drawn, spans), list[tuple[float, tuple[Span, ...]]]()
        for wider in tried:
            new = _is_in(drawn, wider) & ~here
            counted, failed = int(new.sum()), int((new & fails).sum())
            p = _contrast_of(counted, failed, int((~here).sum()), int((fails & ~here).sum()))
            if max(p, p_broken(counted, failed, claim, True)) <= limit:
                found.append((p, wider))
        if not found:
            whole = [odd.bucket_axis[a][0].count == b - a + 1 for a, b in spans]  # it does not matter then
            return tuple(span for span, is_whole in zip(spans, whole, strict=True) if not is_whole)
        spans = min(found)[1]


def _neighbours(odd: Odd, spans: tuple[Span, ...]) -> Iterator[tuple[Span, ...]]:
    """The same with one bucket more of a number, inside the ODD."""
    for number, (first, last) in enumerate(spans):
        axis, _ = odd.bucket_axis[first]
        for wider, new in (((first - 1, last), first - 1), ((first, last + 1), last + 1)):
            if axis.edges and axis.first <= new < axis.first + axis.count and odd.possible[new, new]:
                yield (*spans[:number], wider, *spans[number + 1 :])


def _text(odd: Odd, spans: Sequence[Span]) -> str:
    """`lean 22 to 33 deg`; of more buckets than one `lean from 22 deg on` where they reach the last."""
    said = []
    for first, last in spans:
        axis, bucket = odd.bucket_axis[first]
        low, high = bucket, last - axis.first
        if low == high:
            said.append(f"{axis.name} {axis.labels[low]}{axis.unit}")
        elif high == axis.count - 1:
            said.append(f"{axis.name} from {axis.edges[low]:g}{axis.unit} on")
        elif low == 0:
            said.append(f"{axis.name} up to {axis.edges[high + 1]:g}{axis.unit}")
        else:
            said.append(f"{axis.name} {axis.edges[low]:g} to {axis.edges[high + 1]:g}{axis.unit}")
    return ", ".join(said)


@dataclass(frozen=True)
class Explained:
    """What the causes say of a broken cell. cause: of most of its failures, None where it has runs enough
    outside of all causes and these break the claim, too; counted, failed: those runs; why: in words
    """

    cause: Cause | None
    counted: int
    failed: int
    why: str


INSIDE = "inside a cause"
GONE = "no longer broken without the runs of the causes"
TOO_FEW = "too few runs outside of the causes to say"
AS_THE_REST = "as all the rest is: no cause can be separated"
WHYS = (INSIDE, GONE, TOO_FEW, AS_THE_REST)


def explained(coverage: Coverage, cells: Sequence[OddCell], causes: Sequence[Cause],
              claim: Claim) -> dict[str, Explained]:  # fmt: skip
    """Of each broken cell, by its text, what remains of it without the runs of the causes."""
    runs = [(run, set(coverage.main(run).tolist()), cause_of(coverage, run, causes))
            for run in coverage.runs if run.counts]  # fmt: skip
    enough, found = needed(claim.pass_rate, claim.confidence), dict[str, Explained]()
    for cell in cells:
        if cell.verdict != BROKEN:
            continue
        own = [(cause, run.passes) for run, main, cause in runs if main >= set(cell.places)]
        rest = [passes for cause, passes in own if cause is None]
        failing = Counter(cause for cause, passes in own if cause is not None and not passes)
        failed = len(rest) - sum(rest)
        around = next((cause for cause in causes if cause.has(set(cell.places))), None)
        cause = around or (failing.most_common(1)[0][0] if failing else None)
        if around is not None:
            why = INSIDE
        elif cause is None or p_broken(len(rest), failed, claim, True) <= 1.0 - claim.confidence:
            cause, why = None, AS_THE_REST
        else:
            why = GONE if len(rest) >= enough else TOO_FEW
        found[cell.text] = Explained(cause, len(rest), failed, why)
    return found


def cause_of(coverage: Coverage, run: Driven, causes: Sequence[Cause]) -> Cause | None:
    """The strongest cause that a run was drawn for, None for none."""
    drawn = drawn_for(coverage.odd, run)
    return next((cause for cause in causes if cause.has(drawn)), None)


def without(coverage: Coverage, causes: Sequence[Cause]) -> Coverage:
    """What the runs drove that belong to no cause."""
    rest = Coverage(coverage.odd)
    for run in coverage.runs:
        if cause_of(coverage, run, causes) is None:
            rest.add(run)
    return rest


def excluded(cells: Sequence[OddCell], causes: Sequence[Cause],
             rest: Sequence[OddCell]) -> list[Cause | OddCell]:  # fmt: skip
    """What to leave out of the ODD so that the function is shown in what remains: the causes, buckets that
    the runs outside of these do not show (rest: judged by them), and pairs that they break or that nothing
    has driven.
    """
    alone = [cause.spans[0] for cause in causes if len(cause.spans) == 1]
    whole = {place for first, last in alone for place in range(first, last + 1)}
    buckets = [c for c in rest if len(c.places) == 1 and c.verdict != SHOWN and c.places[0] not in whole]
    whole |= {c.places[0] for c in buckets}
    never = {c.places for c in cells if c.verdict == NEVER}
    pairs = [c for c in rest if len(c.places) == 2 and (c.verdict == BROKEN or c.places in never)]
    return [*causes, *buckets, *(c for c in pairs if not whole & set(c.places))]
