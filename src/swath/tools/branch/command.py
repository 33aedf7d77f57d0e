"""`swath branch`: go back in a run, change something, continue from there."""

import argparse
import sys
from pathlib import Path
from typing import Any

from swath.core.number_text import num
from swath.terminal.options import add_allow, add_replace, add_run_folder, add_sets, option, verb

PLACE = "look", 3  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(
        parsers, "branch", "go back in a run, change something, continue from there", run, _DESCRIPTION
    )
    option(parser, "folder RUN", "a run folder", type=Path)
    option(parser, "--at-s S", "time of the change", type=float, required=True)
    add_sets(parser, "what changes from then on, e.g. combine.speed.speed_kmh=5; may be given several times")
    add_run_folder(parser)
    add_replace(parser)
    add_allow(parser)
    option(parser, "--save-every-s S", "as in swath run", type=float)
    option(parser, "--no-replay", "do not write replay.html")
    option(parser, "--quiet", "print nothing but the folder of the run")


def run(args: argparse.Namespace) -> int:
    """Exit code as of `swath run`."""
    from swath.core.errors import InputError
    from swath.runtime.folder import folder_for, remove_empty
    from swath.terminal.outcome import tell
    from swath.tools.branch.branch import pairs, plan_branch

    plan = plan_branch(args.folder, args.at_s, pairs(args.sets), args.allow)
    scenario = plan.scenario
    out = folder_for(scenario, args.out, what="branch", events=plan.events, replace=args.replace)
    if plan.has_unreadable:
        print("swath: saves of another version of swath, or damaged ones, are not read", file=sys.stderr)
    if not args.quiet:
        again = f"{args.folder} holds no saved state to begin with (swath run --save-every-s)"
        goes_on = f"going on from its save at {num(plan.saved_s)} s"
        print(goes_on if plan.saved_s else f"{again}, so it is computed again from 0 s", flush=True)
    try:
        result = plan.run(
            out, progress=not args.quiet, save_every_s=args.save_every_s, replay=not args.no_replay
        )
    except InputError as error:
        remove_empty(out)
        raise scenario.locate(error) from error
    return tell(result, out, quiet=args.quiet, evaluators=scenario.evaluators)


_DESCRIPTION = """Run a finished run again from one of its moments on, with something changed there, into a
new folder: sample by sample what swath run --events gives with that change. Saves of the run (swath
run --save-every-s) save the time up to that moment: docs/how-to/again.md."""
