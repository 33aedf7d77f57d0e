"""`swath metrics`: every metric of a run, with unit and meaning."""

import argparse
from typing import Any


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("metrics", help="list the metrics that limits can be set on, or explain one")
    parser.add_argument("name", nargs="?", metavar="NAME", help="only this metric")
    parser.add_argument("--markdown", action="store_true", help="the tables of docs/metrics.md instead")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the metrics, the columns and the events."""
    from swath.core.errors import InputError
    from swath.documents.hints import unknown_key
    from swath.scenario.catalogue import CATALOGUE
    from swath.terminal.tables import table

    judged = CATALOGUE.judged()
    metrics = judged.metrics
    if args.name is not None and args.name not in metrics:
        raise InputError("metric", args.name, unknown_key(args.name, metrics, "unknown metric"))
    if args.markdown:
        print(markdown(judged), end="")
        return 0
    rows = [
        (name, m.unit or "-", m.group, scope, m.better, m.meaning)
        for scope, group in judged.by_scope().items()
        for name, m in group.items()
        if args.name in (None, name)
    ]
    table("", ("metric", "unit", "group", "of", "better", "meaning"), rows)
    if args.name is None:
        print(f"columns of the tracks, for limits on samples: {', '.join(judged.columns)}")
        print(f"events, for windows: {', '.join(judged.events)}")
        print("Your own: `evaluators: [file.py:Class]` in a scenario.")
    return 0


def markdown(judged: Any) -> str:
    """The generated part of docs/metrics.md."""
    groups: dict[str, list[str]] = {}
    for scope, metrics in judged.by_scope().items():
        for name, m in metrics.items():
            meaning = m.meaning.replace("|", "\\|")
            row = f"| `{name}` | {m.unit or '-'} | {scope} | {m.better or '-'} | {meaning} |"
            groups.setdefault(m.group, []).append(row)
    head = "| name | unit | of | better | meaning |\n|---|---|---|---|---|\n"
    tables = [f"### {group}\n{head}" + "\n".join(rows) + "\n" for group, rows in groups.items()]
    columns = ", ".join(f"`{c}`" for c in judged.columns)
    events = ", ".join(f"`{e}`" for e in judged.events)
    return "\n".join([*tables, f"Columns of the tracks: {columns}.\n", f"Events: {events}.\n"])
