"""`swath tune`: tune numbers and choices of a scenario in cases, and prove them in others."""

import argparse
from typing import Any

from swath.terminal.options import add_folder, add_sets, made_of, option, verb
from swath.tools.function_test.progress import add_engine, engine, progress

PLACE = "many", 1  # among all commands
_DESCRIPTION = """Tune numbers and choices of a scenario in cases; the winner is judged by runs with other
seeds and conditions. Limits of the cases are kept before an aim counts. Exit code 0 better, 1 worse, 3 no
better than shipped, 4 better in the tuned cases only."""


def add(parsers: Any) -> None:
    """Add the command."""
    said = "tune parameters in cases, prove them in others"
    parser = verb(parsers, "tune", said, _tune, _DESCRIPTION)
    option(parser, "cases CASE", "bundled cases, case files or folders of them", nargs="+")
    option(parser, "--param KEY=RANGE", "2..8, 2..8:whole, 0.1..10:log, or choices a,b; several times", [],
           type=_parameter, required=True)  # fmt: skip
    option(parser, "--aim METRIC", "one or two (default margin: to the limits)", [])
    option(parser, "--prove CASE", "prove in this case instead of other conditions; several times", [])
    option(parser, "--tries N", "settings that are tried, 10 to 400", 60)
    option(parser, "--each N", "runs of each setting, over all cases", 8)
    option(
        parser,
        "--proof N",
        "runs of each part of the proof, 10 or more, with the winner and as many as shipped",
        32,
    )
    add_sets(parser, "change every scenario; shipped is what it says then")
    option(parser, "--level", "LiDAR level, as in swath test run", "", choices=("empirical", "plants"))
    option(parser, "--seed N", "seed of the draws", 1)
    add_folder(parser, "tuning", text="folder of the results; the same command goes on", alone=False)
    add_engine(parser)


def _parameter(text: str) -> list[str]:
    """`KEY=RANGE` in parts, so that Python files among choices count as named."""
    key, equals, said = text.partition("=")
    return [key + equals, *said.split(",")]


def _tune(args: argparse.Namespace) -> int:
    from swath.tools.function_test.case import source_of
    from swath.tools.function_test.judging.margin import MARGIN
    from swath.tools.tune.tune import Tune, run_tune, runs_of

    params = tuple(parts[0] + ",".join(parts[1:]) for parts in args.param)
    cases, proven = (tuple(map(source_of, some)) for some in (args.cases, args.prove))
    aims = tuple(args.aim) or (MARGIN,)
    tune = made_of(Tune, args, cases=cases, params=params, aims=aims, proven=proven)
    with progress(runs_of(tune), "at most ") as done, engine(args.cluster, args.workers) as client:
        found = run_tune(args.out, tune, max(1, args.workers), done, client)
    return tell(found)


def tell(found: Any) -> int:
    """Pages, and what was found on the screen; returns the exit code."""
    from swath.core.process.shell import command
    from swath.terminal.tables import table
    from swath.tools.tune.page import caveats, difference_rows, write_tuned
    from swath.tools.tune.tune import PARTS

    page = write_tuned(found)
    rows = [row for part in found.proofs for row in difference_rows(found, part)]
    table("", ("proven by", "winner - shipped", "pairs", "mean difference", "99 %", "shown"), rows)
    for part, proof in found.proofs.items():
        for name, text in caveats(found, part).items():
            print(f"{PARTS[part]}: {name} better: {text}")
        if any(proof.failed):
            shipped, mine = proof.failed
            print(f"{PARTS[part]}: {mine} runs of the winner do not pass, {shipped} as shipped")
    for key, value in found.winner.items():
        print(f"--set {key}={value}")
    print(f"verdict {found.verdict}")
    print(f"try it  {command('run', found.folder / 'winner.yaml')}")
    print(f"report  {page}")
    code: int = found.exit_code
    return code
