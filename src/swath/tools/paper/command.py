"""`swath paper`: the paper's figures from runs on this machine."""

import argparse
from pathlib import Path
from typing import Any

from swath.terminal.options import add_folder

FILES = ("index.html", "broken-edge", "tight-curve", "low-density")
_DESCRIPTION = """Make the figures of the paper that swath implements, from runs on this machine, each beside
what the paper says: levels, flow of a run, sensor models, lab stands, heights, edge detection, closed
loop. Writes index.html and a run folder for each case of the closed loop; takes one to three minutes."""


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("paper", help="the paper's figures, made here", description=_DESCRIPTION)
    add_folder(parser, "paper", *FILES, text="where to write (default: paper)", required=False)
    parser.set_defaults(out=Path("paper"))
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Make the figures, write the page."""
    from swath.terminal.progress import steps
    from swath.tools.paper.figures import FIGURES
    from swath.tools.paper.page import write_paper

    with steps(len(FIGURES)) as step:
        page = write_paper(args.out, step)
    print(page)
    return 0
