"""`swath test levels`: which levels may be cheap in a case."""

import argparse
from typing import Any

from swath.core.number_text import num, percent_of
from swath.terminal.options import add_sets, option, verb


def add(verbs: Any) -> None:
    """Add the verb."""
    levels = verb(verbs, "levels", "propose levels that may be cheap in a case, and what that saves", _levels)
    option(levels, "case", "a bundled case or a case file")
    option(levels, "--runs N", "runs of its grid that are compared, those of the first seed first", 4)
    option(levels, "--within X", "difference that agrees, over the size of a number's limit", 0.1)
    add_sets(levels, "of every scenario")


def _levels(args: argparse.Namespace) -> int:
    from swath.terminal.tables import say, table
    from swath.tools.function_test.cheaper import find_cheaper

    def progress(text: str) -> None:
        print(f"trying  {text}", flush=True)

    found = find_cheaper(args.case, runs=args.runs, within=args.within, sets=args.sets, progress=progress)
    rows = [
        (
            tried.sets[0],
            tried.why or ("agrees, the same bytes" if tried.as_before == found.base.same else "agrees"),
            num(tried.apart),
            percent_of(found.saved(tried)),
        )
        for tried in found.tried
        if not tried.why.startswith("cannot")
    ]
    table("", ("level", "verdicts and numbers", "apart, of the limit", "time saved"), rows)
    left = len(found.tried) - len(rows)
    say(f"{left} levels need more than their name, or do not fit here." if left else "Every level was tried.")
    if not found.together.sets:
        print("no level may be cheaper")
        return 0
    share, same = 100.0 * found.saved(found.together), found.together.same
    print(f"together {num(share)} % of the time is saved, {same} of {same} verdicts the same:")
    print(" ".join(f"--set {text}" for text in found.together.sets))
    return 0
