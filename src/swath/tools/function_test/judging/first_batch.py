"""What the first runs of a batch show to tell nothing, named before more is spent.

A limit that every run breaks tells no run from another, nor does one that none measures, a number that never
changes, or a change after which every signal of every run is as before. All that rests on them, be it the
margin, a share, a probability or what is tuned, then says nothing.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from swath.core.number_text import num
from swath.report.html import Banner
from swath.terminal.outcome import NOT_JUDGED, limit_text, result_of, window_text
from swath.tools.function_test.judging.judged import ERROR
from swath.tools.function_test.judging.margin import MARGIN, judged_margin
from swath.tools.function_test.stored_line import Result

FEWEST = 2  # runs of which something is said to be alike in all
FIRST = 4  # runs of each case with each candidate that come first, where a plan has no rounds of its own
SAYS = {"fail": "break", "not measured": "do not measure", NOT_JUDGED: "are outside the range to judge"}
Value = Callable[[Result, str], Any]  # of a run: a number or several, None or nan where it has none


def metric_of(result: Result, name: str) -> Any:
    """A metric of a run, or its margin to all limits."""
    return judged_margin(result, "") if name == MARGIN else result["metrics"].get(name)


def telling_nothing(
    results: Sequence[Result],
    metrics: Iterable[str] = (),
    changed: Mapping[str, Iterable[str]] | None = None,
    value_of: Value = metric_of,
) -> dict[str, str]:
    """What tells nothing in runs, each with a line that says so.

    Parameters
    ----------
    results : of the first batch; those that came to an error are left out.
    metrics : that are asked for.
    changed : by what is changed, in words, the candidates that change it and nothing else; the candidate of
        the first result is what they are held against.
    value_of : gives a metric of a run.
    """
    there = [result for result in results if result["verdict"] != ERROR]
    found = _limits(there) if len(there) >= FEWEST else {}
    candidates = {result["candidate"] for result in there}
    for name in metrics if len(there) >= FEWEST else ():
        values = [_comparable(value_of(result, name)) for result in there]
        by_place: dict[Any, set[Any]] = {}
        for result, value in zip(there, values, strict=True):
            by_place.setdefault(_place(result), set()).add(value)
        if len(set(values)) == 1:
            said = f"is {_said(values[0])} in" if values[0] is not None else "has no value in any of"
            found[name] = f"{name} {said} all {len(there)} runs"
        elif len(candidates) > 1 and all(len(some) == 1 for some in by_place.values()):
            found[name] = f"{name} is changed by none of {len(candidates)} candidates in {len(there)} runs"
    first = results[0]["candidate"] if results else ""
    base = {_place(result): result["digest"] for result in there if result["candidate"] == first}
    for what, names in (changed or {}).items():
        mine = [r for r in there if r["candidate"] in set(names) and r["candidate"] != first]
        pairs = [(base[_place(r)], r["digest"]) for r in mine if base.get(_place(r))]
        if pairs and all(a == b for a, b in pairs):
            found[what] = f"{what} changes none of {len(pairs)} runs: all bytes are as without it"
    return found


def margin_telling_nothing(results: Sequence[Result], limit: str = "") -> dict[str, str]:
    """The same of runs that are judged by their margin to a limit, or to all of them."""
    return telling_nothing(results, [MARGIN], value_of=lambda result, _: judged_margin(result, limit))


def name_first(known: dict[str, str], found: Mapping[str, str]) -> None:
    """Print what was not known, and know it."""
    for what, line in found.items():
        if what not in known:
            known[what] = line
            print(f"note    {line}")


def banners(found: Mapping[str, str]) -> list[Banner]:
    """The same for the top of a page."""
    return [Banner(f"The first runs: {line}.") for line in found.values()]


def _limits(results: Sequence[Result]) -> dict[str, str]:
    """Limits that every run breaks, or of which none says anything: over all cases, else in one."""
    outcomes: dict[tuple[str, ...], dict[str, list[str]]] = {}
    entries: dict[tuple[str, ...], Mapping[str, Any]] = {}
    for result in results:
        for entry in result["expect"]:
            key = f"{entry['subject']}.{entry['name']}{window_text(entry)}", *sorted(entry["limit"])
            outcomes.setdefault(key, {}).setdefault(result["case"], []).append(result_of(entry))
            entries[key] = entry
    found = {}
    for key, by_case in outcomes.items():
        whole = [one for some in by_case.values() for one in some]
        alike = {"": whole} if len(set(whole)) == 1 else by_case
        for case, some in alike.items():
            if len(some) >= FEWEST and len(set(some)) == 1 and some[0] in SAYS:
                of, limit = f" of {case}" if case else "", f"{key[0]} ({limit_text(entries[key])})"
                found[f"{limit}{of}"] = f"all {len(some)} runs{of} {SAYS[some[0]]} {limit}"
    return found


def _place(result: Result) -> tuple[Any, ...]:
    return result["case"], result["seed"], *sorted(result["point"].items())


def _comparable(value: Any) -> Any:
    """A value such that equal ones are equal: None for nan, and several as a tuple."""
    if value is None:
        return None
    some = tuple(value) if hasattr(value, "__len__") else (value,)
    return None if any(v != v for v in some) else some


def _said(values: tuple[float, ...]) -> str:
    return ", ".join(num(value) for value in values)
