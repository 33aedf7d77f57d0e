"""`swath schema`: JSON Schema of scenario files, for editors."""

import argparse
from pathlib import Path
from typing import Any


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("schema", help="JSON Schema of scenario files, for editors")
    parser.add_argument("--out", type=Path, metavar="F", help="file to write (default: print it)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print or write it."""
    if args.out is None:
        print(schema_text(), end="")
    else:
        args.out.parent.mkdir(parents=True, exist_ok=True)
        write_schema(args.out)
    return 0


def write_schema(path: Path) -> None:
    """Write the JSON Schema of scenario files."""
    path.write_text(schema_text(), encoding="utf-8")


def schema_text() -> str:
    """The JSON Schema of scenario files."""
    import json

    from swath.scenario.schema import scenario_schema

    return json.dumps(scenario_schema(), indent=1) + "\n"
