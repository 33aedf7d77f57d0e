"""`swath osi`: recorded scans or radar detections as a trace of ASAM OSI."""

import argparse
from pathlib import Path
from typing import Any

from swath.terminal.options import option, verb

PLACE = "connect", 3  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "osi", "scans or radar detections of a run as an ASAM OSI trace", run)
    option(parser, "run_folder RUN", "a run folder", type=Path)
    option(parser, "--out X.osi", "file to write", type=Path, required=True)
    option(parser, "--type T", "sd = SensorData (default), sv = SensorView", "sd")
    option(parser, "--slot SLOT", "a scanner or radar (default: the first recorded)")


def run(args: argparse.Namespace) -> int:
    """Write the trace."""
    from swath.link.osi.messages import TYPES
    from swath.link.osi.trace import write_trace

    count = write_trace(args.run_folder, args.out, kind=args.type, slot=args.slot)
    print(f"{args.out}  {count} messages {TYPES[args.type]}")
    return 0
