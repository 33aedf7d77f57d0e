"""`swath lab`: what scanners measure over stands of known density."""

import argparse
from pathlib import Path
from typing import Any

from swath.terminal.options import add_folder, add_sets, former, made_of, option, verb

PLACE = "measured", 4  # among all commands


def add(parsers: Any) -> None:
    """Add the command and its verb."""
    parser = parsers.add_parser("lab", help="what scanners measure over stands of known density")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    made = verb(verbs, "stand", "measured heights by density, scanner and view", run_stand, _DESCRIPTION)
    add_folder(made, "lab", "lab.csv", "report.html")
    option(made, "--stems-per-m2 N", "density of the stands (default 200 600)", nargs="+", type=float)
    option(made, "--sensor NAME", "scanners (default: LMS511 HR and SR)", nargs="+")
    option(
        made,
        "--depression-deg DEG",
        "angle of the middle beam below the horizontal (default 15 30 45 60)",
        nargs="+",
        type=float,
    )
    option(made, "--crop NAME|FILE", "crop", "wheat")
    option(made, "--crop-height-m M", "height of the crop (default: that of its data sheet)", type=float)
    option(made, "--real FILE", "heights measured in the field (CSV)", type=Path)
    option(made, "--levels LEVEL", "LiDAR levels to compare (default: all)", nargs="+")
    option(made, "--seeds N", "stands per case", 5)
    option(made, "--seed N", "first of the seeds", 1)
    option(made, "--distance-m M", "to the crop along the middle beam", 5.0)
    add_sets(made, "a parameter of the LiDAR, e.g. echo=nearest or noise=none; may be given several times")
    former(made, crop_height_m="--height", stems_per_m2="--density")


def run_stand(args: argparse.Namespace) -> int:
    """Scan, compare, write; print the comparisons."""
    from swath.terminal.progress import progress_bar
    from swath.terminal.tables import table
    from swath.tools.lab.comparison import compare_levels, write_table
    from swath.tools.lab.lab import run_lab
    from swath.tools.lab.measured_heights import read_measured
    from swath.tools.lab.page import HEAD, comparison_rows, write_lab_report

    settings = _settings(args)
    real = None if args.real is None else read_measured(args.real)
    with progress_bar("scanning") as progress:
        lab = run_lab(settings, progress)
    cases = compare_levels(lab, real)
    name = None if real is None else real.name
    table_file = write_table(args.out / "lab.csv", cases)
    report = write_lab_report(args.out / "report.html", lab, cases, name)
    rows = comparison_rows(cases)
    if rows:
        table("", HEAD, rows)
    if real is not None and not any(len(c.real) for c in cases):
        print(f"warning: no row of {real.name} belongs to any of these cases")
    for note in lab.notes:
        print(f"note: {note}")
    print(table_file)
    print(report)
    return 0


def _settings(args: argparse.Namespace) -> Any:
    from swath.tools.lab.lab import Settings

    names = {"densities": "stems_per_m2", "sensors": "sensor", "depressions_deg": "depression_deg"}
    return made_of(Settings, args, {**names, "height_m": "crop_height_m"}, sets=_sets(args.sets))


def _sets(texts: list[str]) -> dict[str, Any]:
    """`echo=nearest` -> {"echo": "nearest"}; `weather.rain_mm_h=2` nests."""
    from swath.scenario.overrides import change_of, put

    found: dict[str, Any] = {}
    for text in texts:
        change = change_of(f"--set {text}", text)
        put(found, change.path, change.value, change.flag)
    return found


_DESCRIPTION = """Scan stands of known density with every level of the LiDAR and compare the
distributions of measured height with each other, and with real ones where a file is given. Writes lab.csv
and report.html; docs/explanation/validation.md says how to read them."""
