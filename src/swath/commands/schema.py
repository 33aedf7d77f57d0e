"""`swath schema`: JSON Schema of scenario and job files, for editors."""

import argparse
from pathlib import Path
from typing import Any

from swath.terminal.options import option, verb

PLACE = "connect", 4  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "schema", "JSON Schema of scenario and job files, for editors", run)
    option(parser, "kind", "kind of file", ("scenario", "job"), nargs="?")
    option(parser, "--out F", "file to write (default: print it)", type=Path)


def run(args: argparse.Namespace) -> int:
    """Print or write it."""
    if args.out is None:
        print(schema_text(args.kind), end="")
    else:
        write_schema(args.out, args.kind)
    return 0


def write_schema(path: Path, of: str = "scenario") -> None:
    """Write the JSON Schema of scenario files, or of job files."""
    from swath.core.files.whole_file import write_whole

    write_whole(path, schema_text(of))


def schema_text(of: str = "scenario") -> str:
    """The JSON Schema of scenario files, or of job files."""
    import json

    from swath.fleet.files import job_schema
    from swath.scenario.schema import scenario_schema

    return json.dumps(job_schema() if of == "job" else scenario_schema(), indent=1) + "\n"
