"""`swath fleet`: a whole field worked off by combines, carts and a truck."""

import argparse
from dataclasses import replace
from typing import Any

from swath.core.errors import InputError
from swath.terminal.options import add_folder, add_replace, add_sets, option, verb

PLACE = "many", 3  # among all commands
PAGES = "report.html", "replay.html"
FILES = ("results.json", "job.png", *PAGES, "plan.json", "draws.json")
LEVELS = {"events": "hours from the order at shared places alone", "driven": "bodies, too"}
GONE = {  # levels of 0.2
    "kinematic": "it is `driven` now",
    "sensors": "whole fields have no level with sensors now, version 0.2 has it",
}
_DESCRIPTION = (
    "Plans the field (headland rounds, lands, passes), lets the machines work until it is empty and all "
    "grain is at the truck, and says what the time went into. No two machines ever meet."
)


def add(parsers: Any) -> None:
    """Add the command and its verbs."""
    parser = parsers.add_parser("fleet", help="work off a whole field: combines, carts, a truck")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    run = verb(verbs, "run", "run a job until the field is empty", run_job, _DESCRIPTION)
    run.add_argument("job", metavar="NAME|FILE", help="bundled job, or a file of `format: swath fleet 1`")
    told = "write report.html, replay.html, picture, plan and results.json"
    add_folder(run, "job", *FILES, text=told, required=False)
    add_replace(run)
    add_sets(run, "change one key")
    told = "; ".join(f"{level}: {what}" for level, what in LEVELS.items())
    run.add_argument("--level", default="events", metavar="L", help=f"{told} (default events)")
    option(
        run, "--spread PERCENT",
        "at events: do it 24 times more, with speeds, yield and times at the truck up to so much off",
        type=float, unit="percent",
    )  # fmt: skip
    jobs = verb(verbs, "list", "list the bundled jobs; print one", run_list)
    jobs.add_argument("name", nargs="?", metavar="NAME", help="print this job, to make your own of it")


def run_job(args: argparse.Namespace) -> int:
    """Run a job, print its tables, write its report."""
    from swath.fleet.driven import driven
    from swath.fleet.files import base_of, read_job
    from swath.fleet.report import check_target, hour_rows, load_rows, result_rows, wait_rows, write_result
    from swath.fleet.search import best_of
    from swath.fleet.spread import DRAWS, spread_of
    from swath.fleet.worked import by_events, checked
    from swath.terminal.progress import steps
    from swath.terminal.tables import say, table, whole

    if args.level not in LEVELS:
        instead = f"; {GONE[args.level]}" if args.level in GONE else ""
        raise InputError("--level", args.level, f"expected {' or '.join(LEVELS)}{instead}")
    if args.spread is not None and args.level != "events":
        raise InputError("--spread", args.spread, f"expected the level events, not {args.level}")
    job, document = read_job(args.job, tuple(args.sets))
    changes = "; ".join(args.sets)
    if args.out is not None and not args.replace:
        check_target(args.out, job.name, changes)
    with steps(job.fleet.plans) as told:
        best, schedule = best_of(job, base_of(document), told)
    worked = driven(schedule) if args.level == "driven" else by_events(schedule)
    if args.spread is not None:
        with steps(DRAWS) as told:
            hours, refused = spread_of(best, base_of(document), args.spread, args.out, told)
        worked = replace(worked, draws=tuple(hours))
        schedule.notes.extend(f"a draw of the spread is refused: {why}" for why in refused)
    telling = [row for row in result_rows(worked) if row[1].strip("0.")]  # a 0 is left to the page
    table(f"{job.name}: {job.summary}", ("name", "value", "unit"), telling)
    table("hours of each machine", *hour_rows(worked))
    table("what each machine did", *load_rows(worked))
    table("what machines waited for", ("machine", "for", "min"), wait_rows(worked))
    for note in checked(worked):
        say(f"note: {note}")
    if args.out is not None:
        write_result(worked, job.name, job.summary, args.out, changes)
        for page in PAGES:
            say(whole(f"{page.partition('.')[0]}: {args.out / page}"))
    return 0


def run_list(args: argparse.Namespace) -> int:
    """Print a bundled job as it is, or name and summary of all."""
    from swath.documents.data_sheets import sheet_names
    from swath.fleet.files import job_sheet, read_job
    from swath.terminal.tables import paragraphs

    if args.name is not None:
        print(job_sheet(args.name).read_text(encoding="utf-8"), end="")
        return 0
    paragraphs([(name, read_job(name)[0].summary) for name in sheet_names("jobs")])
    return 0
