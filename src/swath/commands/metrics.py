"""`swath metrics`: every metric of a run, with unit and meaning."""

import argparse
from typing import Any


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("metrics", help="list the metrics that limits can be set on, or explain one")
    parser.add_argument("name", nargs="?", metavar="NAME", help="only this metric")
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
