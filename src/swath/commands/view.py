"""`swath view`: the page on which a run can be watched again."""

import argparse
from pathlib import Path
from typing import Any

from swath.terminal.options import option, verb

PLACE = "look", 0  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "view", "make replay.html of a run folder: watch the run again", run, _DESCRIPTION)
    option(parser, "folder RUN", "a run folder", type=Path)
    option(parser, "--out FILE", "where to write (default: RUN/replay.html)", type=Path)


def run(args: argparse.Namespace) -> int:
    """Write the page and print where it is."""
    from swath.replay.writer import view

    print(view(args.folder, out=args.out))
    return 0


_DESCRIPTION = """Make replay.html of a run folder: one file to open in a browser, offline, or to mail.
The field is made again from the scenario, everything else comes from the folder."""
