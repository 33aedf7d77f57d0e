"""Causes of failures, by contrast: where runs fail that were drawn there, and not elsewhere.

A cell is a cause where its runs fail more often than those outside it (Fisher's exact test, one-sided), and
exclude the claim by themselves, both after Bonferroni over all cells and all ranges of adjacent buckets.
So is a box: an interval of the values of an attribute, whatever its buckets, or of two or three attributes at
once. Its contrast is corrected for all boxes that there are between the values drawn (a scan over intervals,
Kulldorff 1997, with the error of Bonferroni), its runs exclude the claim. Cells have half of the chance of a
wrong cause, boxes of one, two and three attributes a sixth each.

A run belongs to what it was drawn for: where it drove may be what the function made of it. The strongest
contrast comes first; the next cause has to contrast among the runs of none before, on both sides.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from swath.core.number_text import num
from swath.signals import F64, I64, Mask
from swath.tools.function_test.case import Claim
from swath.tools.function_test.judging.verdict import BROKEN, SHOWN, needed, scipy_stats
from swath.tools.function_test.odd.binding import Axis, Odd
from swath.tools.function_test.odd.cells import NEVER, OddCell, Span, p_broken
from swath.tools.function_test.odd.coverage import Coverage, Driven


@dataclass(frozen=True)
class Cause:
    """spans: buckets of its attributes; ends: of a box the least and largest value of each, of a cell ().

    counted, failed: runs drawn there, rest_counted, rest_failed: drawn elsewhere, of those that belong to no
        stronger cause
    p: of the contrast, after the correction
    """

    spans: tuple[Span, ...]
    text: str
    counted: int
    failed: int
    rest_counted: int
    rest_failed: int
    p: float
    ends: tuple[tuple[float, float], ...] = ()

    def has(self, drawn: set[int]) -> bool:
        """Whether it holds a run that was drawn for these buckets; of a box, whether it may."""
        return all(any(first <= place <= last for place in drawn) for first, last in self.spans)

    def holds(self, odd: Odd, run: Driven) -> bool:
        """Whether it holds a run as it was drawn."""
        if not self.ends:
            return self.has(drawn_for(odd, run))
        axes = [odd.bucket_axis[first][0] for first, _ in self.spans]
        values = [value_of(axis, run) for axis in axes]
        return all(low <= value <= high for value, (low, high) in zip(values, self.ends, strict=True))


def drawn_for(odd: Odd, run: Driven) -> set[int]:
    """Numbers of the buckets for which a run was drawn."""
    found = ((axis, axis.bucket_of(run.result["point"][axis.name])) for axis in odd.axes)
    return {axis.first + bucket for axis, bucket in found if bucket >= 0}


def value_of(axis: Axis, run: Driven) -> float:
    """What was drawn of an attribute; of a category the number of its label."""
    value = run.result["point"][axis.name]
    return float(value) if axis.edges else float(axis.bucket_of(value))


def causes_of(coverage: Coverage, claim: Claim, *, is_complete: bool) -> list[Cause]:
    """Strongest contrast first. is_complete: the plan is, as it was made first."""
    odd = coverage.odd
    runs = [run for run in coverage.runs if run.counts]
    drawn = np.zeros((len(runs), odd.bucket_count), dtype=bool)
    for row, run in zip(drawn, runs, strict=True):
        row[list(drawn_for(odd, run))] = True
    fails = np.array([not run.passes for run in runs], dtype=bool)
    values = np.array([[value_of(axis, run) for axis in odd.axes] for run in runs])
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

    def counts(some: Mask) -> I64:
        own = drawn[some].astype(np.int64)
        return np.concatenate([(own.T @ own)[rows, columns], in_ranges[some].sum(axis=0)])

    while True:
        counted, failed = counts(left), counts(left & fails)
        chances = _contrast(counted, failed, int(left.sum()), int((left & fails).sum()))
        p = np.minimum(1.0, 2.0 * len(cells) * chances)
        sure = (
            number
            for number in np.lexsort((simpler, p))
            if p[number] <= wrong
            and len(cells) * p_broken(int(counted[number]), int(failed[number]), claim, is_complete) <= wrong
        )
        best = next(sure, None)
        box = _best_box(odd, values[left], fails[left])
        if box and max(box.p, p_broken(box.counted, box.failed, claim, is_complete)) > wrong:
            box = None
        if best is None and box is None:
            return found
        spans, ends = tuple[Span, ...](), tuple[tuple[float, float], ...]()
        if box is not None and (best is None or box.p < p[best]):
            spans, ends = box.spans(odd), tuple(box.ends.values())
            is_in = box.holds(values)
        else:
            assert best is not None
            spans = cells[best]
            is_in = _is_in(drawn, spans)
        here, there = left & is_in, left & ~is_in
        n, k, others, k_others = (int(some.sum()) for some in (here, here & fails, there, there & fails))
        looks = 2.0 * len(cells)
        chance = box.p if box and ends else min(1.0, looks * _contrast_of(n, k, n + others, k + k_others))
        found.append(Cause(spans, _text(odd, spans, ends), n, k, others, k_others, chance, ends))
        left = there


DEPTH, BEAM = 3, 6  # attributes of a box at most; boxes that are gone on from
KINDS = f"a bucket, a range of buckets, a pair, or a box of values of up to {DEPTH} attributes"
REACH = (
    f"A fault of up to {DEPTH} attributes at once is found as a box where enough runs were drawn in it, "
    "which is planned for pairs alone; one that needs more attributes is found only where it shows in "
    f"{DEPTH}, too."
)


@dataclass(frozen=True)
class _Box:
    """Values between ends, by the number of the attribute. p: of the contrast, after the correction."""

    ends: Mapping[int, tuple[float, float]]
    counted: int = 0
    failed: int = 0
    score: float = 0.0
    p: float = 1.0

    def holds(self, values: F64) -> Mask:
        """Runs in it, of values (runs, attributes)."""
        inside = [(values[:, k] >= low) & (values[:, k] <= high) for k, (low, high) in self.ends.items()]
        return np.logical_and.reduce(inside) if inside else np.ones(len(values), dtype=np.bool_)

    def spans(self, odd: Odd) -> tuple[Span, ...]:
        """The buckets that it touches."""
        buckets = [[odd.axes[k].bucket_of(v) if odd.axes[k].edges else int(v) for v in ends]
                   for k, ends in self.ends.items()]  # fmt: skip
        return tuple((odd.axes[k].first + a, odd.axes[k].first + b)
                     for k, (a, b) in zip(self.ends, buckets, strict=True))  # fmt: skip


def _best_box(odd: Odd, values: F64, fails: Mask) -> _Box | None:
    """The box with the strongest contrast, found from the best intervals on, attribute by attribute."""
    if not fails.any():
        return None
    kinds = [len(np.unique(column)) for column in values.T]
    looks = np.array([n * (n + 1) / 2 if a.edges else n for a, n in zip(odd.axes, kinds, strict=True)])
    beam, found = [_Box({})], list[_Box]()
    for depth in range(1, DEPTH + 1):
        longer = [_narrowed(odd, values, fails, box, k)
                  for box in beam for k in range(len(odd.axes)) if k not in box.ends]  # fmt: skip
        longer.sort(key=lambda box: -box.score)
        beam = []
        for box in longer[:BEAM]:
            for k in 2 * list(box.ends) if depth > 1 else []:
                box = _narrowed(odd, values, fails, box, k)
            beam.append(box)
        many = 6.0 * sum(np.prod(some) for some in combinations(looks.tolist(), depth))
        for box in beam:
            p = _contrast_of(box.counted, box.failed, len(fails), int(fails.sum()))
            found.append(replace(box, p=min(1.0, many * p)))
    return min(found, key=lambda box: box.p, default=None)


def _narrowed(odd: Odd, values: F64, fails: Mask, box: _Box, k: int) -> _Box:
    """A box with its best interval of an attribute, between two values at which runs fail (of a category: at
    one of them), by the likelihood of two rates against that of one.
    """
    others = {number: ends for number, ends in box.ends.items() if number != k}
    inside = _Box(others).holds(values)
    value, which = np.unique(values[inside, k], return_inverse=True)
    counted = np.concatenate([[0.0], np.cumsum(np.bincount(which, minlength=len(value)))])
    failed = np.concatenate([[0.0], np.cumsum(np.bincount(which, fails[inside], len(value)))])
    at = np.flatnonzero(np.diff(failed))
    if not len(at):
        return box
    first, last = (m.ravel() for m in np.meshgrid(at, at, indexing="ij"))
    is_one = last >= first if odd.axes[k].edges else last == first
    first, last = first[is_one], last[is_one]
    n, f = counted[last + 1] - counted[first], failed[last + 1] - failed[first]
    rest, f_rest = len(fails) - n, float(fails.sum()) - f
    gain = _log_likelihood(f, n) + _log_likelihood(f_rest, rest)
    gain = np.where(f * rest > f_rest * n, gain, -np.inf)
    best = int(np.argmax(gain))
    ends = {**others, k: (float(value[first[best]]), float(value[last[best]]))}
    return _Box(dict(sorted(ends.items())), int(n[best]), int(f[best]), float(gain[best]))


def _log_likelihood(failed: F64, counted: F64) -> F64:
    """Log-likelihood of the rate that fits best."""
    passed = counted - failed
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = failed * np.log(failed / counted), passed * np.log(passed / counted)
    return np.asarray(np.nan_to_num(parts[0]) + np.nan_to_num(parts[1]))


def _ranges(odd: Odd) -> Iterator[Span]:
    """Of each number two or more adjacent buckets inside the ODD, but not all."""
    for axis in odd.axes:
        inside = [n for n in range(axis.first, axis.first + axis.count) if odd.possible[n, n]]
        for first, last in combinations(inside if axis.edges else (), 2):
            if 1 < last - first + 1 < len(inside) and set(range(first, last)) <= set(inside):
                yield first, last


def _contrast(counted: I64, failed: I64, runs: int,
              failures: int) -> F64:  # fmt: skip
    """Chance of so many failures or more in cells, where all runs fail alike."""
    kinds, which = np.unique(np.stack([counted, failed], axis=-1), axis=0, return_inverse=True)
    chances = scipy_stats().hypergeom.sf(kinds[:, 1] - 1, runs, failures, kinds[:, 0])  # slow: each kind once
    return np.asarray(chances[which.ravel()], dtype=np.float64)


def _contrast_of(counted: int, failed: int, runs: int, failures: int) -> float:
    return float(_contrast(np.array([counted]), np.array([failed]), runs, failures)[0])


def _is_in(drawn: Mask, spans: Sequence[Span]) -> Mask:
    found = np.ones(len(drawn), dtype=np.bool_)
    for first, last in spans:
        found &= drawn[:, first : last + 1].any(axis=1)
    return found


def _text(odd: Odd, spans: Sequence[Span], ends: Sequence[tuple[float, float]] = ()) -> str:
    """`lean 22 to 33 deg`, a box by its ends; of more buckets than one `lean from 22 deg on` where they reach
    the last.
    """
    said = []
    for number, (first, last) in enumerate(spans):
        axis, bucket = odd.bucket_axis[first]
        low, high = bucket, last - axis.first
        if ends and axis.edges:
            said.append(f"{axis.name} {num(ends[number][0])} to {num(ends[number][1])}{axis.unit}")
        elif low == high:
            said.append(f"{axis.name} {axis.labels[low]}{axis.unit}")
        elif high == axis.count - 1:
            said.append(f"{axis.name} from {num(axis.edges[low])}{axis.unit} on")
        elif low == 0:
            said.append(f"{axis.name} up to {num(axis.edges[high + 1])}{axis.unit}")
        else:
            said.append(f"{axis.name} {num(axis.edges[low])} to {num(axis.edges[high + 1])}{axis.unit}")
    return ", ".join(said)


@dataclass(frozen=True)
class Explained:
    """What the causes say of a broken cell.

    cause: of most of its failures, None where it has runs enough outside of all causes and these break the
        claim, too
    counted, failed: those runs
    why: in words
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
        around = next((c for c in causes if not c.ends and c.has(set(cell.places))), None)
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
    return next((cause for cause in causes if cause.holds(coverage.odd, run)), None)


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
    alone = [cause.spans[0] for cause in causes if len(cause.spans) == 1 and not cause.ends]
    whole = {place for first, last in alone for place in range(first, last + 1)}
    buckets = [c for c in rest if len(c.places) == 1 and c.verdict != SHOWN and c.places[0] not in whole]
    whole |= {c.places[0] for c in buckets}
    never = {c.places for c in cells if c.verdict == NEVER}
    pairs = [c for c in rest if len(c.places) == 2 and (c.verdict == BROKEN or c.places in never)]
    return [*causes, *buckets, *(c for c in pairs if not whole & set(c.places))]
