"""`swath paper`: the paper's figures from runs on this machine."""

import argparse
from pathlib import Path
from typing import Any

_DESCRIPTION = """Make the figures of the paper that swath implements, from runs on this machine, each beside
what the paper says: levels, flow of a run, sensor models, lab stands, heights, edge detection, closed
loop. Writes index.html and a run folder for each case of the closed loop; takes one to three minutes."""


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("paper", help="the paper's figures, made here", description=_DESCRIPTION)
    parser.add_argument(
        "--out", type=Path, default=Path("paper"), metavar="DIR", help="where to write (default: paper)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Make the figures, write the page."""
    from swath.core.errors import InputError
    from swath.terminal.progress import steps
    from swath.tools.paper.figures import FIGURES
    from swath.tools.paper.page import write_paper

    is_earlier = (args.out / "index.html").is_file()
    if args.out.exists() and not (args.out.is_dir() and (is_earlier or not any(args.out.iterdir()))):
        raise InputError("--out", str(args.out), "expected a new or empty folder, or an earlier paper")
    args.out.mkdir(parents=True, exist_ok=True)
    with steps(len(FIGURES)) as step:
        page = write_paper(args.out, step)
    print(page)
    return 0
