"""`swath compare`: `log`, a machine model against a recorded log; `scans`, two sets of scans."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from swath.core.errors import InputError, check_within
from swath.core.number_text import num
from swath.terminal.options import add_folder, made_of, option, verb
from swath.terminal.tables import table
from swath.tools.compare_scans import command as scans

PLACE = "measured", 3  # among all commands
FILES = ("results.json", "comparison.png", "report.html", "machine.yaml", "series.parquet")

_DESCRIPTION = (
    "Runs a machine's process and powertrain along a recorded log (its speed, its crop, its slope) and "
    "compares engine load, engine speed and fuel, as far as the log has them. Keys of the data sheet can be "
    "fitted on one part of the log; the others then test it. A plain regression is shown for comparison. "
    "A log with a steering angle and without the engine is used for steering and motion instead: dead "
    "time, lag, rate, understeer and relaxation are fitted, with intervals."
)


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("compare", help="compare with what was measured")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    log = verb(verbs, "log", "a machine against a recorded log", run_log, _DESCRIPTION)
    option(log, "model MODEL", "machine: bundled name or data sheet")
    option(log, "log LOG", "CSV, zipped point shapefile, ISOXML, MF4, BLF or ASC", type=Path)
    help_ = "write picture, report, JSON, sheet and series"
    add_folder(log, "comparison", *FILES, text=help_, required=False)
    option(log, "--fit KEY", "key of the data sheet to fit", [])
    option(
        log,
        "--on QUANTITY",
        "quantity to fit to (default engine_load; for a steering angle yaw_rate or place)",
        [],
    )
    option(log, "--machine NAME", "fit on this machine of the log, test on the others")
    option(log, "--share SHARE", "fit on this first share of the log, test on the rest", 0.5, unit="fraction")
    option(log, "--alternate", "fit on every other stretch between pauses, test on the others")
    option(log, "--process LEVEL", "level of the process", "threshing")
    option(log, "--engine LEVEL", "level of the powertrain", "ideal")
    option(log, "--straw R", "straw per grain (default 0.65; of a whole crop: no grain)", type=float)
    option(log, "--whole-crop", "the logged flow is all of the crop")
    option(log, "--flow-floor F", "flow that is logged without crop [kg/s]", 0.0, unit="kg_s")
    option(
        log,
        "--load-over",
        "what 100 %% of logged load is: torque at the present speed, or the largest torque",
        ("present", "largest"),
    )
    option(log, "--friction P", "logged load at zero torque [%%]", 0.0, unit="percent")
    option(
        log,
        "--antenna",
        "GNSS antenna, ahead of the fixed axle and left of it [m] (default 0 0)",
        type=float,
        unit="m",
        nargs=2,
        metavar=("X", "Y"),
    )
    option(log, "--columns MAP.yaml", "which column of the log is what", type=Path)
    scans.add(verbs)


def run_log(args: argparse.Namespace) -> int:
    """Compare what the log holds: process and engine, or the steering."""
    from swath.field_io.logs.columns import map_to_fill
    from swath.field_io.logs.steer_log import is_steer_log

    for key, low, high in (("straw", 0.0, 10.0), ("friction", 0.0, 50.0), ("flow_floor", 0.0, 200.0)):
        if getattr(args, key) is not None:
            check_within(f"--{key.replace('_', '-')}", getattr(args, key), low, high)
    with map_to_fill(args.log, args.out, args.columns):
        return (_run_steering if is_steer_log(args.log, args.columns) else _run_process)(args)


def _run_process(args: argparse.Namespace) -> int:
    """Compare process and engine, print, write."""
    from rich.console import Console

    from swath.tools.compare_log.compare import Drive, compare_log
    from swath.tools.compare_log.page import statistic_rows, write_comparison

    if args.antenna is not None:
        raise InputError("--antenna", args.antenna, "expected a log with a steering angle")
    drive = made_of(Drive, args, friction=args.friction / 100.0)
    with Console(stderr=True).status("reading the log") as status:
        made = compare_log(
            args.model, args.log, drive=drive, fit=args.fit, on=args.on or ["engine_load"],
            machine=args.machine, share=args.share, alternate=args.alternate, columns=args.columns,
            progress=status.update,
        )  # fmt: skip
    if made.fitted:
        rows = [[f.key, num(f.start), num(f.value), num(f.error), f.unit] for f in made.fitted]
        table(f"fitted on {made.fitted_on}", ("key", "start", "fitted", "error", "unit"), rows)
    head = ("quantity", "records", "model", "count", "R2", "RMSE", "bias", "r", "lag s")
    table(f"{made.model} against {made.log_name}", head, statistic_rows(made))
    return _tell(made, made.log.notes, args.out, write_comparison)


def _tell(made: Any, notes: Sequence[str], out: Path | None, write: Callable[[Any, Path], Any]) -> int:
    """Columns and notes, and where all of it was written."""
    from rich.console import Console

    from swath.field_io.logs.columns import COLUMN_HEAD, column_rows

    table("columns", COLUMN_HEAD, column_rows(made.log.column_map.summary()))
    console = Console(highlight=False)
    for note in notes:
        console.print(f"note: {note}", markup=False)
    if out is not None:
        write(made, out)
        console.print(f"written: {out}/report.html", markup=False)
    return 0


_OF_THE_ENGINE = ("machine", "alternate", "whole_crop", "flow_floor", "friction")


def _run_steering(args: argparse.Namespace) -> int:
    """Fit steering and motion, print, write."""
    from rich.console import Console

    from swath.tools.compare_log.steering_fit import compare_steering
    from swath.tools.compare_log.steering_page import FITTED, fitted_rows, left_rows, write_steering

    for key in _OF_THE_ENGINE:
        if getattr(args, key):
            flag = f"--{key.replace('_', '-')}"
            raise InputError(flag, getattr(args, key), "expected a log with a crop flow and an engine")
    if len(args.on) > 1:
        raise InputError("--on", ", ".join(args.on), "expected yaw_rate or place, once")
    with Console(stderr=True).status("reading the log") as status:
        made = compare_steering(
            args.model, args.log, fit=args.fit, on=next(iter(args.on), None),
            antenna=tuple(args.antenna or (0.0, 0.0)), columns=args.columns, progress=status.update,
        )  # fmt: skip
    table(f"{made.model} by {made.log_name}", FITTED, fitted_rows(made))
    columns = ("part", "compared with", "passes", "RMSE, data sheet", "fitted", "predicted", "unit")
    table("what is left", columns, left_rows(made))
    return _tell(made, made.notes, args.out, write_steering)
