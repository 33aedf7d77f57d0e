"""`swath metrics`: every metric of a run, with unit and meaning."""

import argparse
from typing import Any

from swath.terminal.options import option, verb
from swath.terminal.tables import add_json, as_json, say, table

PLACE = "start", 4  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "metrics", "list the metrics that limits can be set on, or explain one", run)
    option(parser, "name NAME", "only this metric", nargs="?")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Print the metrics, the columns and the events."""
    from swath.core.errors import InputError
    from swath.documents.validation import unknown_key
    from swath.scenario.slots import CATALOGUE

    judged = CATALOGUE.judged()
    metrics = judged.metrics
    if args.name is not None and args.name not in metrics:
        raise InputError(
            "metric", args.name, unknown_key(args.name, metrics, "unknown metric", "swath metrics")
        )
    rows = [
        (m.group, name, m.unit or "-", scope, m.better, m.meaning)
        for scope, group in judged.by_scope().items()
        for name, m in group.items()
        if args.name in (None, name)
    ]
    if args.json:
        as_json(("group", "name", "unit", "of", "better", "meaning"), rows)
        return 0
    for title in dict.fromkeys(row[0] for row in rows):
        shown = [row[1:] for row in rows if row[0] == title]
        table(title, ("metric", "unit", "of", "better", "meaning"), shown)
    if args.name is None:
        say(f"columns of the tracks, for limits on samples: {', '.join(judged.columns)}")
        say(f"events, for windows: {', '.join(judged.events)}")
        print("Your own: `evaluators: [file.py:Class]` in a scenario.")
    return 0
