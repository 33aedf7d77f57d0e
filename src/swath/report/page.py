"""What a run's report page says of its summary."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from swath.core.number_text import num, percent_of, span
from swath.documents.data_sheets import TAGS
from swath.judge.catalogue import EvaluatorCatalogue, load_evaluators
from swath.judge.evaluator import Metric
from swath.report.html import (
    Banner,
    Beside,
    Facts,
    Figure,
    Fold,
    Html,
    Items,
    Section,
    Table,
    bar,
    element,
    escaped,
    joined,
    render_page,
    verdict,
)
from swath.scenario.scenario import changes_in
from swath.terminal.outcome import NOT_JUDGED, incident_text, limit_text, result_of, value_text, window_text

INCIDENTS = ("time [s]", "distance [m]", "x [m]", "y [m]", "machine", "what", "")
CREDIBILITY = ("slot", "quantity", "", "met", "checked", "level", "by")
LISTS = {"not_checked": "not checked, of what changes what it does", "estimates": "rests on"}
INPUTS = ("machine", "metrics", "numbers of data sheets, where they come from", "% of a metric for 1 % of")
COST = ("slot", "steps", "per step", "wall time", "share", "of real time", "")
ABOUT_INPUTS = (
    "Where numbers come from: {}; that does not say how far they may be off. How much a metric changes for "
    "1 % of a number is that of the engine's steady state where the run ended; for losses and throughput it "
    "is not known."
)
ABOUT_SCENARIO = "Every value the run used; pale are the defaults, which the scenario does not write."
NOTHING = "Nothing was measured."
SHOW = "Show the resolved scenario"
FOOTER = (
    "Positive lateral and edge errors point towards the standing crop. `swath metrics NAME` explains a "
    "metric."
)
RUN = (
    Metric("simulated_s", "s", "simulated time", "Run", label="simulated time"),
    Metric("wall_s", "s", "wall time", "Run", label="wall time"),
)


def render(
    summary: Mapping[str, Any],
    scenario: str,
    figures: Sequence[Figure],
    default_lines: Collection[int] = (),
    known: EvaluatorCatalogue | None = None,
    sent: Sequence[Fold] = (),
) -> str:
    """The whole page.

    default_lines: numbers, from 1, of the lines of the scenario to show as defaults; known: the evaluators of
    the run, the built-in ones by default; sent: what the slots of each machine sent
    """
    expect = summary.get("expect") or []
    evaluators = known or load_evaluators()
    incidents = [_incident_row(event) for event in summary.get("incidents", [])]
    made_with = {**(summary.get("versions") or {}), "rays on": summary.get("device")}
    digest = summary.get("digest")
    name = str(summary.get("name", "run"))
    return render_page(
        [
            *figures[:1],
            Section("Limits", [_limits([limit_row(entry, evaluators.metrics) for entry in expect])]),
            *figures[1:],
            *_results(summary, evaluators),
            Table("Incidents", INCIDENTS, incidents, range(4)),
            Section("Notes", [Items(summary.get("notes", []))]),
            Section("Credibility", _credibility(summary)),
            Table(
                "What load, fuel, loss and throughput rest on",
                INPUTS,
                list(_inputs(summary)),
                text=ABOUT_INPUTS.format("; ".join(TAGS.values())),
            ),
            Section("All that was sent", sent),
            Table("Cost", COST, _cost(summary), range(1, 6)),
            Section("Made with", [Facts(made_with), f"`digest {digest}`" if digest else ""]),
            Section("Scenario as run", [ABOUT_SCENARIO, Fold(SHOW, [_lines(scenario, default_lines)])]),
        ],
        heading=name,
        title=says if changes_in(name, says := str(summary.get("summary") or "")) else name,
        lead=says,
        verdict=_head(expect),
        top=[
            Banner("**Incomplete.** The run was stopped before its end.")
            if summary.get("incomplete")
            else "",
            Facts({key: summary.get(key) for key in ("machine", "seed")}),
        ],
        footer=FOOTER,
    )


def _lines(scenario: str, default_lines: Collection[int]) -> Html:
    """The scenario, its defaults pale."""
    lines = [
        element("i", line) if n in default_lines else escaped(line)
        for n, line in enumerate(scenario.splitlines(), 1)
    ]
    return element("pre", joined(lines, "\n"))


def _limits(rows: Sequence[Mapping[str, str]]) -> Table:
    """The table of limits, without columns that are empty in every row."""
    heads = {
        "subject": "of", "name": "metric or column", "value": "value", "result": "", "limit": "limit",
        "window": "window", "error": "level may be off by", "reason": "",
    }  # fmt: skip
    shown = [key for key in heads if key not in ("window", "error", "reason") or any(r[key] for r in rows)]
    put: dict[str, Callable[[str], Html]] = {
        "result": verdict,
        "value": lambda v: element("span", v, class_="v"),
    }
    cells = [[put.get(key, escaped)(row[key]) for key in shown] for row in rows]
    return Table("", [heads[key] for key in shown], cells, [shown.index("value")])


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
    return "pass", f"✓ All {len(expect)} limits pass", ""


def limit_row(entry: Mapping[str, Any], metrics: Mapping[str, Metric]) -> dict[str, str]:
    """What the page says of a limit and of what came."""
    metric = metrics.get(entry["name"])  # None: a column of the tracks, whose name ends with its unit
    unit = "" if metric is None else metric.unit
    return {
        "subject": entry["subject"],
        "name": entry["name"],
        "limit": limit_text(entry, partial(num, unit=unit)),
        "window": window_text(entry),
        "value": value_text(entry["value"], entry, unit),
        "result": result_of(entry),
        "reason": entry.get("reason", ""),
        "error": _level_error(entry, metric),
    }


def _level_error(entry: Mapping[str, Any], metric: Metric | None) -> str:
    """How far off the value may be at the level that it rests on, "" where nothing measured it."""
    error = entry.get("level_error")
    if error is None or metric is None:
        return ""
    return f"{num(error['size'], metric.unit)} ({error['slot']} against {error['against']})"


def _credibility(summary: Mapping[str, Any]) -> list[Fold]:
    """What was met, against what each level was checked for, in a line that opens."""
    told = summary.get("credibility", {})
    rows = [
        [slot, row["quantity"], row["state"] or "not met", "-" if row["met"] is None else span(row["met"]),
         span(row["checked"]), of["level"], ", ".join(filter(None, (row["source"], row.get("witness"))))]
        for slot, of in told.get("slots", {}).items() for row in of["quantities"]
    ]  # fmt: skip
    text = "What the run met, against the range in which each level was checked."
    if told.get("undeclared"):
        text += f" No range is declared for the levels of {', '.join(told['undeclared'])}."
    tables = [
        Table("", ["slot", about], [[slot, ", ".join(names)] for slot, names in told[key].items()])
        for key, about in LISTS.items() if told.get(key)
    ]  # fmt: skip
    met = [row for row in rows if row[2] != "not met"]
    out = [row for row in met if row[2] != "inside"]
    line = f"{len(met) - len(out)} of {len(met)} quantities inside the range that levels were checked for"
    beyond = "; ".join(f"{row[1]} of {row[0]} {row[2]}" for row in out)
    parts = [Table("", CREDIBILITY, rows, (3, 4), text), *tables]
    return [Fold(f"{line}: {beyond}" if beyond else line, parts)]


def _inputs(summary: Mapping[str, Any]) -> Iterator[list[str]]:
    """Rows: machine, metrics with the same inputs, these inputs counted by tag, and the most influential."""
    alike: dict[tuple[str, str, str], list[str]] = {}
    for machine, metrics in summary.get("inputs", {}).items():
        for name, told in metrics.items():
            sources = [
                f"{source}: {', '.join(f'{n} {_origin(tag)}' for tag, n in tags.items() if n)}"
                for source, tags in told["numbers"].items()
            ]
            most = [
                f"{row['key']} {num(row['value'])} ({_origin(row['tag'])}): {num(row['percent_per_percent'])}"
                for row in told["matter_most"]
            ]
            alike.setdefault((machine, "; ".join(sources), "; ".join(most) or "–"), []).append(name)
    for (machine, numbers, matter), names in alike.items():
        yield [machine, ", ".join(names), numbers, matter]


def _origin(tag: str) -> str:
    """Where a number comes from, in a word or two."""
    return " or ".join(TAGS[each].split()[0].rstrip(",") for each in tag.split("/"))


def _incident_row(event: Mapping[str, Any]) -> list[str]:
    place = [num(event[key], places=1) for key in ("t_s", "distance_m", "x_m", "y_m")]
    text = incident_text(event).partition(f"{event['kind']}: ")[2]
    return [*place, event["machine"], event["kind"], text]


def _results(summary: Mapping[str, Any], known: EvaluatorCatalogue) -> Iterator[Section]:
    """Grouped metrics of each machine, then of the field and the run."""
    metrics = [*known.metrics.values(), *RUN]
    machines = summary.get("machines", {})
    for name, own in machines.items():
        yield Section(f"Results: {name}", _groups(own, metrics))
    yield Section("Results: field and run" if machines else "Results", _groups(summary, metrics))


def _groups(values: Mapping[str, Any], metrics: Sequence[Metric]) -> list[Beside | str]:
    groups: dict[str, list[list[Html]]] = {}
    for metric in metrics:
        if metric.name in values:
            groups.setdefault(metric.group, []).append(_metric_row(metric, values[metric.name]))
    tables = [Table(group, (), rows, (1,)) for group, rows in groups.items()]
    return [Beside(tables, "columns") if tables else NOTHING]


def _metric_row(metric: Metric, value: Any) -> list[Html]:
    label = metric.label or metric.name.removesuffix("_" + metric.unit).replace("_", " ")
    name = joined((label, element("small", metric.name, class_="id")))
    return [
        element("span", name, title=metric.meaning), element("span", num(value, metric.unit), class_="v")
    ]  # fmt: skip


def _cost(summary: Mapping[str, Any]) -> list[list[object]]:
    """Slot, steps, time of a step and of all, shares of all and of the simulated time, of the wall time."""
    cost: Mapping[str, Any] = summary.get("cost", {})
    spent = [c["seconds"] for c in cost.values()]
    total, longest = max(sum(spent), 1e-12), max(spent, default=0.0) or 1e-12
    simulated = summary.get("simulated_s")
    return [
        [
            slot,
            str(c["steps"]),
            num(1e6 * c["seconds"] / c["steps"] if c["steps"] else None, "µs"),
            num(c["seconds"], "s"),
            percent_of(c["seconds"] / total),
            percent_of(c["seconds"] / simulated if simulated else None),
            bar(c["seconds"] / longest, most=300.0),
        ]
        for slot, c in cost.items()
    ]
