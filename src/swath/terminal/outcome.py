"""The outcome of a run on stdout: metrics, limits, incidents."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from shlex import quote
from typing import Any

from swath.core.number_text import num
from swath.terminal.tables import table

NOT_JUDGED = "not judged"
ORDER = {"fail": 0, NOT_JUDGED: 1, "not measured": 2}  # in the table: these first, the others as they come
COLUMNS = ("name", "value", "unit", "limit", "result")
OF_THE_RUN = ("real_time_factor", "ray_count")


def print_outcome(summary: Mapping[str, Any], out: Path, evaluators: Sequence[str] = ()) -> None:
    """Print the metrics of a run, its limits, what happened and where the report is.

    evaluators: of the scenario's own
    """
    from swath.scenario.slots import CATALOGUE

    known = CATALOGUE.judged(evaluators).metrics
    machines, credibility = summary.get("machines", {}), summary.get("credibility", {})
    for name, metrics in machines.items():
        own = [e for e in summary["expect"] if e["subject"] == name]
        table(name, COLUMNS, _rows(known, metrics, own, credibility))
    rest = [e for e in summary.get("expect", []) if e["subject"] not in machines]
    table("field and run" if machines else "", COLUMNS, _rows(known, summary, rest, credibility))
    if summary.get("incomplete"):
        print("incomplete: the run was stopped before its end")
    for entry in summary.get("expect", []):
        if result_of(entry) == "fail":
            print(f"fail    {entry['subject']}.{entry['name']}{window_text(entry)}: {entry['reason']}")
    for entry in summary.get("expect", []):
        if result_of(entry) == "not measured":
            name = f"{entry['subject']}.{entry['name']}{window_text(entry)}"
            print(f"open    {name}: not measured in so short a run, neither kept nor broken")
    for event in summary.get("incidents", []):
        print(f"event   {incident_text(event)}")
    for note in summary.get("notes", []):
        print(f"note    {note}")
    if events := summary.get("events"):
        print(f"events  {len(events)}, listed in summary.json; repeat them with --events {quote(str(out))}")
    print(f"digest  {summary.get('digest', '-')}")
    for page in ("report", "replay"):
        if os.path.isfile(out / f"{page}.html"):
            print(f"{page}  {out / page}.html")
    size = sum(file.stat().st_size for file in out.rglob("*") if os.path.isfile(file))
    took = ""
    if "wall_s" in summary:
        took = f"{num(summary['simulated_s'], 's')} driven in {num(summary['wall_s'], 's')}, "
    print(f"folder  {out}: {took}{num(size / 1e6, 'MB')}")


def tell(result: Any, out: Path, *, quiet: bool, evaluators: Sequence[str] = ()) -> int:
    """Print the outcome of a run, or its folder alone; returns its exit code."""
    print(out) if quiet else print_outcome(result.summary, out, evaluators)
    return int(result.exit_code)


def result_of(entry: Mapping[str, Any]) -> str:
    """`pass`, `fail` or `not measured`; `not judged` where a limit rests on a level outside its range."""
    return NOT_JUDGED if entry.get("rests_outside") else str(entry["result"])


def exit_code(results: Iterable[str]) -> int:
    """Of whatever was judged: 0 where all pass or are shown, 1 where one fails or is broken, else 3: nothing
    judged, measured or shown is not a pass.
    """
    found = set(results)
    return 1 if found & {"fail", "broken"} else 0 if found <= {"pass", "shown"} else 3


def limit_text(entry: Mapping[str, Any], say: Callable[[Any], str] = num) -> str:
    """The bounds of a limit, with `hold` and `while`. say: how a bound is written."""
    limit = entry["limit"]
    bounds = ", ".join(f"{key} {say(limit[key])}" for key in ("min", "max") if key in limit)
    hold = f" {limit['hold']}" if "hold" in limit else ""
    hold += f" because of {limit['because']}" if "because" in limit else ""
    whiles = (
        f"{column} {' '.join(f'{k} {num(v)}' for k, v in bound.items() if v is not None)}"
        for column, bound in limit.get("while", {}).items()
    )
    return bounds + hold + "".join(f" while {text}" for text in whiles)


def value_text(value: Any, entry: Mapping[str, Any] | None = None, unit: str = "") -> str:
    """A value, with as many digits as tell it from the bounds of its limit."""
    limit = {} if entry is None else entry["limit"]
    return num(value, unit, beside=[limit[key] for key in ("min", "max") if key in limit])


def window_text(entry: Mapping[str, Any]) -> str:
    """The window of a limit, empty where it has none."""
    window = entry.get("window", {})
    return " " + ", ".join(f"{key} {num(value)}" for key, value in window.items()) if window else ""


def incident_text(event: Mapping[str, Any]) -> str:
    """An incident in one line."""
    x, y, way = (num(event[key], places=1) for key in ("x_m", "y_m", "distance_m"))
    place = f"{num(event['t_s'], 's', places=2)}, {way} m ({x}, {y})"
    ended = event.get("end_t_s", event["t_s"])
    lasting = ", lasts to the end" if ended is None else ""
    if ended is not None and ended > event["t_s"]:
        lasting = f", lasts {num(ended - event['t_s'], 's')}"
    return f"{place}: {event['machine']} {event['kind']}: {event['text']}{lasting}"


def _rows(
    known: Mapping[str, Any], metrics: Mapping[str, Any], expect: list[Any], credibility: Mapping[str, Any]
) -> list[tuple[str, ...]]:
    """A row for every metric that says something and every limit; what does not pass first.

    What is limited in a window is another quantity than over the whole run: its name has the window. A 0 that
    is as good as it gets, and numbers of the run itself, are left to the page.

    Parameters
    ----------
    known : metrics by name.
    metrics, expect : values and limits of a machine or of the field.
    credibility : `credibility` of the summary; what a level was given is no result.
    """
    rows = []
    errors, given = credibility.get("level_errors", {}), credibility.get("given", ())
    for name in dict.fromkeys([*known, *(e["name"] for e in expect)]):
        own = [e for e in expect if e["name"] == name]
        metric = known.get(name)
        unit = "" if metric is None or metric.unit == "1" else metric.unit
        off = f" ± {num(errors[name])}" if name in errors else ""
        value = metrics.get(name)
        is_telling = value or (metric is not None and metric.better == "higher")
        if name in metrics and (own or (is_telling and name not in (*given, *OF_THE_RUN))):
            held = next((e for e in own if not e.get("window") and "hold" not in e["limit"]), None)
            limit, said = ("", "") if held is None else (limit_text(held), result_of(held))
            rows.append((name, value_text(value, held) + off, unit, limit, said))
            own = [e for e in own if e is not held]
        rows += [
            (name + window_text(e), value_text(e["value"], e) + off, unit, limit_text(e), result_of(e))
            for e in own
        ]
    return sorted(rows, key=lambda row: ORDER.get(row[-1], len(ORDER)))
