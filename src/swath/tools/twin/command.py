"""`swath twin`: recorded scans become a scenario with intervals, and other recordings say whether it fits."""

import argparse
from pathlib import Path
from typing import Any

from swath.core.errors import check_within
from swath.terminal.options import add_folder, add_sets, option, verb
from swath.tools.function_test.progress import add_engine, engine, progress

PLACE = "measured", 4  # among all commands
_FIT = """Density, height, stubble, mounting, dust and the scanner itself, each with an interval, by a bank of
simulations that is made once for a scanner on a machine and asked often. What the scans do not say is not
known. Writes twin.yaml, a scenario."""
_CHECK = """Asks the bank of a twin about another recording of the same field: whether it says the same, and
looks like the bank at all. Simulates the twin and compares as `swath compare scans` does, on a page, and as
evidence."""


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("twin", help="a scenario of your own recordings, and whether it fits others")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    fit = verb(verbs, "fit", "what recorded scans say of crop, mounting and scanner", run_fit, _FIT)
    option(fit, "bags BAG", "recordings of one pass each: as of `swath compare scans`", type=Path, nargs="+")
    option(fit, "--sheet NAME|FILE", "data sheet of the scanner", required=True)
    option(fit, "--bank DIR", "folder of the bank, which is made where it is not there", Path("twin-bank"))
    option(fit, "--runs N", "simulations of the bank", 700)
    option(fit, "--scenario NAME|FILE", "what is simulated: machine, crop, ground", "straight")
    add_sets(fit, "change that scenario: crop, side of the edge")
    option(
        fit, "--param KEY=RANGE", "another range of what is asked of, as of `swath tune`; several times", []
    )
    option(fit, "--seed N", "seed of the draws", 1)
    add_folder(fit, "twin", "twin.*", text="folder of the twin")
    _add_source(fit)
    add_engine(fit)
    check = verb(verbs, "check", "whether another recording looks like a twin", run_check, _CHECK)
    option(check, "twin TWIN", "folder that `swath twin fit` wrote, or twin.yaml in it", type=Path)
    option(check, "bag BAG", "a recording that it was not made of", type=Path)
    option(check, "--draws N", "with --still: simulations of what the twin says", 60)
    option(check, "--seed N", "with --still: seed of the draws", 1)
    add_folder(check, "check of a twin", text="folder of the page", alone=False)
    _add_source(check)


def _add_source(made: argparse.ArgumentParser) -> None:
    option(made, "--still", "the scanner stood still: no poses; of crop nothing is said")
    option(made, "--scans TOPIC", "topic of the scans")
    option(made, "--poses TOPIC|CSV", "topic of the poses, or a table")
    option(made, "--mount X,Y,Z,ROLL,PITCH,YAW", "where the scanner sits, as far as it is known [m, deg]")
    option(made, "--range-max-m M", "larger ranges are no echo [m]", 200.0)
    option(made, "--field DIR", "field folder whose local metres fixes get", type=Path)
    option(made, "--origin LAT,LON[,HEIGHT]", "without --field: origin of local metres [deg, m]")


def _sources(args: argparse.Namespace, paths: list[Path]) -> list[Any]:
    from swath.tools.height_map.build import open_source
    from swath.tools.height_map.command import wanted_of

    wanted, table = wanted_of(args, is_still=args.still)
    return [open_source(path, wanted, table) for path in paths]


def run_fit(args: argparse.Namespace) -> int:
    """Make the bank where it is not there, ask it, write the twin."""
    from swath.core.number_text import num, percent_of
    from swath.core.process.shell import command
    from swath.terminal.tables import table
    from swath.tools.twin.fit import HEAD, SCENARIO, fit_twin
    from swath.tools.twin.still import fit_still

    check_within("--seed", args.seed, 0, 2**31 - 1)
    sources = _sources(args, args.bags)
    if args.still:
        found, answer = fit_still(args.out, sources, args.sheet, args.seed)
    else:
        more = {name: getattr(args, name) for name in ("scenario", "runs", "seed")}
        more |= {"params": tuple(args.param), "sets": tuple(args.sets)}
        with engine(args.cluster, args.workers) as client:
            place = args.out, sources, args.sheet, args.bank
            twin = fit_twin(*place, max(1, args.workers), progress, client, **more)
        found, answer = list(twin.estimates), twin.answer
        if not answer.is_stray and twin.unlike.over > 1.0:
            wider = f"intervals are {num(twin.unlike.over)} times as wide"
            print(f"{percent_of(twin.unlike.share)} of the bank are as unlike the rest of it: {wider}.")
    table("", HEAD, [e.row for e in found])
    if answer.is_stray:
        print("These scans look like none of the bank: nothing of it is known.")
    print(f"try it  {command('run', args.out / SCENARIO)}")
    print(f"check   {command('twin', 'check', args.out, 'OTHER_BAG', '--out', 'DIR')}")
    return 0


def run_check(args: argparse.Namespace) -> int:
    """Simulate, compare, write page and evidence. Exit code 0 fits, 1 does not, 3 too little is known."""
    from swath.tools.twin.check import check_twin
    from swath.tools.twin.fit import read_twin
    from swath.tools.twin.page import write_check
    from swath.tools.twin.still import check_still, is_still

    check_within("--draws", args.draws, 20, 1e6)
    check_within("--seed", args.seed, 0, 2**31 - 1)
    stood = is_still(args.twin)
    args.still = args.still or stood
    source = _sources(args, [args.bag])[0]
    if stood:
        found = check_still(args.twin, source, args.draws, args.seed)
    else:
        found = check_twin(args.out, read_twin(args.twin), source)
    page = write_check(args.out, found)
    print(f"verdict {found.verdict}")
    for line in found.lines:
        print(line)
    print(f"report  {page}")
    return found.exit_code
