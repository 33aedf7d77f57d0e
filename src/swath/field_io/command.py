"""`swath field`: fields from yield logs."""

import argparse
import os
from pathlib import Path
from typing import Any

from swath.terminal.options import option, verb


def add(parsers: Any) -> Any:
    """Add the command and its two verbs. Returns the verbs, for more of them."""
    parser = parsers.add_parser("field", help="make a field from a yield log, look at one, take one away")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    imports = verb(verbs, "import", "make a field folder from a combine's yield log", run_import)
    option(
        imports,
        "log LOG",
        "CSV, a point shapefile (bare, folder or zip), ISOXML (TASKDATA folder or zip, one TLG file), "
        "or the bundled sample-log; an outline (KML, GeoJSON, polygons of a shapefile) or a field folder of "
        "AgOpenGPS for an even crop",
        type=Path,
    )
    option(imports, "--out DIR", "the field folder to make", type=Path, required=True)
    option(imports, "--dem F", "GeoTIFF of heights (default: the log's own)", type=Path)
    option(imports, "--boundary F", "GeoJSON, KML or shapefile of the field", type=Path)
    option(imports, "--columns MAP.yaml", "which column of the log is what, in which unit", type=Path)
    option(imports, "--grain-g-per-stem G", "grain on a stem [g]: stems from the yield", type=float, unit="g")
    option(imports, "--crop-height-m H", "height of the crop [m]", type=float)
    option(imports, "--header-width-m W", "width of the header [m], where the log holds none", type=float)
    option(imports, "--flow-delay-s S", "from the knife to the flow sensor [s] (default: found)", type=float)
    option(imports, "--crop NAME|FILE", "data sheet of the crop (default: what the log says)")
    option(imports, "--part N", "which field or harvest of a log that holds several", type=int)
    option(
        imports,
        "--as",
        "map: stand and yield of records in any order, without passes",
        ("passes", "map"),
        dest="kind",
    )
    option(imports, "--replace", "make DIR anew where it is a field; its changes are lost")
    shows = verb(verbs, "show", "draw a field folder as a picture", run_show)
    option(shows, "folder DIR", "a field folder", type=Path)
    text = "write a field folder as a field of AgOpenGPS"
    gives = verb(verbs, "agopengps", text, run_agopengps, text)
    option(gives, "folder DIR", "a field folder", type=Path)
    option(gives, "--out DIR", "the folder to make", type=Path, required=True)
    return verbs


def run_import(args: argparse.Namespace) -> int:
    """Make the folder and say what came out."""
    from swath.core.errors import InputError
    from swath.core.process.shell import command
    from swath.field_io.importer import Settings, import_log
    from swath.field_io.logs.columns import COLUMN_HEAD, column_rows
    from swath.field_io.pass_case import write_pass_case
    from swath.field_io.pass_scenario import write_pass_scenario
    from swath.terminal.tables import table, wide_console

    if not args.replace and os.path.isfile(args.out / "field.yaml"):
        expected = "expected a new or empty folder: this field may hold changes; --replace makes it anew"
        raise InputError("--out", str(args.out), expected)
    keys = ("grain_g_per_stem", "crop_height_m", "header_width_m", "flow_delay_s", "crop", "part")
    given = {key: getattr(args, key) for key in keys}
    settings = Settings(**{k: v for k, v in given.items() if v is not None}, as_map=args.kind == "map")
    files = {"dem": args.dem, "boundary": args.boundary, "columns": args.columns}
    report = import_log(args.log, args.out, **files, settings=settings)
    console = wide_console()
    console.print(report)
    if "columns" in report.source:
        table("columns", COLUMN_HEAD, column_rows(report.source))
    try:
        write_pass_scenario(args.out)
        console.print(f"drive in it: {command('run', args.out)}", highlight=False)
    except InputError as error:
        console.print(f"no scenario written: {error}", highlight=False)
        return 0
    if not (report.field.get("passes") or report.field.get("guidance_lines")):
        return 0  # a case drives along them
    try:
        case = write_pass_case(args.out)
        console.print(f"along many of them: {command('test', 'run', case, '--out', 'DIR')}", highlight=False)
    except InputError as error:
        console.print(f"no function test written: {error}", highlight=False)
    return 0


def run_show(args: argparse.Namespace) -> int:
    """Draw the overview, print where it is."""
    from swath.field_io.importer import show

    print(show(args.folder))
    return 0


def run_agopengps(args: argparse.Namespace) -> int:
    """Write the folder, print where it is."""
    from swath.field_io.agopengps import write_agopengps
    from swath.field_io.folder import read

    write_agopengps(read(args.folder), args.out)
    print(args.out)
    return 0
