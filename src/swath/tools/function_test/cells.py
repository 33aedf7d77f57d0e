"""Results put together: a cell is a case with a candidate, pooled over points and seeds.

Results come one at a time. Of each a cell keeps what its verdict needs; of some, and of the worst, what the
page shows: so the memory does not grow with the number of runs.
"""

from array import array
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import fsum, nan
from typing import Any

from swath.core.number_text import num
from swath.tools.function_test.case import Case
from swath.tools.function_test.judging.integrity import SUMMARY, pooled
from swath.tools.function_test.judging.judged import ERROR, OPEN, UNJUDGED, beyond, why_unjudged
from swath.tools.function_test.judging.kept_runs import Kept, Region, Sample, Worst, kept
from swath.tools.function_test.judging.margin import is_kept_or_not, margin, margin_of
from swath.tools.function_test.judging.paired import mean_interval
from swath.tools.function_test.judging.ranking import Measured
from swath.tools.function_test.judging.steering_accuracy import SUMMARY as STEERING
from swath.tools.function_test.judging.steering_accuracy import pooled as pooled_classes
from swath.tools.function_test.judging.verdict import BROKEN, NOT_JUDGED, NOT_SHOWN, SHOWN, describe, verdict
from swath.tools.function_test.stored_line import Result

STEERING_TAG = "steering"  # of cases that stand in the table of steering accuracy
KEPT_MAX = 20_000  # runs that are drawn, over all cells
DRAWN_MAX, DRAWN_LEAST = 1000, 20  # in one cell
POINTS_MAX = 30  # with a row each in the table of steering accuracy; more are put together
ALL_POINTS = "all points"
SURPRISES_MAX = 5  # that are named


@dataclass
class Cell:
    """The runs of a case with a candidate. planned: how many there are to be; room: how many are drawn.

    text: what the rate of passes shows
    means: what is said of each bounded mean

    count: of runs
    counted, passed: of those that count for the rate, which are not those at points where a failure is known,
        nor unjudged ones; surprises: runs that passed at points of known failures
    unjudged: runs that are not, with why
    outside: those with a level outside its checked range, by slot and quantity
    errors: runs that came to one
    failed: runs that count and did not pass
    groups: the same by the first limit that failed
    measured: what its runs measured, None where there is no other candidate
    worst: the run farthest beyond a limit, or nearest to one; an error before all others
    """

    case: Case
    candidate: str
    planned: int
    room: int = DRAWN_MAX
    verdict: str = NOT_SHOWN
    text: str = ""
    means: list[str] = field(default_factory=list)
    count: int = 0
    counted: int = 0
    passed: int = 0
    known: int = 0
    unjudged: Counter[str] = field(default_factory=Counter)
    errors: int = 0
    outside: dict[str, Region] = field(default_factory=dict)
    worst: Kept | None = None
    integrity: dict[str, Any] = field(default_factory=lambda: pooled(()))
    steering: dict[str, tuple[int, dict[str, Any]]] = field(default_factory=dict)
    groups: dict[str, Region] = field(default_factory=dict)
    measured: Measured | None = None

    def __post_init__(self) -> None:
        self.failed = Worst(max(10, self.room // 10))
        self.surprises = Worst(SURPRISES_MAX)
        self.drawn = Sample(-(-self.planned // self.room))
        self._nearest: dict[str, tuple[float, dict[str, Any]]] = {}
        self._values = {name: array("d") for name in self.case.file.mean}

    def add(self, result: Result) -> None:
        """Take in a run."""
        self._add_sums(result)
        if self.measured is not None:
            self.measured.add(result)
        shares = [(f"{e['subject']}.{e['name']}", margin_of(e), e) for e in result["expect"]]
        for name, share, entry in shares if result["verdict"] != UNJUDGED else ():
            if name not in self._nearest or share < self._nearest[name][0]:
                self._nearest[name] = share, entry
        run = kept(result, margin(result))
        self.count += 1
        self.drawn.add(run)
        if run.verdict != UNJUDGED and (self.worst is None or run.margin < self.worst.margin):
            self.worst = run
        if self.case.known(run.point):
            self.known += 1
            if run.verdict == "pass":
                self.surprises.add(run)
        elif run.verdict == ERROR:
            self.errors += 1
            self.groups.setdefault(ERROR, Region()).add(run.point)
        elif run.verdict == UNJUDGED:
            self.unjudged[why_unjudged(result)] += 1
            for slot, quantity, _ in beyond(result):
                self.outside.setdefault(f"{slot}: {quantity}", Region()).add(run.point)
        elif run.verdict != OPEN:
            self._count(run, result["metrics"])

    def why_failed(self, run: Kept) -> str:
        """The reason why a run failed, and why that was known; "" of one that passed."""
        known = self.case.known(run.point) if run.reason else ""
        return f"known failure: {run.reason} ({known})" if known else run.reason

    def _add_sums(self, result: Result) -> None:
        """Take in what is added up over runs."""
        if shares := result.get(SUMMARY):
            self.integrity = pooled((self.integrity, shares))
        if STEERING_TAG in self.case.file.tags and (classes := result.get(STEERING)):
            point = ", ".join(f"{name} {value}" for name, value in result["point"].items())
            count, before = self.steering.get(point, (0, pooled_classes(())))
            self.steering[point] = count + 1, pooled_classes((before, classes))
            if len(self.steering) > POINTS_MAX or ALL_POINTS in self.steering:
                counts, shares = zip(*self.steering.values(), strict=True)
                self.steering = {ALL_POINTS: (sum(counts), pooled_classes(shares))}

    def _count(self, run: Kept, metrics: Mapping[str, float | None]) -> None:
        """Take in a run that counts for the rate."""
        self.counted += 1
        for name, values in self._values.items():
            value = metrics.get(name)
            values.append(nan if value is None else value)
        if run.verdict == "pass":
            self.passed += 1
            return
        self.failed.add(run)
        self.groups.setdefault(run.reason.partition(":")[0], Region()).add(run.point)

    @property
    def nearest(self) -> list[tuple[str, float, dict[str, Any]]]:
        """For each limit: the run nearest to it or farthest beyond, as name, margin, entry; least first.

        Limits that can only be kept or not are left out where they are kept.
        """
        rows = [
            (name, share, e)
            for name, (share, e) in self._nearest.items()
            if e["result"] == "fail" or not is_kept_or_not(e)
        ]
        return sorted(rows, key=lambda row: row[1])

    def judge(self) -> None:
        """Work out the verdict from the runs."""
        claim = self.case.file.claim
        is_complete = self.count >= self.planned
        shows = self.passed, self.counted, claim.pass_rate, claim.confidence
        self.verdict = verdict(*shows, is_complete=is_complete)
        self.text = describe(*shows, self.verdict) if self.counted or not self.known else ""
        if self.known:
            about = f"{self.known} of {self.count} runs lie where a failure is known"
            self.text = f"{self.text}; {about}" if self.text else about
        for name, bounds in self.case.file.mean.items():
            outcome, text = _mean(name, self._values[name], bounds)
            self.means.append(text)
            self.verdict = max(self.verdict, outcome, key=(SHOWN, NOT_SHOWN, BROKEN).index)
        lost = [f"{n} of {self.count} runs not judged: {why}" for why, n in self.unjudged.items()]
        if self.errors and self.worst is not None:
            lost.append(errors_of(self.errors, self.count, self.worst.reason))
        if lost:
            self.verdict = BROKEN if self.verdict == BROKEN else NOT_JUDGED
            self.text = "; ".join([self.text] * bool(self.counted) + lost)


def cells_of(cases: Sequence[Case], candidates: Iterable[str], planned: Mapping[str, int],
             results: Iterable[Result]) -> list[Cell]:  # fmt: skip
    """Judged cells by case and candidate. planned: how many runs a case is to have with each candidate."""
    names = list(candidates)
    room = max(DRAWN_LEAST, min(DRAWN_MAX, KEPT_MAX // (len(cases) * len(names))))
    cells = {(c.name, name): Cell(c, name, planned.get(c.name, 0), room) for c in cases for name in names}
    if len(names) > 1:  # their runs are paired
        for cell in cells.values():
            cell.measured = Measured()
    for result in results:
        cells[result["case"], result["candidate"]].add(result)
    for cell in cells.values():
        cell.judge()
    return list(cells.values())


def errors_of(count: int, of: int, first: str) -> str:
    """What is reported of runs that came to an error."""
    return f"{count} of {of} runs came to an error, nothing is judged from them: {first}"


def _mean(name: str, values: Sequence[float], bounds: Any) -> tuple[str, str]:
    """Verdict on a mean with its interval of 95 %, and the text that says so. nan: no value."""
    count = sum(v == v for v in values)
    if count < max(2, len(values)):
        text = f"{name}: {count} of {len(values)} runs have it"
        return BROKEN if count < len(values) else NOT_SHOWN, text
    mean, (low, high) = fsum(values) / count, mean_interval(values)
    inside = (bounds.max is None or high <= bounds.max) and (bounds.min is None or low >= bounds.min)
    outside = (bounds.max is not None and low > bounds.max) or (bounds.min is not None and high < bounds.min)
    middle, *ends = (num(v, beside=(mean, low, high)) for v in (mean, low, high))
    text = f"{name}: mean {middle} ({' to '.join(ends)})"
    return (SHOWN if inside else BROKEN if outside else NOT_SHOWN), text
