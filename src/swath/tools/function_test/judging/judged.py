"""What a run comes to by its limits; stored results judged once more: against the limits that a case has now,
and of candidates in shadow.

A limit that rests on a level outside the range in which it was checked says nothing, kept or broken, nor does
one of which so short a run measured nothing. A run is `not judged` where there is such a limit and no other
one fails, and one that came to an error is judged by nothing.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from swath.judge.limits import check_metric
from swath.runtime.credibility import SUMMARY as CREDIBILITY
from swath.runtime.credibility import why_outside
from swath.scenario.sections import Limit
from swath.terminal.outcome import NOT_JUDGED, result_of
from swath.tools.function_test.case import Case
from swath.tools.function_test.judging.steering_accuracy import SUMMARY as STEERING
from swath.tools.function_test.stored_line import Result

OPEN = "open"  # verdict of a run that no limit of its case judges
UNJUDGED = NOT_JUDGED  # of one with limits that rest on a level outside its range, or on nothing measured
BEYOND = "a level was outside the range in which it was checked"
ERROR = "error"  # of one that could not be made, or crashed
UNCOUNTED = (OPEN, UNJUDGED, ERROR)


def verdict_of(entries: Sequence[Mapping[str, Any]], outside: Mapping[str, Any]) -> tuple[str, str]:
    """Verdict and reason of a run by its limits. outside: by slot, as `outside_of` gives it."""
    for result, verdict in (("fail", "fail"), ("not measured", UNJUDGED)):
        if of := next((e for e in entries if result_of(e) == result), None):
            return verdict, f"{of['subject']}.{of['name']}: {of.get('reason', '')}"
    if slots := _rested_on(entries):
        whys = (f"{slot} {why_outside(outside[slot])}" for slot in slots)
        return UNJUDGED, f"{UNJUDGED}: {'; '.join(whys)}"
    return "pass", ""


def why_unjudged(result: Result) -> str:
    """Why a result says neither that its limits are kept nor that one is broken."""
    if result["verdict"] == UNJUDGED and result["reason"].startswith(UNJUDGED):
        return BEYOND
    return "no limit is on what it did" if result["verdict"] == OPEN else "a limit was not measured"


def unjudged_lines(results: Iterable[Result]) -> list[str]:
    """How many results that came to no error are not judged, and why."""
    whys = Counter(why_unjudged(result) for result in results if result["verdict"] != ERROR)
    return [f"{count} runs not judged: {why}" for why, count in whys.items()]


def beyond(result: Result) -> list[tuple[str, str, Sequence[float]]]:
    """Of a result what is outside a checked range and keeps a limit from being judged: slot, quantity, and
    what was met of it.
    """
    credibility = result.get(CREDIBILITY, {})
    return [
        (slot, q["quantity"], q["met"])
        for slot in _rested_on(result["expect"])
        for q in credibility[slot]["quantities"]
    ]


def _rested_on(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """Slots outside their range on which limits rest."""
    return list(dict.fromkeys(slot for entry in entries for slot in entry.get("rests_outside", ())))


class PresentLimits:
    """The limits on metrics of the whole run that a case has now."""

    def __init__(self, case: Case) -> None:
        self._expect = case.file.expect
        self._found: dict[tuple[str, str], Limit | None] = {}

    def judge(self, result: Result) -> Result:
        """A result against them; what is limited in windows or at every moment stays as it was judged."""
        if result["verdict"] in (ERROR, OPEN):
            return result
        entries = [self._judged(entry) for entry in result["expect"]]
        verdict, reason = verdict_of(entries, result.get(CREDIBILITY, {}))
        return {**result, "expect": entries, "verdict": verdict, "reason": reason}

    def _judged(self, entry: dict[str, Any]) -> dict[str, Any]:
        limit = None if "window" in entry or "hold" in entry["limit"] else self._limit_of(entry)
        if limit is None:
            return entry
        kept = {k: v for k, v in entry.items() if k not in ("result", "reason")}
        return {**kept, "limit": limit.rule, **_checked(limit, entry["value"])}

    def _limit_of(self, entry: dict[str, Any]) -> Limit | None:
        """The limit on a metric of the whole run; None where it is of another kind."""
        place = entry["subject"], entry["name"]
        if place not in self._found:
            at = self._expect.get(entry["subject"], self._expect)
            found = at.get(entry["name"], self._expect.get(entry["name"])) if isinstance(at, dict) else None
            limit = Limit.model_validate(found) if isinstance(found, dict) else None
            is_other = limit is not None and (limit.window or limit.hold is not None)
            self._found[place] = None if is_other else limit
        return self._found[place]


def _checked(limit: Limit, value: Any) -> dict[str, Any]:
    """What the entry of a limit says of the value of a metric."""
    found, reason = check_metric(limit, value)
    return {"value": found, "result": "fail" if reason else "pass", **({"reason": reason} if reason else {})}


def in_shadow(result: Result, names: Iterable[str]) -> Iterator[Result]:
    """The results of the candidates that went along with a run in shadow, judged by the limits on what they.

    have: metrics of the edge. `open` where there is no such limit.
    """
    for name in names:
        of_candidate = result.get("shadow", {}).get(name, {"metrics": {}, "digest": ""})
        entries = []
        for entry in result["expect"]:
            if (
                entry["name"] in of_candidate["metrics"]
                and "window" not in entry
                and "hold" not in entry["limit"]
            ):
                kept = {k: entry[k] for k in ("subject", "name", "limit", "rests_outside") if k in entry}
                limit = Limit.model_validate(entry["limit"])
                entries.append({**kept, **_checked(limit, of_candidate["metrics"][entry["name"]])})
        verdict, reason = verdict_of(entries, result.get(CREDIBILITY, {})) if entries else (OPEN, "")
        yield {
            **result,
            "id": f"{result['id']}-{name}",
            "candidate": name,
            "verdict": ERROR if result["verdict"] == ERROR else verdict,
            "reason": reason,
            "expect": entries,
            "incidents": [],
            STEERING: None,
            **of_candidate,
        }
