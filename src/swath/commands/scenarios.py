"""`swath scenarios`: the bundled scenarios."""

import argparse
from typing import Any


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("scenarios", help="list the bundled scenarios")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print name and summary of every bundled scenario."""
    from swath.documents.data_sheets import find_sheet, sheet_names
    from swath.documents.yaml_document import read_document
    from swath.terminal.tables import table

    rows = []
    for name in sheet_names("scenarios"):
        data = read_document(find_sheet("scenarios", name)).data
        limits = ", ".join(data.get("expect", {}))
        rows.append((name, data.get("summary", ""), limits))
    table("", ("scenario", "what it is", "limits on"), rows)
    return 0
