"""What was driven: metres, seconds and runs in each bucket and in each pair of buckets, and what left the
ODD.

A run has one value of every attribute at each metre: as measured where the attribute has a quantity of the
run, as set where it has none. It counts for the verdict of the one pair of buckets, of two attributes, in
which it drove the longest way, so it is counted once; one that came to an error counts nowhere.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from swath.runtime.met import EVERY_M
from swath.runtime.met import SUMMARY as MET
from swath.signals import F64, I64, Mask
from swath.tools.function_test.judging.judged import UNCOUNTED
from swath.tools.function_test.odd.binding import Axis, Odd
from swath.tools.function_test.odd.openodd import Value
from swath.tools.function_test.stored_line import Result

HIT_M = 5.0  # driven in a bucket for a hit: what is less is a way through [m]; estimated
INSIDE = 0.9  # share of its way that a passing run has to be inside the ODD to count; estimated


@dataclass(frozen=True)
class Outside:
    """Where a run left the ODD for the first time. t_s, distance_m: there; length_m: outside in all; why."""

    t_s: float
    distance_m: float
    length_m: float
    why: str


@dataclass(frozen=True)
class Driven:
    """A run. steps: buckets at each metre, -1 outside of all, (n, attributes); metres, seconds: of the steps.

    main: the bucket of each attribute in which it drove the longest way
    outside: None where it stayed inside
    """

    result: Result
    steps: I64
    metres: F64
    seconds: F64
    main: I64
    outside: Outside | None

    @property
    def passes(self) -> bool:
        """It kept its limits."""
        return bool(self.result["verdict"] == "pass")

    @property
    def is_judged(self) -> bool:
        """It came to no error, and no limit of it rests on a level outside its checked range."""
        return self.result["verdict"] not in UNCOUNTED

    @property
    def counts(self) -> bool:
        """A failure always counts; a pass only for a way that lies inside the ODD."""
        if not self.is_judged:
            return False
        if not self.passes or self.outside is None:
            return True
        return self.outside.length_m <= (1.0 - INSIDE) * float(self.metres.sum())


def driven_of(odd: Odd, result: Result) -> Driven:
    """What a run drove; `met` says what was measured."""
    met, point = result.get(MET) or {}, result["point"]
    distance = np.array(met.get("distance_m", []), dtype=float)
    t = np.array(met.get("t_s", []), dtype=float)
    count = len(distance)
    columns = [_values(axis, met, point, count) for axis in odd.axes]
    places = [
        np.array([axis.bucket_of(value) for value in column], dtype=np.int64)
        if axis.bound.met in met
        else np.full(count, axis.bucket_of(point[axis.name]), dtype=np.int64)
        for axis, column in zip(odd.axes, columns, strict=True)
    ]
    steps = np.stack(places, axis=1) if count else np.zeros((0, len(odd.axes)), dtype=np.int64)
    metres = np.diff(distance, append=distance[-1] + EVERY_M) if count else np.zeros(0)
    seconds = np.diff(t, append=2.0 * t[-1] - t[-2] if count > 1 else t) if count else np.zeros(0)
    main = [_longest(axis, place, metres, point) for axis, place in zip(odd.axes, places, strict=True)]
    watched = [met.get(name, [None] * count) for name in odd.watched.values()] if count else []
    outside = _outside(odd, [*columns, *watched], t, distance, metres)
    return Driven(result, steps, metres, seconds, np.array(main, dtype=np.int64), outside)


def _values(axis: Axis, met: Mapping[str, Sequence[float | None]], point: Mapping[str, Value],
            count: int) -> Sequence[Value | None]:  # fmt: skip
    found = met.get(axis.bound.met)
    return [point[axis.name]] * count if found is None else found


def _longest(axis: Axis, places: I64, metres: F64, point: Mapping[str, Value]) -> int:
    inside = places >= 0
    if not inside.any():
        return axis.bucket_of(point[axis.name])
    return int(np.argmax(np.bincount(places[inside], weights=metres[inside], minlength=axis.count)))


def _outside(odd: Odd, columns: Sequence[Sequence[Value | None]], t: F64, distance: F64,
             metres: F64) -> Outside | None:  # fmt: skip
    first, length, kept = None, 0.0, dict[tuple[Value | None, ...], bool]()
    for number, row in enumerate(zip(*columns, strict=True)):
        if row not in kept:
            kept[row] = odd.domain.holds(_known(odd, row))
        if not kept[row]:
            first = number if first is None else first
            length += float(metres[number])
    if first is None:
        return None
    why = odd.domain.why_outside(_known(odd, tuple(column[first] for column in columns)))
    return Outside(float(t[first]), float(distance[first]), length, why)


def _known(odd: Odd, row: Sequence[Value | None]) -> dict[str, Value]:
    names = [*(axis.name for axis in odd.axes), *odd.watched]
    return {name: value for name, value in zip(names, row, strict=False) if value is not None}


@dataclass
class Coverage:
    """Sums over runs, (n, n) over all buckets; of two buckets of one attribute only the diagonal means.

    anything: that bucket alone.

    hits: runs that drove HIT_M or more there; counted, failed: runs whose main buckets these are
    """

    odd: Odd
    runs: list[Driven] = field(default_factory=list)

    def __post_init__(self) -> None:
        size = (self.odd.bucket_count,) * 2
        self.metres, self.seconds = np.zeros(size), np.zeros(size)
        self.hits = np.zeros(size, dtype=np.int64)
        self.counted, self.failed = np.zeros(size, dtype=np.int64), np.zeros(size, dtype=np.int64)
        self._first = np.array([axis.first for axis in self.odd.axes])

    def add(self, run: Driven) -> None:
        """Take in a run."""
        self.runs.append(run)
        here = np.zeros_like(self.metres)
        kinds, which = np.unique(run.steps, axis=0, return_inverse=True) if len(run.steps) else ((), ())
        for number, kind in enumerate(kinds):
            at = (self._first + kind)[kind >= 0]
            here[np.ix_(at, at)] += float(run.metres[np.equal(which, number)].sum())
            self.seconds[np.ix_(at, at)] += float(run.seconds[np.equal(which, number)].sum())
        self.metres += here
        self.hits += here >= HIT_M
        if run.counts:
            at = self.main(run)
            self.counted[np.ix_(at, at)] += 1
            if not run.passes:
                self.failed[np.ix_(at, at)] += 1

    def main(self, run: Driven) -> I64:
        """Numbers of the buckets for whose verdict a run counts."""
        found: I64 = (self._first + run.main)[run.main >= 0]
        return found

    @property
    def driven(self) -> Mask:
        """Cells that a run drove HIT_M or more, or for whose verdict one counts."""
        return (self.hits > 0) | (self.counted > 0)

    @property
    def pair_share(self) -> tuple[int, int]:
        """Pairs of buckets of two attributes that were driven, of those that the ODD has."""
        is_pair = np.triu(self.odd.possible, 1)
        return int((is_pair & self.driven).sum()), int(is_pair.sum())


def coverage_of(odd: Odd, results: Iterable[Result]) -> Coverage:
    """Coverage by finished runs."""
    found = Coverage(odd)
    for result in results:
        found.add(driven_of(odd, result))
    return found
