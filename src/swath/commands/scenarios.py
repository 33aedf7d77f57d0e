"""`swath scenarios`: what is bundled."""

import argparse
from typing import Any


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("scenarios", help="list the bundled scenarios")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print name and summary of every bundled scenario."""
    from swath.commands.output import table
    from swath.data.cards import find_card
    from swath.sim.scenario import scenario_names
    from swath.sim.yamlfile import read_document

    rows = []
    for name in scenario_names():
        data = read_document(find_card("scenarios", name)).data
        limits = ", ".join(data.get("expect", {}))
        rows.append((name, data.get("summary", ""), limits))
    table("", ("scenario", "what it is", "limits on"), rows)
    return 0
