"""`swath fleet`: a whole field worked off by combines, carts and a truck; a recorded day predicted."""

import argparse
import math
from pathlib import Path
from typing import Any

from swath.terminal.options import add_sets


def add(parsers: Any, others: dict[str, Any]) -> None:
    """Add the command and its verbs. others: levels, and what runs a job at them"""
    parser = parsers.add_parser("fleet", help="work off a whole field: combines, carts, a truck")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    run = verbs.add_parser("run", help="run a job until the field is empty", description=_DESCRIPTION)
    run.add_argument("job", metavar="NAME|FILE", help="bundled job, or a file of `format: swath fleet 1`")
    run.add_argument("--out", type=Path, metavar="DIR", help="write report.html, picture and results.json")
    add_sets(run, "change one key")
    run.add_argument(
        "--level", default="events", metavar="L",
        help="events (default), kinematic or sensors; on granted ground, where machines never meet: granted "
        "(hours alone), driven (bodies)",
    )  # fmt: skip
    run.add_argument(
        "--spread", type=float, metavar="PERCENT",
        help="at events and granted: do it 24 times more, speeds up to so much off; granted: crop, too",
    )  # fmt: skip
    run.add_argument(
        "--shared-out", action="store_true",
        help="share passes out among combines before the job, with turns and who waits where, as at sensors",
    )  # fmt: skip
    run.set_defaults(run=run_job, others=others)
    jobs = verbs.add_parser("list", help="list the bundled jobs; print one")
    jobs.add_argument("name", nargs="?", metavar="NAME", help="print this job, to make your own of it")
    jobs.set_defaults(run=run_list)
    day = verbs.add_parser("day", help="a recorded day, predicted from its first hour")
    day.add_argument("log", type=Path, metavar="LOG", help="yield log (CSV, shapefile, ISOXML)")
    day.add_argument("--known-h", type=float, default=1.0, metavar="H", help="hours that are known (1)")
    day.add_argument("--machine", default="lexion-700", metavar="M", help="data sheet: steering, wheelbase")
    day.add_argument("--radius-m", type=float, default=6.4, metavar="R", help="of its turns [m] (6.4)")
    day.add_argument("--number", type=int, default=0, metavar="N", help="machine of the log, from 0 (0)")
    day.set_defaults(run=run_day)


_DESCRIPTION = (
    "Plans the field (opening rounds, lands, passes), lets the machines work until it is empty and all grain "
    "is at the truck, and says what the time went into."
)


def run_job(args: argparse.Namespace) -> int:
    """Run a job, print its tables, write its report."""
    if args.level in args.others:
        return int(args.others[args.level](args))
    from swath.core.errors import InputError
    from swath.job.fleet import base_of, read_fleet
    from swath.terminal.tables import table, wide_console
    from swath.tools.fleet.page import (
        check_target,
        contact_rows,
        machine_rows,
        result_rows,
        standoff_rows,
        write_result,
    )

    file, document = read_fleet(args.job, tuple(args.sets))
    if args.out is not None:
        check_target(args.out)
    if args.spread is not None and args.level != "events":
        raise InputError("--spread", args.spread, f"expected the level events, not {args.level}")
    result = _result(file, base_of(document), args)
    table(f"{file.name}: {file.summary}", ("", "", ""), result_rows(result))
    head, rows = machine_rows(result)
    table("minutes of each machine", head, rows)
    if result.contacts:
        heads = ("pair", "least clearance m", "touched s", "contacts")
        table("bodies of two machines", heads, contact_rows(result))
    if result.standoffs:
        heads = ("at", "machines", "place m", "made room")
        table("standoffs", heads, standoff_rows(result))
    console = wide_console()
    for note in result.notes:
        console.print(f"note: {note}", markup=False)
    if args.out is not None:
        write_result(result, args.out)
        console.print(f"written: {args.out}/report.html", markup=False)
    return 0


def _result(file: Any, base: Path | None, args: argparse.Namespace) -> Any:
    """At one of the levels; with sensors the run has its own folder."""
    from swath.job.work import work_off

    shares = _share_out() if args.shared_out else None
    if args.spread is not None:
        return _with_spread(file, base, args.spread, shares)
    if args.level != "sensors":
        return work_off(file, base, args.level, shares)
    from swath.core.whole_file import no_link
    from swath.tools.fleet.whole import with_sensors

    return with_sensors(file, base, None if args.out is None else no_link(args.out / "run"))[0]


def _share_out() -> Any:
    from swath.tools.fleet.work_plan import share_out

    return share_out


def _with_spread(file: Any, base: Path | None, percent: float, share_out: Any) -> Any:
    from dataclasses import replace

    from swath.job.machines import fleet_of
    from swath.job.spread import DRAWS, spread_of
    from swath.job.work import plan_of, work_off
    from swath.terminal.progress import steps

    fleet = fleet_of(file, base)
    plan: Any = plan_of(file, fleet, base)
    if share_out is not None:
        plan = share_out(file, plan, fleet)
    with steps(DRAWS) as told:
        spread = spread_of(file, plan, fleet, percent, told)
    known = None if share_out is None else lambda *_: plan
    return replace(work_off(file, base, share_out=known), spread=spread)


def run_list(args: argparse.Namespace) -> int:
    """Print a bundled job as it is, or name and summary of all."""
    from swath.documents.data_sheets import find_sheet, sheet_names
    from swath.job.fleet import read_fleet
    from swath.terminal.tables import paragraphs

    if args.name is not None:
        print(find_sheet("jobs", args.name).read_text(encoding="utf-8"), end="")
        return 0
    paragraphs([(name, read_fleet(name)[0].summary) for name in sheet_names("jobs")])
    return 0


def run_day(args: argparse.Namespace) -> int:
    """Predict the rest of a recorded day."""
    from swath.core.errors import InputError
    from swath.job.recorded import predict, read_day
    from swath.job.turns import limits_of
    from swath.machine.machine_sheet import dynamics_of, load_machine
    from swath.terminal.tables import table, wide_console

    if not 0.05 <= args.known_h <= 24.0:
        raise InputError("--known-h", args.known_h, "expected 0.05 to 24")
    if not 3.0 <= args.radius_m <= 50.0:
        raise InputError("--radius-m", args.radius_m, "expected 3 to 50")
    sheet = load_machine(args.machine)
    limits = limits_of(sheet.wheelbase, args.radius_m, dynamics_of(sheet).steer_rate, 2.0)
    day = read_day(args.log, limits, args.number)
    made = predict(day, 3600.0 * args.known_h)
    rows = [
        _row("cutting, of the rest", made.cutting, made.cutting_recorded),
        _row("between passes, of the rest", made.turning, made.turning_recorded),
        _row("in all, with the recorded stops", made.total, made.total_recorded),
    ]
    table(f"{args.log.name}: {len(day.lines)} passes", ("", "predicted h", "recorded h", "off %"), rows)
    known = [
        ("speed in the crop", f"{made.speed:.2f} m/s"),
        ("speed between passes", "-" if day.unseen else f"{made.turn_speed:.2f} m/s"),
        ("driven over planned way there", "-" if day.unseen else f"{made.longer:.3f}"),
        ("stops in all", f"{day.stops / 3600.0:.2f} h"),
    ]
    table(f"from the first {args.known_h:g} h", ("", ""), known)
    if day.unseen:
        wide_console().print(f"note: time between passes is not predicted: {day.unseen}", markup=False)
    return 0


def _row(name: str, found: float, recorded: float) -> tuple[str, str, str, str]:
    if math.isnan(found):
        return name, "-", "-", "-"
    off = 100.0 * (found / recorded - 1.0) if recorded > 0.0 else math.nan
    return name, f"{found / 3600.0:.2f}", f"{recorded / 3600.0:.2f}", f"{off:+.1f}"
