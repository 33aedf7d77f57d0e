"""`swath rerun`: a recorded run again, with recorded signals in the place of chosen slots."""

import argparse
from pathlib import Path
from typing import Any

from swath.core.number_text import num
from swath.terminal.options import add_replace, add_scenario_options, option, verb

PLACE = "look", 4  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "rerun", "run a recording again", run, _DESCRIPTION)
    option(parser, "source RUN", "a run folder, or its run.mcap", type=Path)
    option(
        parser,
        "--slots LIST",
        "slots that play the log, e.g. combine.lidar,odometry (default: motion and all sensors)",
    )
    add_scenario_options(parser)
    add_replace(parser)
    option(parser, "--quiet", "print nothing but the folder of the run")


def run(args: argparse.Namespace) -> int:
    """Exit code as of `swath run`; 0 too where slots differ from the recording."""
    from swath.runtime.folder import folder_for
    from swath.terminal.outcome import tell
    from swath.tools.rerun.rerun import plan_rerun

    slots = None if args.slots is None else [s.strip() for s in args.slots.split(",") if s.strip()]
    rerun = plan_rerun(args.source, slots=slots, sets=args.sets, seed=args.seed)
    out = folder_for(rerun.scenario, args.out, what="rerun", events=rerun.events, replace=args.replace)
    result = rerun.run(out, progress=not args.quiet)
    code = tell(result, out, quiet=args.quiet)
    if not args.quiet:
        _print_comparison(result.summary["rerun"])
    return code


def _print_comparison(rerun: dict[str, Any]) -> None:
    from swath.documents.data_sheets import viewer_layout
    from swath.terminal.tables import table

    rows = []
    for slot, found in rerun["slots"].items():
        result = "identical"
        if not found["identical"]:
            result = f"differs from {num(found['differs_from_s'])} s on ({found['differs_in']})"
        rows.append(
            (slot, str(found["samples"]), found["digest"][:12], found["recorded_digest"][:12], result)
        )
    print(f"layout  {viewer_layout()}, to look at run.mcap in Foxglove")
    print(f"played from the log: {', '.join(rerun['played']) or 'nothing'}")
    table("", ("slot", "samples", "digest", "recorded", "against the recording"), rows)


_DESCRIPTION = """Runs a recording again. The chosen slots play the recorded signals, all others are
computed: the open-loop test of a detector (`--set combine.edge.level=otsu`). Reports which of
the computed slots came out as recorded: docs/how-to/again.md."""
