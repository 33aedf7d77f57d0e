"""`swath fleet run JOB --level granted|driven`: a whole field on granted ground."""

import argparse
from dataclasses import replace

from swath.core.errors import InputError

LEVELS = ("granted", "driven")


def run_job(args: argparse.Namespace) -> int:
    """Run a job, print its tables, write its report."""
    from swath.fleet.driven import driven
    from swath.fleet.files import base_of, read_job
    from swath.fleet.report import check_target, machine_rows, result_rows, wait_rows, write_result
    from swath.fleet.schedule import schedule_of
    from swath.fleet.spread import DRAWS, spread_of
    from swath.fleet.worked import by_events, checked
    from swath.terminal.progress import steps
    from swath.terminal.tables import table, wide_console

    if args.shared_out:
        raise InputError("--shared-out", args.level, "expected the level events, kinematic or sensors")
    if args.spread is not None and args.level != "granted":
        raise InputError("--spread", args.spread, f"expected the level granted, not {args.level}")
    job, document = read_job(args.job, tuple(args.sets))
    if args.out is not None:
        check_target(args.out)
    schedule = schedule_of(job, base_of(document))
    worked = driven(schedule) if args.level == "driven" else by_events(schedule)
    if args.spread is not None:
        with steps(DRAWS) as told:
            hours, refused = spread_of(job, base_of(document), args.spread, args.out, told)
        worked = replace(worked, draws=tuple(hours))
        schedule.notes.extend(f"a draw of the spread is refused: {why}" for why in refused)
    table(f"{job.name}: {job.summary}", ("", "", ""), result_rows(worked))
    table("minutes of each machine", *machine_rows(worked))
    table("what machines waited for", ("machine", "for", "min"), wait_rows(worked))
    console = wide_console()
    for note in checked(worked):
        console.print(f"note: {note}", markup=False)
    if args.out is not None:
        write_result(worked, job.name, job.summary, args.out)
        console.print(f"written: {args.out}/report.html", markup=False)
    return 0
