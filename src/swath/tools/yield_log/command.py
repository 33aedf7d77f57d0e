"""`swath yield-log`: what a run harvested, as the yield log of a monitor."""

import argparse
from pathlib import Path
from typing import Any

from swath.core.number_text import num
from swath.terminal.options import former, option, verb

PLACE = "look", 6  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(
        parsers, "yield-log", "what a run harvested, as the yield log of a monitor", run, _DESCRIPTION
    )
    option(parser, "run_folder RUN", "a run folder", type=Path)
    option(parser, "--out DIR|FILE.csv", "a CSV, or a folder for ISOXML task data", type=Path, required=True)
    option(parser, "--machine NAME", "which machine (default: the first that harvests)")
    option(parser, "--interval-s S", "between records", 1.0)
    option(
        parser,
        "--sensor-delay-s S",
        "from the tank inlet to the sensor, added to the machine's own delay",
        0.0,
    )
    option(parser, "--origin LAT,LON", "where a field without coordinates lies (default 52,9)")
    former(parser, origin="--at")


def run(args: argparse.Namespace) -> int:
    """Write the log, print where it is."""
    from swath.tools.yield_log.records import place, records_of, write_csv, write_isoxml

    log = records_of(
        args.run_folder, machine=args.machine, interval=args.interval_s, delay=args.sensor_delay_s,
        at=place(args.origin),
    )  # fmt: skip
    file = write_csv(log, args.out) if args.out.suffix.lower() == ".csv" else write_isoxml(log, args.out)
    print(f"{file}  {len(log.time)} records, {num(log.grain_kg)} kg")
    return 0


_DESCRIPTION = """Writes position, speed, header width, grain flow, moisture and header state of a run as CSV
or ISOXML (ISO 11783-10) that farm software reads, and `swath field import`. The flow is what arrives in the
tank, so it lags the cut by the delay of the machine's process; a sensor further on adds its own."""
