"""`swath test search`: the boundary of failure of a case."""

import argparse
from pathlib import Path
from typing import Any

from swath.core.number_text import num, span
from swath.terminal.options import add_folder, add_sets, made_of, option, verb
from swath.tools.function_test.progress import add_engine, engine, progress


def add(verbs: Any) -> None:
    """Add the verb."""
    search = verb(
        verbs, "search", "search the boundary of failure within the parameter ranges of a case", _search
    )
    option(search, "case", "a case file or a bundled case; parameters with a range are searched")
    add_folder(search, "search", text="folder of the results", alone=False)
    option(search, "--limit NAME", "only this limit (default: all together)", "")
    option(search, "--budget N", "runs in total", 64)
    option(search, "--batch N", "runs per round", 4)
    add_sets(search, "of every scenario")
    option(search, "--check DIR", "other results of the case, to check the boundary against", type=Path)
    add_engine(search)


def _search(args: argparse.Namespace) -> int:
    from swath.core.errors import InputError
    from swath.tools.function_test.case import source_of
    from swath.tools.function_test.search.search import Search, run_search

    if args.batch < 1:
        raise InputError("--batch", args.batch, "expected 1 run or more")
    search = made_of(Search, args, case=source_of(args.case))
    with progress(args.budget) as done, engine(args.cluster, args.workers) as client:
        found = run_search(args.out, search, args.budget, max(1, args.workers), done, client)
    return tell(found, args.check)


def tell(found: Any, check: Path | None = None) -> int:
    """Table, page and what the search shows on the screen."""
    from swath.terminal.tables import table
    from swath.tools.function_test.journal import write_table
    from swath.tools.function_test.search.page import write_search
    from swath.tools.function_test.session import open_session

    boundary = found.boundary
    write_table(found.folder, found.results)
    checked = None if check is None else found.right_of(check)
    page = write_search(found.folder / "report.html", found, checked)
    ranges = found.ranges
    rows = [
        (name, span(ranges[name]), num(first), num(total)) for name, first, total in boundary.sensitivities()
    ]
    table("", ("parameter", "range", "share of the variance, alone", "with others"), rows)
    print(f"{len(found.results)} runs, {found.passed()[0]} of them pass")
    for line in (*found.shows, *open_session(found.folder, same_code=False).level_lines()):
        print(line)
    if checked is not None:
        share = 100 * checked[0] / checked[1]
        print(f"{checked[0]} of {checked[1]} other runs predicted correctly: {num(share)} %")
    print(f"report  {page}")
    return 0
