"""`swath osi`: recorded scans or radar detections as a trace of ASAM OSI."""

import argparse
from pathlib import Path
from typing import Any


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("osi", help="scans or radar detections of a run as an ASAM OSI trace")
    parser.add_argument("run_folder", type=Path, metavar="RUN", help="a run folder")
    parser.add_argument("--out", type=Path, required=True, metavar="X.osi", help="file to write")
    parser.add_argument(
        "--type", default="sd", metavar="T", help="sd = SensorData (default), sv = SensorView"
    )
    parser.add_argument("--slot", metavar="SLOT", help="a scanner or radar (default: the first recorded)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the trace."""
    from swath.link.osi.messages import TYPES
    from swath.link.osi.trace import write_trace

    count = write_trace(args.run_folder, args.out, kind=args.type, slot=args.slot)
    print(f"{args.out}  {count} messages {TYPES[args.type]}")
    return 0
