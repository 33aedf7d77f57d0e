"""`swath report`: the report of a run that has none."""

import argparse
import os
from pathlib import Path
from typing import Any

from swath.terminal.options import option, verb

PLACE = "look", 1  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "report", "draw the report of a run again", run, _DESCRIPTION)
    option(parser, "source RUN", "a run folder", type=Path)


def run(args: argparse.Namespace) -> int:
    """Write report.html, print where it is."""
    from swath.tools.rerun.rerun import draw_report

    print(draw_report(args.source))
    if not os.path.isfile(args.source / "summary.json"):
        print("note    the run was killed: the page shows what its recording holds")
    return 0


_DESCRIPTION = """Writes report.html of a run that was stopped while it was drawn, or killed before its end:
then the page says so. The recording is played for it, so it must hold every sample."""
