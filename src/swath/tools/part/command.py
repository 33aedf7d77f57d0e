"""`swath part`: one slot of a scenario on its own."""

import argparse
import os
from pathlib import Path
from typing import Any

from swath.core.number_text import num
from swath.terminal.options import add_folder, add_sets, option, verb

PLACE = "look", 5  # among all commands
USUAL = "straight"


FILES = ("inputs.csv", "outputs.csv")


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "part", "one slot of a scenario on its own", run, _DESCRIPTION)
    option(parser, "slot SLOT", "combine.process, or process where there is one machine")
    option(
        parser, "--input X.csv|RUN", "its inputs: a table, or a run; without it, print the columns", type=Path
    )
    option(parser, "--scenario NAME|FILE", f"scenario of the slot (default: that of RUN, else {USUAL})")
    help_ = "folder for inputs.csv and outputs.csv"
    add_folder(parser, "part", *FILES, text=help_, required=False, alone=False)
    add_sets(parser)


def run(args: argparse.Namespace) -> int:
    """Print the columns, or run the slot and print where its outputs are."""
    from swath.core.errors import InputError
    from swath.record.read.files import open_log
    from swath.scenario.scenario import find_slots, load_scenario
    from swath.tools.part.isolate import IsolatedPart, is_table
    from swath.tools.rerun.rerun import recorded_scenario

    log = None
    if args.input is not None and os.path.exists(args.input) and not is_table(args.input):
        log = open_log(args.input)
    if log is not None and args.scenario is None:
        scenario = recorded_scenario(log, args.input, args.sets)
    else:
        scenario = load_scenario(args.scenario or USUAL, sets=args.sets)
    (slot,) = find_slots(scenario, [args.slot], key="SLOT")
    part = IsolatedPart(scenario, slot)
    try:
        if args.input is None:
            _print_columns(part)
        elif args.out is None:
            raise InputError("--out", None, "expected a folder for inputs.csv and outputs.csv")
        else:
            _run(part, args.input, log, args.out)
    finally:
        part.world.close()
    return 0


def _run(part: Any, source: Path, log: Any, out: Path) -> None:
    from swath.tools.part.table import read_table, write_table
    from swath.tools.rerun.comparison import RecordingComparison

    arrivals, end = read_table(source, part) if log is None else (part.recorded(log), log.end())
    comparison = None if log is None else RecordingComparison(log, [part.slot], played=())
    given = part.run(arrivals, end=end, observers=[] if comparison is None else [comparison])
    for name, samples, last in zip(FILES, (arrivals, given), (end, 0), strict=True):
        if not os.path.exists(out / name) or not (out / name).samefile(source):
            write_table(out / name, part, samples, last)
        print(f"{out / name}  {len(samples)} samples")
    if comparison is not None:
        for name, found in comparison.summarize(part.world.graph.t)["rerun"]["slots"].items():
            same = f"differs from {num(found.get('differs_from_s', 0.0))} s on in {found.get('differs_in')}"
            result = "identical to the recording" if found["identical"] else same
            print(f"{name}: {result}, {found['samples']} samples")


def _print_columns(part: Any) -> None:
    from swath.terminal.tables import table
    from swath.tools.part.table import TIME, columns_of

    rows = [(TIME, "in", "s", "time from the start of the run", "")]
    for direction, ports in (("in", part.ports), ("out", part.given)):
        for name, (output, field) in columns_of(part, ports).items():
            is_needed = direction == "in" and field.default is None
            need = "" if not is_needed else "needed" if output in part.needed else "with its output"
            rows.append((name, direction, field.unit, field.quantity.meaning, need))
    table("", ("column", "", "unit", "what it is", ""), rows)


_DESCRIPTION = """Run one slot alone, with the level and parameters it has in a scenario. What it takes comes
from a table (columns slot.output.number over t_s, SI units, radians) or from the recording of a run; what it
gives is written as such a table. Of a recording, inputs.csv can be edited and fed again."""
