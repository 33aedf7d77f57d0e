"""`swath test compare`: the runs of two results, pair by pair."""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import ceil, isfinite, log2
from pathlib import Path
from statistics import fmean
from typing import Any

from swath.core.errors import InputError
from swath.core.number_text import signed
from swath.judge.catalogue import load_evaluators
from swath.sensing.lidar.empirical import BIASED
from swath.tools.function_test.fidelity import CHEAP, LEVEL_BIAS_M, levels_of, scanners
from swath.tools.function_test.journal import PLAN, TABLE, read_table
from swath.tools.function_test.judging.first_batch import telling_nothing
from swath.tools.function_test.judging.judged import OPEN, UNJUDGED
from swath.tools.function_test.judging.margin import MARGIN
from swath.tools.function_test.judging.paired import (
    ALPHA,
    Difference,
    caveat,
    difference,
    holm,
    paired_values,
    verdict_test,
)
from swath.tools.function_test.plan import looked_at
from swath.tools.function_test.session import open_session
from swath.tools.function_test.stored_line import Result

VERDICTS = "verdicts"
METRICS = (
    "lateral_rms_m", "lateral_bias_m", "edge_rmse_m", "edge_bias_m", "detection_availability",
    "sure_wrong_share",
)  # fmt: skip
SAME_BYTES, SAME_VERDICT, BETTER, WORSE = "same bytes", "same verdict", "now passes", "now fails"
Key = tuple[str, str, int, str]


@dataclass(frozen=True)
class Comparison:
    """Pairs of results, old and new. metrics: compared; alone: runs that only one of the two has.

    undecided: difference of an error of edge or line up to which the level of the scanner cannot decide [m]
    alpha: chance with which one difference is shown that is not there
    directions: `lower` or `higher` of metrics, what is better, where it is not what the catalogue says
    """

    pairs: Sequence[tuple[Result, Result]]
    metrics: Sequence[str]
    alone: int
    undecided: float = 0.0
    alpha: float = ALPHA
    directions: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def outcomes(self) -> list[str]:
        """Outcome of each pair."""
        return [outcome(old, new) for old, new in self.pairs]

    @cached_property
    def differences(self) -> dict[str, Difference]:
        """The difference of each metric, pooled over all pairs that have it."""
        values = {name: paired_values(self.pairs, name) for name in self.metrics}
        return {name: difference(found, 1.0 - self.alpha) for name, found in values.items() if found}

    def difference_texts(self, name: str) -> tuple[str, str]:
        """A difference and its interval, with the places of the means of both sides."""
        d, sides = self.differences[name], zip(*self.pairs, strict=True)
        known = ([run["metrics"].get(name) for run in side] for side in sides)
        of = [fmean(v for v in side if v is not None and isfinite(v)) for side in known]
        middle, *ends = (signed(v, of=of) for v in (d.estimate, d.low, d.high))
        return middle, " to ".join(ends) if isfinite(d.high) else "too few pairs"

    @cached_property
    def shown(self) -> set[str]:
        """Metrics, and `verdicts`, whose difference is shown; any of them falsely with a chance of alpha."""
        changed = [self.outcomes.count(what) for what in (BETTER, WORSE)]
        p = {name: d.p for name, d in self.differences.items()}
        return holm({**p, VERDICTS: verdict_test(*changed)}, self.alpha)

    @property
    def least_pairs(self) -> int:
        """Pairs of which a test, at best 2 / 2^n, shows anything beside all other questions."""
        return ceil(log2(2.0 * (len(self.differences) + 1) / self.alpha))

    @property
    def telling_nothing(self) -> dict[str, str]:
        """What tells nothing in the runs of both, each with a line that says so."""
        return telling_nothing([result for pair in self.pairs for result in pair], self.differences)

    def says(self, name: str) -> str:
        """`better`, `worse`, `changed` (of a metric where neither direction is better), or nothing shown;
        `undecided at empirical` where other detectors differ by less than the level's own bias.
        """
        if name not in self.shown:
            return "no difference shown"
        if name in BIASED and abs(self.differences[name].estimate) <= self.undecided:
            return f"undecided at {CHEAP}"
        if name == VERDICTS:
            return "worse" if self.outcomes.count(WORSE) > self.outcomes.count(BETTER) else "better"
        good = better_of(name) or self.directions.get(name)
        if not good:
            return "changed"
        return "better" if (self.differences[name].estimate > 0.0) == (good == "higher") else "worse"

    def beside(self, name: str) -> str:
        """What stands beside what is shown to be better: which harm is not excluded, and the worst."""
        if name == VERDICTS:
            return caveat(len(self.pairs), f"{self.outcomes.count(WORSE)} of them now fail")
        d = self.differences[name]
        return caveat(d.count, f"worst tenth {signed(self.worst_tenth(name))}")

    def worst_tenth(self, name: str) -> float:
        """Mean difference of a metric over the tenth of the pairs that is worst."""
        return self.differences[name].worst_tenth(self.directions.get(name) or better_of(name))

    @property
    def is_worse(self) -> bool:
        """True when something is shown to be worse."""
        return any(self.says(name) == "worse" for name in self.shown)

    def by_case(self) -> dict[str, list[str]]:
        """Outcomes of the pairs of each case."""
        found: dict[str, list[str]] = {}
        for (old, _), what in zip(self.pairs, self.outcomes, strict=True):
            found.setdefault(old["case"], []).append(what)
        return found


def outcome(old: Result, new: Result) -> str:
    """What a pair comes to, most alike first; one that is not judged shows no difference."""
    if old["digest"] and old["digest"] == new["digest"]:
        return SAME_BYTES
    if {UNJUDGED, OPEN} & {old["verdict"], new["verdict"]}:
        return SAME_VERDICT
    passed = old["verdict"] == "pass", new["verdict"] == "pass"
    return SAME_VERDICT if passed[0] == passed[1] else BETTER if passed[1] else WORSE


def compare(old: str, new: str, metrics: Sequence[str] = (), alpha: float = ALPHA) -> Comparison:
    """The pairs of two results, each `FOLDER` or `FOLDER:CANDIDATE`. InputError where there are none.

    metrics: to compare, named before the results are looked at; () = METRICS. Runs pair by case, point and
    seed, and by candidate where neither side names one. alpha: as of the comparison
    """
    a, b = _results(old), _results(new)
    keys = [key for key in a if key in b]
    if not keys:
        raise InputError("compare", new, f"expected runs of the same cases, points and seeds as in {old}")
    alone = len(a) + len(b) - 2 * len(keys)
    pairs = [(a[key], b[key]) for key in keys]
    return Comparison(pairs, metrics or METRICS, alone, _undecided(old, new), alpha)


def _undecided(old: str, new: str) -> float:
    """What the cheap level of the scanner cannot decide between two detectors [m]; 0 at the dear one, for one
    detector with other parameters, and where a plan is not there.
    """
    (before, was_cheap), (after, is_cheap) = _detectors(old), _detectors(new)
    return LEVEL_BIAS_M if before != after and (was_cheap or is_cheap) else 0.0


def _detectors(source: str) -> tuple[set[tuple[str, str]], bool]:
    """Levels of the edge detectors of a result, and whether a scanner is at the cheap level."""
    folder, candidate = _parts(source)
    found, is_cheap, seen = set[tuple[str, str]](), False, set[str]()
    try:
        for run in open_session(Path(folder), same_code=False).runs():
            sets = run.shadows.get(candidate, run.sets if candidate in ("", run.candidate) else None)
            if run.case not in seen and sets is not None:
                seen.add(run.case)
                scenario = looked_at(run.scenario, sets)
                found |= set(levels_of(scenario).items())
                is_cheap |= bool(scanners(scenario, CHEAP))
    except InputError:  # the table alone is there, or the case is not as it was
        return set(), False
    return found, is_cheap


def _parts(source: str) -> tuple[str, str]:
    """Folder and candidate, "" where none is named."""
    folder, _, candidate = (source, "", "") if os.path.isdir(Path(source)) else source.rpartition(":")
    return folder, candidate


def _results(source: str) -> dict[Key, Result]:
    """Results by case, point, seed and candidate, the latter empty where one is named."""
    folder, candidate = _parts(source)
    table = Path(folder) / TABLE
    if not os.path.isfile(table) and not os.path.isfile(table.with_name(PLAN)):
        raise InputError("compare", source, f"expected the folder of a function test, with {TABLE} or {PLAN}")
    is_stopped = not os.path.isfile(table)  # before its end
    rows = open_session(Path(folder), same_code=False).results() if is_stopped else read_table(table)
    if candidate and candidate not in (there := sorted({row["candidate"] for row in rows})):
        raise InputError("compare", source, f"expected a candidate of {', '.join(there)}")
    return {
        (row["case"], json.dumps(row["point"], sort_keys=True), row["seed"],
         "" if candidate else row["candidate"]): row
        for row in sorted(rows, key=lambda row: (row["case"], row["seed"], row["id"]))
        if not candidate or row["candidate"] == candidate
    }  # fmt: skip


def better_of(metric: str) -> str:
    """`lower`, `higher` or "" of a metric: what is better."""
    if metric == MARGIN:
        return "higher"
    known: dict[str, Any] = load_evaluators().metrics
    found = known.get(metric.rpartition(".")[2])
    return "" if found is None else str(found.better)
