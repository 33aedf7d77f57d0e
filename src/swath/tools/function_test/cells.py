"""Results put together: a cell is a case with a candidate, pooled over points and seeds."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from math import sqrt
from typing import Any

from swath.judge.limits import check_metric
from swath.scenario.sections import Limit
from swath.tools.function_test.case import Case
from swath.tools.function_test.integrity import SUMMARY, pooled
from swath.tools.function_test.journal import Result
from swath.tools.function_test.margin import is_kept_or_not, margin, margin_of
from swath.tools.function_test.steering_accuracy import SUMMARY as STEERING
from swath.tools.function_test.steering_accuracy import pooled as pooled_classes
from swath.tools.function_test.verdict import BROKEN, NOT_SHOWN, SHOWN, describe, verdict

STEERING_TAG = "steering"  # of cases that stand in the table of steering accuracy
OPEN = "open"  # verdict of a run that no limit of its case judges
EXIT = {SHOWN: 0, BROKEN: 1, NOT_SHOWN: 3}


@dataclass
class Cell:
    """The runs of a case with a candidate. planned: how many there are to be; text: what the rate of passes
    shows; means: what is said of each bounded mean; surprises: runs that passed at points of known failures
    """

    case: Case
    candidate: str
    planned: int
    runs: list[Result] = field(default_factory=list)
    verdict: str = NOT_SHOWN
    text: str = ""
    means: list[str] = field(default_factory=list)
    integrity: dict[str, Any] = field(default_factory=lambda: pooled(()))
    steering: dict[str, tuple[int, dict[str, Any]]] = field(default_factory=dict)
    _limits: dict[str, Any] = field(default_factory=dict)

    def add(self, result: Result) -> None:
        """Take in a run: of its metrics and limits what is asked for later, so that many runs fit."""
        if told := result.get(SUMMARY):
            self.integrity = pooled((self.integrity, told))
        if STEERING_TAG in self.case.file.tags and (classes := result.get(STEERING)):
            point = ", ".join(f"{name} {value}" for name, value in result["point"].items())
            count, before = self.steering.get(point, (0, pooled_classes(())))
            self.steering[point] = count + 1, pooled_classes((before, classes))
        kept = {name: result[name] for name in ("id", "point", "seed", "verdict", "reason")}
        metrics = {name: result["metrics"].get(name) for name in self.case.file.mean}
        entries = [
            {**{k: entry.get(k) for k in ("subject", "name", "value", "result")},
             "limit": self._limits.setdefault(json.dumps(entry["limit"]), entry["limit"])}
            for entry in result["expect"]
        ]  # fmt: skip
        self.runs.append({**kept, "metrics": metrics, "expect": entries})

    @property
    def counted(self) -> list[Result]:
        """Runs that count for the rate: not those at points where a failure is known, nor unjudged ones."""
        return [r for r in self.runs if r["verdict"] != OPEN and not self.case.known(r["point"])]

    @property
    def failed(self) -> list[Result]:
        """Runs that count and did not pass, in the order of the plan."""
        return [run for run in self.counted if run["verdict"] != "pass"]

    @property
    def surprises(self) -> list[Result]:
        """Runs that passed where a failure is known: the list of known failures is out of date."""
        return [run for run in self.runs if self.case.known(run["point"]) and run["verdict"] == "pass"]

    @property
    def worst(self) -> Result | None:
        """The run farthest beyond a limit, or nearest to one; an error before all others."""
        return max(self.runs, key=lambda run: -margin(run), default=None)

    @property
    def nearest(self) -> list[tuple[str, float, dict[str, Any]]]:
        """Of each limit the run nearest to it or farthest beyond it, as name, margin and entry; least first.

        Limits that can only be kept or not are left out where they are kept.
        """
        found: dict[str, tuple[float, dict[str, Any]]] = {}
        for run in self.runs:
            for entry in run["expect"]:
                name, share = f"{entry['subject']}.{entry['name']}", margin_of(entry)
                if name not in found or share < found[name][0]:
                    found[name] = share, entry
        rows = [(name, share, entry) for name, (share, entry) in found.items() if not _is_kept(entry)]
        return sorted(rows, key=lambda row: row[1])

    def judge(self) -> None:
        """Work out the verdict from the runs."""
        claim, counted = self.case.file.claim, self.counted
        passed = sum(run["verdict"] == "pass" for run in counted)
        is_complete = len(self.runs) >= self.planned
        self.verdict = verdict(
            passed, len(counted), claim.pass_rate, claim.confidence, is_complete=is_complete
        )
        self.text = describe(passed, len(counted), claim.pass_rate, claim.confidence, self.verdict)
        for name, bounds in self.case.file.mean.items():
            values = [run["metrics"].get(name) for run in counted]
            outcome, text = _mean(name, values, bounds)
            self.means.append(text)
            self.verdict = max(self.verdict, outcome, key=(SHOWN, NOT_SHOWN, BROKEN).index)


def cells_of(cases: Sequence[Case], candidates: Iterable[str], planned: dict[tuple[str, str], int],
             results: Iterable[Result]) -> list[Cell]:  # fmt: skip
    """Judged cells by case and candidate. planned: how many runs each is to have"""
    names = list(candidates)
    cells = {(c.name, name): Cell(c, name, planned.get((c.name, name), 0)) for c in cases for name in names}
    for result in results:
        cells[result["case"], result["candidate"]].add(result)
    for cell in cells.values():
        cell.judge()
    return list(cells.values())


def judged_again(result: Result, case: Case) -> Result:
    """The result against the present limits of its case on whole runs; others as they were judged."""
    entries = []
    for entry in result["expect"]:
        limit = _present(case, entry)
        if limit is None:
            entries.append(entry)
            continue
        value, reason = check_metric(limit, entry["value"])
        plain = {k: v for k, v in limit.plain().items() if k not in limit.window}
        kept = {k: v for k, v in entry.items() if k not in ("limit", "result", "reason", "value")}
        entries.append({**kept, "limit": plain, "value": value, "result": "fail" if reason else "pass",
                        **({"reason": reason} if reason else {})})  # fmt: skip
    broken = [e for e in entries if e["result"] == "fail"]
    if result["verdict"] == "error":
        return result
    reason = f"{broken[0]['subject']}.{broken[0]['name']}: {broken[0]['reason']}" if broken else ""
    return {**result, "expect": entries, "verdict": "fail" if broken else "pass", "reason": reason}


def in_shadow(result: Result, names: Iterable[str]) -> Iterator[Result]:
    """The results of the candidates that went along with a run in shadow, judged by the limits on what they
    have: metrics of the edge. `open` where there is no such limit.
    """
    for name in names:
        told = result.get("shadow", {}).get(name, {"metrics": {}, "digest": ""})
        entries = []
        for entry in result["expect"]:
            if entry["name"] in told["metrics"] and "window" not in entry and "hold" not in entry["limit"]:
                value, reason = check_metric(
                    Limit.model_validate(entry["limit"]), told["metrics"][entry["name"]]
                )
                said = {"reason": reason} if reason else {}
                kept = {k: entry[k] for k in ("subject", "name", "limit")}
                entries.append({**kept, "value": value, "result": "fail" if reason else "pass", **said})
        broken = [e for e in entries if e["result"] == "fail"]
        verdict = "fail" if broken else "pass" if entries else OPEN
        yield {
            **result,
            "id": f"{result['id']}-{name}",
            "candidate": name,
            "verdict": "error" if result["verdict"] == "error" else verdict,
            "reason": f"{broken[0]['name']}: {broken[0]['reason']}" if broken else "",
            "expect": entries,
            "incidents": [],
            STEERING: None,
            **told,
        }


def _is_kept(entry: dict[str, Any]) -> bool:
    return entry["result"] != "fail" and is_kept_or_not(entry)


def _present(case: Case, entry: dict[str, Any]) -> Limit | None:
    """The limit on a metric of the whole run that a case has now; None where it is of another kind."""
    expect = case.file.expect
    at = expect.get(entry["subject"], expect)
    found = at.get(entry["name"], expect.get(entry["name"])) if isinstance(at, dict) else None
    if not isinstance(found, dict) or "window" in entry or "hold" in entry["limit"]:
        return None
    limit = Limit.model_validate(found)
    return None if limit.window or limit.hold is not None else limit


def _mean(name: str, values: Sequence[float | None], bounds: Any) -> tuple[str, str]:
    """Verdict on a mean with its interval of 95 % (Student), and the text that says so."""
    good = [v for v in values if v is not None]
    if len(good) < max(2, len(values)):
        return (
            BROKEN if len(good) < len(values) else NOT_SHOWN
        ), f"{name}: {len(good)} of {len(values)} runs have it"
    from scipy import stats

    mean = sum(good) / len(good)
    spread = sqrt(sum((v - mean) ** 2 for v in good) / (len(good) - 1) / len(good))
    half = float(stats.t.ppf(0.975, len(good) - 1)) * spread
    low, high = mean - half, mean + half
    inside = (bounds.max is None or high <= bounds.max) and (bounds.min is None or low >= bounds.min)
    outside = (bounds.max is not None and low > bounds.max) or (bounds.min is not None and high < bounds.min)
    text = f"{name}: mean {mean:.4g} ({low:.4g} to {high:.4g})"
    return (SHOWN if inside else BROKEN if outside else NOT_SHOWN), text
