"""`swath compare log`: a machine model against a recorded log."""

import argparse
import shlex
from pathlib import Path
from typing import Any

_DESCRIPTION = (
    "Runs a machine's process and powertrain along a recorded log (its speed, its crop, its slope) and "
    "compares engine load, engine speed and fuel, as far as the log has them. Keys of the data sheet can be "
    "fitted on one part of the log; the others then test it. A plain regression is shown for comparison."
)


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("compare", help="compare a model with what was measured")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    log = verbs.add_parser("log", help="a machine against a recorded log", description=_DESCRIPTION)
    log.add_argument("model", metavar="MODEL", help="machine: bundled name or data sheet")
    log.add_argument("log", type=Path, metavar="LOG", help="CSV, zipped point shapefile, or ISOXML")
    log.add_argument("--out", type=Path, metavar="DIR", help="write picture, report, JSON, sheet and series")
    log.add_argument("--fit", action="append", default=[], metavar="KEY", help="key of the data sheet to fit")
    log.add_argument("--on", action="append", default=[], metavar="QUANTITY", help="to fit to (engine_load)")
    log.add_argument("--machine", metavar="NAME", help="fit on this machine of the log, test on the others")
    log.add_argument(
        "--share", type=float, default=0.5, metavar="S", help="else: fit on the first share (0.5)"
    )
    log.add_argument("--alternate", action="store_true", help="else: on every other stretch between pauses")
    log.add_argument("--process", default="threshing", metavar="LEVEL", help="of the process (threshing)")
    log.add_argument("--engine", default="ideal", metavar="LEVEL", help="of the powertrain (ideal)")
    log.add_argument("--straw", type=float, default=0.65, metavar="R", help="straw per grain (0.65)")
    log.add_argument("--whole-crop", action="store_true", help="the logged flow is all of the crop")
    log.add_argument("--flow-floor", type=float, default=0.0, metavar="F", help="logged without crop [kg/s]")
    log.add_argument(
        "--load-over", choices=("present", "largest"), default="present",
        help="logged load over the torque at the present speed, or over the largest",
    )  # fmt: skip
    log.add_argument("--friction", type=float, default=0.0, metavar="P", help="logged load of no torque [%%]")
    log.add_argument("--columns", type=Path, metavar="MAP.yaml", help="which column of the log is what")
    log.set_defaults(run=run_log)


def run_log(args: argparse.Namespace) -> int:
    """Compare, print, write."""
    from rich.console import Console

    from swath.core.errors import InputError
    from swath.terminal.tables import number, table
    from swath.tools.compare_log.along_log import Drive
    from swath.tools.compare_log.compare import compare_log
    from swath.tools.compare_log.page import statistic_rows, write_comparison

    for key, low, high in (("straw", 0.0, 10.0), ("friction", 0.0, 50.0), ("flow_floor", 0.0, 200.0)):
        if not low <= getattr(args, key) <= high:
            raise InputError(
                f"--{key.replace('_', '-')}", getattr(args, key), f"expected {low:g} to {high:g}"
            )
    drive = Drive(
        args.process, args.engine, args.straw, args.whole_crop, args.load_over, args.friction / 100.0,
        args.flow_floor,
    )  # fmt: skip
    with Console(stderr=True).status("reading the log") as status:
        made = compare_log(
            args.model, args.log, drive=drive, fit=args.fit, on=args.on or ["engine_load"],
            machine=args.machine, share=args.share, alternate=args.alternate, columns=args.columns,
            progress=status.update,
        )  # fmt: skip
    if made.fitted:
        rows = [[f.key, number(f.start), number(f.value), number(f.error), f.unit] for f in made.fitted]
        table(f"fitted on {made.fitted_on}", ("key", "start", "fitted", "error", "unit"), rows)
    head = ("quantity", "records", "model", "count", "R2", "RMSE", "bias", "r", "lag s")
    table(f"{made.model} against {made.log_name}", head, statistic_rows(made))
    console = Console(highlight=False)
    for note in made.log.notes:
        console.print(f"note: {note}", markup=False)
    if args.out is not None:
        write_comparison(made, args.out, command=_command(args))
        console.print(f"written: {args.out}/report.html", markup=False)
    return 0


def _command(args: argparse.Namespace) -> str:
    """The command line that was given, without the folder of the log."""
    parts = ["swath", "compare", "log", args.model, args.log.name]
    for key in ("fit", "on"):
        parts += [p for value in getattr(args, key) for p in (f"--{key}", value)]
    defaults = {"share": 0.5, "process": "threshing", "engine": "ideal", "straw": 0.65, "flow_floor": 0.0,
                "load_over": "present", "friction": 0.0, "machine": None}  # fmt: skip
    for key, default in defaults.items():
        if getattr(args, key) != default:
            parts += [f"--{key.replace('_', '-')}", str(getattr(args, key))]
    parts += [f"--{k.replace('_', '-')}" for k in ("alternate", "whole_crop") if getattr(args, k)]
    return shlex.join(parts)
