"""`swath field`: fields from yield logs."""

import argparse
from pathlib import Path
from typing import Any


def add(parsers: Any) -> None:
    """Add the command and its two verbs."""
    parser = parsers.add_parser("field", help="make a field from a yield log, look at one")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    imports = verbs.add_parser("import", help="make a field folder from a combine's yield log")
    imports.add_argument("log", type=Path, metavar="LOG", help="CSV, or a zipped point shapefile")
    imports.add_argument("--out", type=Path, required=True, metavar="DIR", help="the field folder to make")
    imports.add_argument("--dem", type=Path, metavar="F", help="GeoTIFF of heights (default: the log's own)")
    imports.add_argument(
        "--boundary", type=Path, metavar="F", help="GeoJSON or zipped shapefile of the field"
    )
    imports.add_argument("--columns", type=Path, metavar="MAP.yaml", help="which column of the log is what")
    imports.set_defaults(run=run_import)
    shows = verbs.add_parser("show", help="draw a field folder as a picture")
    shows.add_argument("folder", type=Path, metavar="DIR", help="a field folder")
    shows.set_defaults(run=run_show)


def run_import(args: argparse.Namespace) -> int:
    """Make the folder and say what came out."""
    from rich.console import Console

    from swath.field.io.importer import import_log

    report = import_log(args.log, args.out, dem=args.dem, boundary=args.boundary, columns=args.columns)
    Console().print(report)
    return 0


def run_show(args: argparse.Namespace) -> int:
    """Draw the overview, print where it is."""
    from swath.field.io.importer import show

    print(show(args.folder))
    return 0
