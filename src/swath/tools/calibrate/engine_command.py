"""`swath calibrate engine`: engine, fuel and powers of a machine from a log of several."""

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swath.core.files.whole_file import write_whole
from swath.core.number_text import num, span
from swath.terminal.options import option, verb

if TYPE_CHECKING:
    from swath.tools.calibrate.engine_fit import Prediction

_DESCRIPTION = """Fit numbers of a machine's data sheet to engine load and fuel of a recorded log together,
and predict each machine of the log by numbers fitted on the others. Standard errors come from a bootstrap
over machines and stretches of 5 minutes."""


def add_engine(kinds: Any) -> None:
    """Add `calibrate engine`."""
    parser = verb(kinds, "engine", "engine, fuel and powers of a machine", run_engine_fit, _DESCRIPTION)
    option(parser, "model MODEL", "machine: bundled name or data sheet")
    option(parser, "log LOG", "CSV, zipped point shapefile, or ISOXML", type=Path)
    option(
        parser,
        "--fit KEY",
        "key of the data sheet to fit (default: rated power, idle fuel, auxiliary power, drum work)",
        [],
    )
    option(parser, "--straw R", "straw per grain", 0.65)
    option(parser, "--resamples N", "bootstrap resamples", 1000)
    option(parser, "--seed", "seed of the bootstrap", 1)
    option(parser, "--columns MAP.yaml", "which column of the log is what", type=Path)
    option(parser, "--out SHEET.yaml", "write the data sheet as fitted", type=Path)


def run_engine_fit(args: argparse.Namespace) -> int:
    """Fit, print, write."""
    from rich.console import Console

    from swath.core.errors import check_within
    from swath.documents.yaml_document import dump
    from swath.field_io.logs.columns import COLUMN_HEAD, column_rows
    from swath.field_io.logs.machine_log import read_machine_log
    from swath.machine.machine_sheet import open_machine
    from swath.terminal.tables import table
    from swath.tools.calibrate.engine_fit import KEYS, fit_engine
    from swath.tools.compare_log.compare import Drive

    check_within("--resamples", args.resamples, 10, 100_000)
    check_within("--straw", args.straw, 0.0, 10.0)
    sheet = open_machine(args.model)
    with Console(stderr=True).status("reading the log") as status:
        log = read_machine_log(args.log, args.columns)
        made = fit_engine(
            sheet, log, Drive(straw=args.straw), keys=args.fit or KEYS, resamples=args.resamples,
            seed=args.seed, progress=status.update,
        )  # fmt: skip
    names = [f"without {name}" for name in log.machine_names]
    rows = [
        [n.key, num(n.start), num(n.value), num(n.error), *map(num, n.left_out), n.unit] for n in made.numbers
    ]
    table("fitted on all machines", ("key", "start", "value", "error", *names, "unit"), rows)
    head = (
        "machine",
        "count",
        "load R2",
        "95 %",
        "RMSE",
        "bias",
        "fuel R2",
        "RMSE l/h",
        "bias l/h",
        "bias %",
    )
    table("as given", head, _rows(made.before))
    table("fitted on all machines", head, _rows(made.after))
    table("each machine predicted by numbers fitted on the others", head, _rows(made.left_out))
    table("columns", COLUMN_HEAD, column_rows(log.column_map.summary()))
    if args.out is not None:
        write_whole(args.out, dump(made.sheet.document.data, width=110))
        print(args.out)
    return 0


def _rows(made: Iterable["Prediction"]) -> list[list[str]]:
    rows = []
    for p in made:
        between = span(p.load_r2_range)
        load = [num(p.load.r2), between, num(p.load.rmse), num(p.load.bias)]
        fuel = [num(v) for v in (p.fuel.r2, p.fuel.rmse, p.fuel.bias, p.fuel_bias_percent)]
        rows.append([p.machine, str(p.load.count), *load, *fuel])
    return rows
