"""`swath test search`: the boundary of failure of a case, in its own folder.

Rounds of a few runs each: which ones depends on the results so far and on nothing else, neither on how many
workers do them nor on who is first. A search that was stopped is gone through again, with the runs that are
in a journal taken from there, and goes on where it was.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.number_text import num, percent_of
from swath.runtime.workers import workers_kept
from swath.signals import F64
from swath.tools.function_test.case import Case, Point, Scalar, one_case
from swath.tools.function_test.journal import TABLE, read_table
from swath.tools.function_test.judging.first_batch import margin_telling_nothing, name_first
from swath.tools.function_test.judging.judged import unjudged_lines
from swath.tools.function_test.judging.margin import judged_margin
from swath.tools.function_test.judging.verdict import describe, lower_bound, verdict
from swath.tools.function_test.plan import Plan, code_hash
from swath.tools.function_test.pool import Done
from swath.tools.function_test.search.boundary import Boundary, first_points, next_points, sobol_points
from swath.tools.function_test.session import Session, claim_folder, read_asked
from swath.tools.function_test.stored_line import Result

SEARCH = "search.json"
FEWEST = 8  # runs of a search


@dataclass(frozen=True)
class Search:
    """What a search asks.

    case: a bundled one or a file
    limit: name of the one whose boundary it is, "" = of all together
    batch: runs of a round
    sets: changes of the scenario
    """

    case: str
    limit: str = ""
    batch: int = 4
    sets: tuple[str, ...] = ()
    level: str = ""
    code: str = field(default_factory=code_hash)


@dataclass(frozen=True)
class Searched:
    """A search in its folder: what it asks, its case, its runs so far."""

    folder: Path
    search: Search
    case: Case
    results: Sequence[Result]

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Parameters that are searched, with their ranges."""
        return self.case.ranges

    @property
    def boundary(self) -> Boundary:
        """What the judged runs say. InputError for fewer than a search has."""
        if len(self.judged) < FEWEST:
            expected = f"expected {FEWEST} judged runs or more: continue the search"
            said = f"{len(self.judged)} ({'; '.join(self._unjudged)})" if self._unjudged else len(self.judged)
            raise InputError("search", said, expected, file=self.folder / SEARCH)
        points = self.in_cube([result["point"] for result in self.judged])
        return Boundary(list(self.ranges), points, self.margins(self.judged))

    @property
    def judged(self) -> Sequence[Result]:
        """The runs that say whether the limit is kept."""
        known = np.isfinite(self.margins(self.results))
        return [result for result, is_known in zip(self.results, known, strict=True) if is_known]

    @property
    def _unjudged(self) -> list[str]:
        """What of the others is to be said."""
        errors = [result["reason"] for result in self.results if result["verdict"] == "error"]
        left = np.isnan(self.margins(self.results))
        return [
            *([f"{len(errors)} runs came to an error, the first: {errors[0]}"] if errors else []),
            *unjudged_lines(result for result, is_left in zip(self.results, left, strict=True) if is_left),
        ]

    @property
    def telling_nothing(self) -> dict[str, str]:
        """What tells nothing in the runs before those at the boundary, each with a line that says so."""
        return margin_telling_nothing(self.results[: self._evenly_spread()], self.search.limit)

    def margins(self, results: Sequence[Result]) -> F64:
        """Margins to the limit that is asked for, (n,), nan where nothing is judged."""
        return np.array([judged_margin(result, self.search.limit) for result in results])

    def passed(self, first: int | None = None) -> tuple[int, int]:
        """How many of the first runs, or of all, keep the limit, of how many that are judged."""
        margins = self.margins(self.results[:first])
        return int(np.sum(margins >= 0.0)), int(np.sum(np.isfinite(margins)))

    @property
    def shows(self) -> list[str]:
        """What the runs show, and what is only expected.

        A rate is shown by the runs that were spread evenly before the search went to the boundary; by all of
        them where none fails, for then it found no boundary to go to.
        """
        claim, (passed, count) = self.case.file.claim, self.passed()
        said = self._unjudged
        if passed == count:
            result = verdict(passed, count, claim.pass_rate, claim.confidence, is_complete=True)
            return [describe(passed, count, claim.pass_rate, claim.confidence, result), *said]
        kept, even = self.passed(self._evenly_spread())
        low = 100 * lower_bound(kept, even, claim.confidence)
        passing, unknown = self.boundary.shares
        expected = f"{percent_of(passing)} of the ranges pass, {percent_of(unknown)} may be on either side"
        return [
            f"of the first {even} runs, spread evenly over the ranges, {kept} pass, shows >= {num(low)} %",
            f"expected between the runs, not shown: {expected}",
            *said,
        ]

    def _evenly_spread(self) -> int:
        """How many runs came before those that were chosen by what the others had shown."""
        even = sobol_points(len(self.results), len(self.ranges))
        chosen = (_point(self.case, row) != r["point"]
                  for row, r in zip(even, self.results, strict=True))  # fmt: skip
        return next((number for number, is_chosen in enumerate(chosen) if is_chosen), len(self.results))

    def in_cube(self, points: Sequence[Point]) -> F64:
        """Points as shares of the ranges, (n, d)."""
        return np.array([
            [(float(point[name]) - low) / (high - low) for name, (low, high) in self.ranges.items()]
            for point in points
        ])  # fmt: skip

    def right_of(self, folder: Path) -> tuple[int, int]:
        """How many runs of another test of this case the boundary foretells, of how many."""
        table = folder / TABLE
        if not os.path.isfile(table):
            raise InputError("--check", str(folder), f"expected the folder of a function test, with {TABLE}")
        names = set(self.ranges)
        rows = [r for r in read_table(table) if r["case"] == self.case.name and names <= set(r["point"])]
        if not rows:
            raise InputError("--check", str(folder), f"expected runs of the case {self.case.name}")
        foretold = self.boundary.passes(self.in_cube([row["point"] for row in rows]))
        margins = self.margins(rows)
        right = (foretold == (margins >= 0.0)) & np.isfinite(margins)
        return int(np.sum(right)), int(np.sum(np.isfinite(margins)))


@workers_kept()
def run_search(
    folder: Path, search: Search, budget: int, workers: int, done: Done, client: Any = None
) -> Searched:
    """Search with `budget` runs, those in the folder among them; `done` is called with each new result.

    client: of dask, None = on `workers` processes here
    """
    case = _check(search, budget)
    claim_folder(folder / SEARCH, search, "a search")
    budget = max(budget, len(Session(folder, Plan(search.case)).counted()))
    seeds, points = case.seeds, list[Point]()
    found = Searched(folder, search, case, [])
    while len(points) < budget:
        if points:
            margins = found.margins(found.results)
            more = next_points(found.in_cube(points), margins, min(search.batch, budget - len(points)))
        else:
            more = first_points(len(case.ranges), budget)
        points += [_point(case, row) for row in more]
        chosen = tuple((seeds[i % len(seeds)], point) for i, point in enumerate(points))
        session = Session(folder, Plan(search.case, sets=search.sets, level=search.level, points=chosen))
        found = replace(found, results=session.made(workers, done, client))
        if len(points) == len(more):
            name_first({}, found.telling_nothing)
    return found


def open_search(session: Session) -> Searched | None:
    """The search that a folder holds, None where it is another function test."""
    search = read_asked(session.folder / SEARCH, Search, "a search")
    if search is None:
        return None
    return Searched(session.folder, search, session.plan.found[0], session.results())


def _point(case: Case, row: F64) -> dict[str, Scalar]:
    """A point of the cube as values, four digits each; parameters without a range at their first value."""
    values: dict[str, Scalar] = {name: varied.at[0] for name, varied in case.file.vary.items()}
    for (name, (low, high)), share in zip(case.ranges.items(), row, strict=True):
        values[name] = float(f"{low + share * (high - low):.4g}")
    return values


def _check(search: Search, budget: int) -> Case:
    """The one case of a search. Raises InputError for what cannot be searched."""
    case = one_case(search.case, search.limit)
    if not case.ranges:
        expected = "expected a parameter with a range, whose boundary is to be found"
        raise InputError("vary", ", ".join(case.file.vary) or None, expected, file=case.document.file)
    if budget < FEWEST:
        raise InputError("--budget", budget, f"expected {FEWEST} runs or more")
    Plan(search.case, sets=search.sets).check()
    return case
