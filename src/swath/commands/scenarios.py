"""`swath scenarios`: the bundled scenarios."""

import argparse
from typing import Any

from swath.terminal.options import option, verb
from swath.terminal.tables import add_json, as_json, say, table

PLACE = "start", 2  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "scenarios", "list the bundled scenarios; print one", run)
    option(parser, "name NAME", "print this scenario, to make your own of it", nargs="?")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Print a bundled scenario as it is, or name and summary of all."""
    from swath.documents.data_sheets import find_sheet, sheet_names
    from swath.documents.yaml_document import read_document

    if args.name is not None and args.json:
        import json

        print(json.dumps(read_document(find_sheet("scenarios", args.name)).data, indent=1))
        return 0
    if args.name is not None:
        print(find_sheet("scenarios", args.name).read_text(encoding="utf-8"), end="")
        return 0
    rows = []
    for name in sheet_names("scenarios"):
        data = read_document(find_sheet("scenarios", name)).data
        rows.append((name, data.get("summary", ""), list(data.get("expect", {}))))
    if args.json:
        as_json(("name", "summary", "limits_on"), rows)
        return 0
    table("", ("scenario", "what it is"), [row[:2] for row in rows])
    say("swath run NAME drives one; swath scenarios NAME prints it; whole fields: swath fleet list")
    return 0
