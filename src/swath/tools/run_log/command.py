"""`swath run-log`: the numbers of a run as MF4, BLF or ASC."""

import argparse
from pathlib import Path
from typing import Any

from swath.terminal.options import option, verb

PLACE = "look", 7  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    text = "the numbers of a run as MF4, BLF or ASC"
    parser = verb(parsers, "run-log", text, run, _DESCRIPTION)
    option(parser, "run_folder RUN", "a run folder", type=Path)
    option(parser, "--out F", "F.mf4, F.blf or F.asc", type=Path, required=True)


def run(args: argparse.Namespace) -> int:
    """Write the file, print what is in it."""
    from swath.tools.run_log.write import write_run_log

    print(f"{args.out}  {write_run_log(args.run_folder, args.out)} channels")
    return 0


_DESCRIPTION = """Writes the plain numbers that were recorded, without scans and images: channels with their
units (MF4), or CAN frames with a double each, described by a DBC file beside (BLF, ASC)."""
