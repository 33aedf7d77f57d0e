"""`swath test estimate`: the probability that a limit of a case is broken, in its own folder.

Parameters are drawn by their exposure, the noise of every run by a seed of its own. Which runs come next
depends on the results so far and on nothing else, so an estimate that was stopped is gone through again with
the runs that are in a journal, and goes on where it was. With a cheap level the search is done there, in the
folder `cheap`; a few rounds at the dear level correct it, and the last round, from which alone the number
comes, is of dear runs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import Extra, InputError, SwathError
from swath.core.number_text import num, percent_of
from swath.core.random import Stream
from swath.runtime.workers import workers_kept
from swath.signals import F64, Mask
from swath.tools.function_test.case import Case, Point, Scalar, Varied, one_case
from swath.tools.function_test.estimate.rare import (
    DEFENSIVE,
    ESS_LEAST,
    OVERLOOKED_MOST,
    Hunt,
    Rate,
    log_exposure,
    rate_of,
)
from swath.tools.function_test.judging.first_batch import margin_telling_nothing, name_first
from swath.tools.function_test.judging.margin import judged_margin
from swath.tools.function_test.judging.verdict import BROKEN, NOT_SHOWN, SHOWN
from swath.tools.function_test.plan import AS_SET, Plan, code_hash
from swath.tools.function_test.pool import Done
from swath.tools.function_test.session import Session, claim_folder, read_asked
from swath.tools.function_test.stored_line import Result

ESTIMATE, CHEAP = "estimate.json", "cheap"
LEAST = 20  # runs of an estimate
SEARCHING, CORRECTING = 0.5, 0.2  # share of the runs before the last round: without a cheap level, with one
UNKNOWN_MOST = 0.1  # of the probability that may lie in runs that were not judged
UNSEEN_MOST = 0.5  # of the probability that may lie where the cheap level keeps the limit


@dataclass(frozen=True)
class Estimate:
    """What is asked.

    case: a bundled one or a file
    limit: name of the one that is broken, "" = any
    budget: runs from which the number comes, and of the search without a cheap level
    cheap: changes of the scenario for the runs that search, () = none
    cheap_budget: how many
    """

    case: str
    limit: str = ""
    budget: int = 2000
    sets: tuple[str, ...] = ()
    cheap: tuple[str, ...] = ()
    cheap_budget: int = 0
    seed: int = 1
    code: str = field(default_factory=code_hash)

    @property
    def before(self) -> int:
        """Runs before the last round, of the budget."""
        return int((CORRECTING if self.cheap else SEARCHING) * self.budget)

    @property
    def all_cheap(self) -> int:
        """Runs at the cheap level: of the search, and beside the last round."""
        return self.cheap_budget + self.budget - self.before if self.cheap else 0


@dataclass(frozen=True)
class Distribution:
    """The distribution of a parameter by its exposure.

    edges: of a number's buckets
    values: of what has no range
    shares: of them up to the end of each, from 0 to 1
    """

    shares: F64
    edges: F64 | None = None
    values: Sequence[Scalar] = ()

    def value(self, share: float) -> Scalar:
        """The value below which this share of the working time lies."""
        if self.edges is not None:
            return float(f"{np.interp(share, self.shares, self.edges):.8g}")
        return self.values[min(len(self.values), int(np.searchsorted(self.shares, share, side="right"))) - 1]


def distribution_of(varied: Varied) -> Distribution:
    """The distribution of a parameter by its exposure; all values alike where it has none."""
    if varied.range is None:
        values = varied.drawn_values
        return Distribution(_cumulated(varied.exposure or [1.0] * len(values)), values=values)
    parts = len(varied.buckets) - 1 if varied.buckets else len(varied.exposure) or 1
    edges = np.array(varied.buckets or np.linspace(*varied.range, parts + 1), dtype=float)
    return Distribution(_cumulated(varied.exposure or [1.0] * parts), edges)


def _cumulated(each: Sequence[float]) -> F64:
    whole = np.concatenate([[0.0], np.cumsum(each)])
    return np.asarray(whole / whole[-1])


@dataclass(frozen=True)
class Round:
    """Runs that were done together. level: `cheap` or ""; places: in normal space, (n, d); points: there.

    margins: (n,), nan = not judged
    results: of the runs
    """

    level: str
    places: F64
    points: Sequence[Point]
    margins: F64
    results: Sequence[Result]


@dataclass(frozen=True)
class Estimated:
    """An estimate in its folder.

    last: the round from which the number comes
    weights: of its runs, exposure over density, (n,)
    overlooked: which lie outside the regions that the search found, (n,) of bool
    cheap_margins: of the same points and seeds at the cheap level, None without one
    """

    folder: Path
    asked: Estimate
    case: Case
    rounds: Sequence[Round]
    last: Round
    weights: F64
    overlooked: Mask
    cheap_margins: F64 | None

    @property
    def limit(self) -> str:
        """What is broken, in words."""
        return self.asked.limit or "any limit"

    @cached_property
    def rate(self) -> Rate:
        """The probability of failure."""
        return rate_of(self.weights, self.last.margins < 0.0, self.overlooked)

    @cached_property
    def unknown(self) -> Rate:
        """The probability of a run that is not judged, or comes to an error."""
        return rate_of(self.weights, np.isnan(self.last.margins))

    @cached_property
    def cheap_rate(self) -> Rate | None:
        """The probability of failure at the cheap level, from the same points and seeds."""
        return None if self.cheap_margins is None else rate_of(self.weights, self.cheap_margins < 0.0)

    @property
    def unseen(self) -> float:
        """Share of the probability that lies in runs in which the cheap level keeps the limit."""
        if self.cheap_margins is None or not self.rate.failures:
            return 0.0
        fails = self.last.margins < 0.0
        unseen = fails & ~(self.cheap_margins < 0.0)
        return float(np.sum(self.weights[unseen]) / np.sum(self.weights[fails]))

    @cached_property
    def refusals(self) -> list[str]:
        """Why no number is given and what would be needed; empty where one is."""
        rate, unknown, said = self.rate, self.unknown, list[str]()
        if unknown.failures and unknown.value > UNKNOWN_MOST * rate.value:
            each = zip(self.last.results, self.last.margins, strict=True)
            first = next(result for result, margin in each if isnan(margin))
            said.append(
                f"{unknown.failures} runs of the last round were not judged or came to an error, with a "
                f"probability of {num(unknown.value)}: {first['reason']}; a dearer level or less variation "
                "is needed"
            )
        if not rate.failures:
            said.append(f"no failure in the {rate.runs} runs of the last round: {self._none_found}")
        elif rate.overlooked > OVERLOOKED_MOST:
            met = int(np.sum(self.overlooked & (self.last.margins < 0.0)))
            said.append(
                f"{met} failures of the last round, {percent_of(rate.overlooked)} of the probability, lie "
                f"where the search had found none: a longer one is needed: --budget {2 * self.asked.budget}"
            )
        elif rate.ess < ESS_LEAST:
            more = -(-self.asked.budget * ESS_LEAST / max(rate.ess, 1.0) // 1000) * 1000
            said.append(
                f"{rate.failures} failures are as sure as {num(rate.ess)} of equal weight, {num(ESS_LEAST)} "
                f"are needed: about --budget {num(more)}"
            )
        if self.unseen > UNSEEN_MOST:
            said.append(
                f"the two levels disagree: the cheap one keeps the limit in {percent_of(self.unseen)} of the "
                "failures at the dear one, by their weight, so others may have been missed: a nearer cheap "
                "level, or an estimate without one, is needed"
            )
        return said

    @property
    def _none_found(self) -> str:
        if len(set(self.last.margins.tolist())) == 1:
            return "all have the same margin, which leads nowhere: a limit on a number is needed"
        return "a longer search (--budget) or a limit nearer to what the runs do is needed"

    @property
    def telling_nothing(self) -> dict[str, str]:
        """What tells nothing in the first round, each with a line that says so."""
        return margin_telling_nothing((*self.rounds, self.last)[0].results, self.asked.limit)

    @property
    def blind(self) -> float:
        """Probability above which a region of failures that the search overlooked would have been met in the
        last round, with 95 %: 3 over its runs drawn as the exposure.
        """
        return min(1.0, 3.0 / (DEFENSIVE * max(1, len(self.weights))))

    @cached_property
    def telling(self) -> dict[str, float]:
        """How far the failures of each parameter lie from its exposure, most first: Kullback-Leibler
        divergence of normal densities in normal space [nat]; 0 without failures.
        """
        names, fails = list(self.case.file.vary), self.last.margins < 0.0
        if not self.rate.failures:
            return dict.fromkeys(names, 0.0)
        share = self.weights[fails] / np.sum(self.weights[fails])
        places = self.last.places[fails]
        mean = share @ places
        variance = np.maximum(share @ (places - mean) ** 2, 1e-6)
        apart = 0.5 * (mean**2 + variance - 1.0 - np.log(variance))
        return dict(sorted(zip(names, apart.tolist(), strict=True), key=lambda pair: -pair[1]))

    @property
    def results(self) -> list[Result]:
        """Results of all runs at the level that is judged."""
        rounds = [r for r in (*self.rounds, self.last) if not r.level]
        return [result for r in rounds for result in r.results]

    def verdict(self, at_most: float | None) -> str:
        """Whether the probability is shown to be at most this; "" where nothing is claimed."""
        if at_most is None:
            return ""
        if self.refusals or self.rate.low <= at_most < self.rate.high:
            return NOT_SHOWN
        return SHOWN if self.rate.high <= at_most else BROKEN

    @property
    def text(self) -> str:
        """A line for the terminal."""
        rate = self.rate
        if self.refusals:
            return f"no number: {'; '.join(self.refusals)}"
        return (
            f"{self.limit} broken with probability {num(rate.value)} a run (95 %: {num(rate.low)} to "
            f"{num(rate.high)}), {rate.failures} failures in the {rate.runs} runs of the last round, "
            f"effective {num(rate.ess)}"
        )

    @property
    def plain(self) -> dict[str, Any]:
        """For a file: what is reported, and what it rests on."""
        rate, cheap = self.rate, self.cheap_rate
        given = not self.refusals
        return {
            "case": self.case.name,
            "limit": self.asked.limit or None,
            "probability": rate.value if given else None,
            "low": rate.low if given else None,
            "high": rate.high if given else None,
            "confidence": 0.95,
            "not_supported": list(self.refusals),
            "runs": sum(len(r.margins) for r in (*self.rounds, self.last) if not r.level),
            "cheap_runs": sum(len(r.margins) for r in self.rounds if r.level)
            + (0 if self.cheap_margins is None else len(self.cheap_margins)),
            "last_round": {"runs": rate.runs, "failures": rate.failures, "effective_failures": rate.ess,
                           "not_judged": self.unknown.failures, "overlooked_share": rate.overlooked},
            "cheap": None if cheap is None else {"probability": cheap.value, "low": cheap.low,
                                                 "high": cheap.high, "effective_failures": cheap.ess,
                                                 "unseen_share": self.unseen},
        }  # fmt: skip


class _Rounds:
    """Does rounds in a folder."""

    def __init__(self, folder: Path, asked: Estimate, case: Case, do: Callable[[Session], None]) -> None:
        self._folder, self._asked, self._do = folder, asked, do
        self._distributions = {name: distribution_of(varied) for name, varied in case.file.vary.items()}
        self.rng = Stream(asked.seed, f"estimate {case.name}").at()
        self.rounds: list[Round] = []
        self._planned = {"": 0, CHEAP: 0}

    def hunt(self, hunt: Hunt, level: str) -> Hunt:
        """Search at a level."""
        while hunt.left:
            found = self.do(hunt.next(self.rng), level)
            hunt.tell(found.places, found.margins)
            self.rounds.append(found)
        return hunt

    def do(self, places: F64, level: str) -> Round:
        """Runs at places, with the seeds that follow those of the rounds so far.

        SwathError where one of them has no result.
        """
        start = 1 + sum(len(r.places) for r in self.rounds)
        chosen = [(start + n, self._point(place)) for n, place in enumerate(places)]
        session = self._session(level, tuple(chosen))
        self._planned[level] += len(chosen)
        self._do(session)
        results = session.results()
        if len(results) != len(places):
            missing = f"{len(places) - len(results)} of {len(places)} runs of a round have no result"
            raise SwathError(f"{session.folder}: {missing}; the same command goes on")
        margins = np.array([judged_margin(result, self._asked.limit) for result in results])
        return Round(level, places, [point for _, point in chosen], margins, results)

    def _session(self, level: str, points: tuple[tuple[int, Point], ...]) -> Session:
        folder, sets, at = self._folder, self._asked.sets, ""
        if level:
            folder, sets, at = folder / CHEAP, (*sets, *self._asked.cheap), AS_SET
        plan = Plan(self._asked.case, sets=sets, level=at, points=points, code=self._asked.code)
        return Session(folder, plan, self._planned[level])

    def _point(self, place: F64) -> dict[str, Scalar]:
        shares = _normal_share(place)
        each = zip(self._distributions.items(), shares, strict=True)
        return {name: distribution.value(float(share)) for (name, distribution), share in each}


@workers_kept()
def run_estimate(folder: Path, asked: Estimate, workers: int, done: Done, client: Any = None) -> Estimated:
    """Do the runs that are not in the folder; `done` is called with each new result.

    client: of dask, None = on `workers` processes here. InputError for what cannot be estimated, and where
    the folder holds something else.
    """
    case = check(asked)
    claim_folder(folder / ESTIMATE, asked, "an estimate")

    seen: list[Session] = []

    def do(session: Session) -> None:
        if not session.first:
            session.plan.check()
        results = session.made(workers, done, client)
        if not seen:
            name_first({}, margin_telling_nothing(results, asked.limit))
        seen.append(session)

    return _gone_through(folder, asked, case, do)


def open_estimate(folder: Path) -> Estimated | None:
    """The finished estimate that a folder holds, None where it is something else."""
    asked = read_asked(folder / ESTIMATE, Estimate, "an estimate")
    if asked is None:
        return None

    def is_done(session: Session) -> None:
        if any(True for _ in session.left()):
            expected = "expected a finished estimate: the command that began it goes on"
            raise InputError("folder", str(folder), expected)

    return _gone_through(folder, asked, check(asked), is_done)


def _gone_through(folder: Path, asked: Estimate, case: Case, do: Callable[[Session], None]) -> Estimated:
    rounds = _Rounds(folder, asked, case, do)
    count, start = len(case.file.vary), None
    if asked.cheap:
        start = rounds.hunt(Hunt(count, asked.cheap_budget), CHEAP).last()
    hunt = rounds.hunt(Hunt(count, asked.before, start), "")
    density = hunt.last()
    places = density.draw(rounds.rng, asked.budget - asked.before)
    last = rounds.do(places, "")
    cheap = rounds.do(places, CHEAP).margins if asked.cheap else None
    weights = np.exp(log_exposure(places) - density.log_density(places))
    return Estimated(folder, asked, case, rounds.rounds, last, weights, hunt.overlooked(places), cheap)


def check(asked: Estimate) -> Case:
    """The one case of an estimate. Raises InputError for what cannot be estimated."""
    case = one_case(asked.case, asked.limit)
    if not case.file.vary:
        raise InputError("vary", None, "expected a parameter that varies", file=case.document.file)
    for name, value in (("--budget", asked.budget), ("--cheap-budget", asked.cheap_budget)):
        if value < LEAST and (name == "--budget" or asked.cheap):
            raise InputError(name, value, f"expected {LEAST} runs or more")
    Plan(asked.case, sets=asked.sets).check()
    if asked.cheap:
        Plan(asked.case, sets=(*asked.sets, *asked.cheap), level=AS_SET).check()
    return case


def _normal_share(place: F64) -> F64:
    with Extra("test", "swath test estimate"):
        from scipy.special import ndtr
    return np.asarray(ndtr(place))
