"""`swath test estimate`: the probability of a rare failure."""

import argparse
import json
import os
from typing import Any

from swath.core.number_text import num, percent_of
from swath.terminal.options import add_folder, add_sets, made_of, option, verb
from swath.tools.function_test.progress import add_engine, engine, progress

SUMMARY = "summary.json"
_ABOUT = """Probability that a run breaks a limit, with its 95 % interval, by importance sampling over the
exposure of what the case varies. Exit code 0 a number is given, 3 it cannot be supported; with --at-most 0
kept, 1 exceeded, 3 not shown."""


def add(verbs: Any) -> None:
    """Add the verb."""
    estimate = verb(verbs, "estimate", "estimate how likely a rare failure of a case is", _estimate, _ABOUT)
    option(estimate, "case", "a case file or a bundled case; `exposure` says how often values occur")
    add_folder(estimate, "estimate", text="folder of the results", alone=False)
    option(estimate, "--limit NAME", "only this limit (default: any)", "")
    option(estimate, "--budget N", "runs at the level judged", 2000)
    add_sets(estimate, "of every scenario")
    option(
        estimate,
        "--cheap KEY=VALUE",
        "change for the runs that search, such as combine.lidar=profile; the number rests on the others",
        [],
    )
    option(estimate, "--cheap-budget N", "runs of the cheap search (default: as --budget)", type=int)
    option(estimate, "--at-most P", "judge: the probability is at most this", type=float,
           unit="fraction")  # fmt: skip
    option(estimate, "--draw-seed N", "seed of the random points", 1)
    add_engine(estimate)


def _estimate(args: argparse.Namespace) -> int:
    from swath.core.errors import InputError
    from swath.tools.function_test.case import source_of
    from swath.tools.function_test.estimate.estimate import Estimate, run_estimate

    if args.at_most is not None and not 0.0 < args.at_most < 1.0:
        raise InputError("--at-most", args.at_most, "expected a probability, > 0 and < 1")
    if args.cheap_budget is not None and not args.cheap:
        raise InputError("--cheap-budget", args.cheap_budget, "expected --cheap beside it")
    source = source_of(args.case)
    cheap_budget = (args.cheap_budget or args.budget) if args.cheap else 0
    asked = made_of(Estimate, args, {"seed": "draw_seed"}, case=source, cheap_budget=cheap_budget)
    with progress(asked.budget + asked.all_cheap) as done, engine(args.cluster, args.workers) as client:
        found = run_estimate(args.out, asked, max(1, args.workers), done, client)
    return tell(found, args.at_most)


def tell_again(found: Any) -> int:
    """The same from a folder, with the probability that was claimed there last."""
    from swath.documents.json_file import read_object

    file = found.folder / SUMMARY
    before = read_object(file, SUMMARY, "a summary") if os.path.isfile(file) else {}
    at_most = before.get("at_most")
    return tell(found, at_most if isinstance(at_most, float) else None)


def tell(found: Any, at_most: float | None = None) -> int:
    """Table, page, JSON, JUnit and the line on the screen; returns the exit code."""
    from swath.core.files.whole_file import write_whole
    from swath.terminal.outcome import exit_code
    from swath.terminal.tables import say
    from swath.tools.function_test.estimate.page import write_estimate, write_junit
    from swath.tools.function_test.journal import write_table

    verdict = found.verdict(at_most)
    plain = {**found.plain, "at_most": at_most, "verdict": verdict or None}
    write_table(found.folder, found.results)
    write_whole(found.folder / SUMMARY, json.dumps(plain, indent=1, allow_nan=False) + "\n")
    write_junit(found.folder / "junit.xml", found, at_most)
    page = write_estimate(found.folder / "report.html", found, at_most)
    say(found.text)
    if (cheap := found.cheap_rate) is not None and cheap.failures:
        say(
            f"at the cheap level, same points and seeds: {num(cheap.value)} (95 %: {num(cheap.low)} to "
            f"{num(cheap.high)}); it keeps the limit in {percent_of(found.unseen)} of the failures, by weight"
        )
    if verdict:
        print(f"at most {num(at_most)}: {verdict}")
    print(f"report  {page}")
    return exit_code([verdict] if verdict else found.refusals)
