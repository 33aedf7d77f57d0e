"""What a run's report page says: the summary as rows of text, for the template `run.html.j2`."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from swath.documents.data_sheets import TAGS
from swath.judge.catalogue import EvaluatorCatalogue, load_evaluators
from swath.judge.evaluator import Metric
from swath.report.html import Figure, render_page, signed
from swath.runtime.credibility import span
from swath.terminal.outcome import NOT_JUDGED, incident_text, limit_text, result_of, window_text
from swath.terminal.tables import number

FACTORS = {("m", "cm"): 100.0, ("1", "%"): 100.0}  # (unit, shown unit) -> factor
PRETTY = {"m2": "m²", "1": ""}
RUN = (
    Metric("simulated_s", "s", "simulated time", "Run", label="simulated time", decimals=1),
    Metric("wall_s", "s", "wall time", "Run", label="wall time", decimals=1),
)


def render(
    summary: Mapping[str, Any],
    scenario: str,
    figures: Sequence[Figure],
    default_lines: Collection[int] = (),
    known: EvaluatorCatalogue | None = None,
) -> str:
    """The whole page.

    default_lines: numbers, from 1, of the lines of the scenario to show as defaults; known: the evaluators of
    the run, the built-in ones by default
    """
    expect = summary.get("expect") or []
    evaluators = known or load_evaluators()
    return render_page(
        "run.html.j2",
        name=str(summary.get("name", "run")),
        about=str(summary.get("summary") or ""),
        head=_head(expect),
        incomplete=bool(summary.get("incomplete")),
        run_facts={key: summary.get(key) for key in ("machine", "seed")},
        made_with={**(summary.get("versions") or {}), "rays on": summary.get("device")},
        digest=summary.get("digest"),
        limits=[limit_row(entry, evaluators.metrics) for entry in expect],
        results=list(_results(summary, evaluators)),
        inputs=list(_inputs(summary)),
        credibility=list(_credibility(summary)),
        tags=TAGS,
        undeclared=summary.get("credibility", {}).get("undeclared", []),
        not_checked=[
            [slot, ", ".join(names)]
            for slot, names in summary.get("credibility", {}).get("not_checked", {}).items()
        ],
        notes=summary.get("notes", []),
        incidents=[_incident_row(event) for event in summary.get("incidents", [])],
        figures=figures,
        cost=_cost(summary) if summary.get("cost") else [],
        scenario=[(line, n in default_lines) for n, line in enumerate(scenario.splitlines(), 1)],
    )


def _head(expect: Sequence[Mapping[str, Any]]) -> tuple[str, str, str]:
    failed = [entry["name"] for entry in expect if result_of(entry) == "fail"]
    if not expect:
        return "none", "No limits set", "this scenario expects nothing"
    if failed:
        return "fail", f"✗ {len(failed)} of {len(expect)} limits fail", ", ".join(dict.fromkeys(failed))
    if doubtful := [entry["name"] for entry in expect if result_of(entry) == NOT_JUDGED]:
        what = f"{', '.join(dict.fromkeys(doubtful))}: a level was outside its range, see credibility"
        return "none", f"{len(doubtful)} of {len(expect)} limits not judged", what
    if open_ := [entry["name"] for entry in expect if result_of(entry) == "not measured"]:
        return "none", f"{len(open_)} of {len(expect)} limits not measured", ", ".join(dict.fromkeys(open_))
    return "pass", f"✓ All {len(expect)} limits pass", ", ".join(dict.fromkeys(e["name"] for e in expect))


def limit_row(entry: Mapping[str, Any], metrics: Mapping[str, Metric]) -> dict[str, str]:
    """What the page says of a limit and of what came."""
    metric = metrics.get(entry["name"])  # None: a column of the tracks, whose name ends with its unit
    return {
        "subject": entry["subject"],
        "name": entry["name"],
        "limit": limit_text(entry) if metric is None else _bounds(metric, entry["limit"]),
        "window": window_text(entry),
        "value": number(entry["value"]) if metric is None else shown_value(metric, entry["value"]),
        "result": result_of(entry),
        "reason": entry.get("reason", ""),
        "error": _level_error(entry, metric),
    }


def _level_error(entry: Mapping[str, Any], metric: Metric | None) -> str:
    """How far off the value may be at the level that it rests on, "" where nothing measured it."""
    error = entry.get("level_error")
    if error is None or metric is None:
        return ""
    return f"{shown_value(metric, error['size'])} ({error['slot']} against {error['against']})"


def _credibility(summary: Mapping[str, Any]) -> Iterator[list[str]]:
    """Slot, quantity, where what was met lies, that itself, what was checked, of which level, and by what."""
    for slot, told in summary.get("credibility", {}).get("slots", {}).items():
        for row in told["quantities"]:
            met = "–" if row["met"] is None else span(row["met"])
            state = row["state"] or "not met"
            yield [slot, row["quantity"], state, met, span(row["checked"]), told["level"], row["source"]]


def _inputs(summary: Mapping[str, Any]) -> Iterator[list[str]]:
    """Machine, metrics, numbers by tag of all that they rest on alike, and those that matter most."""
    alike: dict[tuple[str, str, str], list[str]] = {}
    for machine, metrics in summary.get("inputs", {}).items():
        for name, told in metrics.items():
            sources = [
                f"{source} {', '.join(f'{count} {tag}' for tag, count in tags.items() if count)}"
                for source, tags in told["numbers"].items()
            ]
            most = [
                f"{row['key']} {row['value']:g} ({row['tag']}): {row['percent_per_percent']:+g}"
                for row in told["matter_most"]
            ]
            alike.setdefault((machine, "; ".join(sources), "; ".join(most) or "–"), []).append(name)
    for (machine, numbers, matter), names in alike.items():
        yield [machine, ", ".join(names), numbers, matter]


def _incident_row(event: Mapping[str, Any]) -> list[str]:
    place = [f"{event[key]:.1f}" for key in ("t_s", "distance_m", "x_m", "y_m")]
    text = incident_text(event).partition(f"{event['kind']}: ")[2]
    return [*place, event["machine"], event["kind"], text]


def _results(
    summary: Mapping[str, Any], known: EvaluatorCatalogue
) -> Iterator[tuple[str, list[tuple[str, list[dict[str, str]]]]]]:
    """Heading and grouped metrics of each machine, then of the field and the run."""
    metrics = {**known.metrics, **{m.name: m for m in RUN}}
    expect = summary.get("expect") or []
    machines = summary.get("machines", {})
    for name, own in machines.items():
        yield name, _groups(own, metrics, [e for e in expect if e["subject"] == name])
    rest = [e for e in expect if e["subject"] not in machines]
    yield "field and run" if machines else "", _groups(summary, metrics, rest)


def _groups(
    values: Mapping[str, Any], metrics: Mapping[str, Metric], expect: Sequence[Mapping[str, Any]]
) -> list[tuple[str, list[dict[str, str]]]]:
    held = {e["name"]: e for e in expect if not e.get("window") and "hold" not in e["limit"]}
    groups: dict[str, list[dict[str, str]]] = {}
    for metric in metrics.values():
        if metric.name in values:
            row = _metric_row(metric, values[metric.name], held.get(metric.name))
            groups.setdefault(metric.group, []).append(row)
    return list(groups.items())


def _metric_row(metric: Metric, value: Any, entry: Mapping[str, Any] | None) -> dict[str, str]:
    return {
        "tip": metric.meaning,
        "name": metric.name,
        "label": metric.label or metric.name.removesuffix("_" + metric.unit).replace("_", " "),
        "value": shown_value(metric, value),
        "limit": "" if entry is None else _bounds(metric, entry["limit"]),
        "result": "" if entry is None else result_of(entry),
    }


def _bounds(metric: Metric, limit: Mapping[str, Any]) -> str:
    """The least and the greatest value that a limit on a metric allows."""
    signs = (("min", "≥"), ("max", "≤"))
    bounds = [f"{sign} {shown_value(metric, limit[key])}" for key, sign in signs if key in limit]
    return " ".join(bounds + ([f"because of {limit['because']}"] if "because" in limit else []))


def shown_value(metric: Metric, value: Any) -> str:
    """A value of a metric as a report shows it: its decimals, but four digits at most; counts are whole."""
    if value is None:
        return "–"
    unit = metric.shown or metric.unit
    scaled = float(value) * FACTORS.get((metric.unit, unit), 1.0)
    if metric.decimals < 0:
        text = f"{scaled:.1e}" if scaled else "0"
    else:
        whole = len(f"{abs(scaled):.0f}")
        decimals = min(metric.decimals, max(4 - whole, 0))
        if metric.decimals > 0 and whole > 4:
            scaled = round(scaled, 4 - whole)
        text = signed(scaled, decimals)
    unit = PRETTY.get(unit, unit)
    return f"{text}\u00a0{unit}" if unit else text


def _cost(summary: Mapping[str, Any]) -> list[tuple[list[str], str]]:
    """Cells, and the length of the bar [%], of the wall time per slot."""
    cost: Mapping[str, Any] = summary["cost"]
    total = max(sum(c["seconds"] for c in cost.values()), 1e-12)
    longest = max(max(c["seconds"] for c in cost.values()), 1e-12)
    simulated = summary.get("simulated_s")
    rows = []
    for slot, c in cost.items():
        each = 1e6 * c["seconds"] / c["steps"] if c["steps"] else 0.0
        cells = [slot, str(c["steps"]), f"{each:,.0f} µs".replace(",", "\u202f"), f"{c['seconds']:.2f} s"]
        cells.append(f"{100 * c['seconds'] / total:.1f} %")
        cells.append(f"{100 * c['seconds'] / simulated:.1f} %" if simulated else "–")
        rows.append((cells, f"{100 * c['seconds'] / longest:.1f}"))
    return rows
