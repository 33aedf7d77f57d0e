"""`swath diff`: what differs between two runs."""

import argparse
from pathlib import Path
from typing import Any

from swath.terminal.options import option, verb

PLACE = "look", 2  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "diff", "what differs between two runs, as text and page", run, _DESCRIPTION)
    option(parser, "first RUN", "a run folder", type=Path)
    option(parser, "second RUN", "another run folder", type=Path)
    option(parser, "--out FILE", "the page (default: diff.html in the second)", type=Path)


def run(args: argparse.Namespace) -> int:
    """Print the differences and where the page is. Exit code 0, whatever they are."""
    from swath.terminal.tables import table
    from swath.tools.diff.compare import compare, write_diff

    found = compare(args.first, args.second)
    names = (found.first.label, found.second.label)
    print(found.headline)
    if found.settings:
        table("", ("scenario", *names), found.settings)
    if found.differences:
        head = ("slot", "differs from [s]", "in", *names)
        table("", head, found.difference_rows())
    if found.metrics:
        table("", ("metric", *names, "difference"), found.metrics)
    for label, text in found.events:
        print(f"event   {label}: {text}")
    page = args.out or args.second / "diff.html"
    print(f"page    {write_diff(found, page)}")
    return 0


_DESCRIPTION = """Compare two runs: scenario, exact samples, metrics, events, tracks over the distance driven.
Prints where they first differ and writes one page with both."""
