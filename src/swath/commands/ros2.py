"""`swath ros2`: a run, or a recorded one, as ROS 2 topics."""

import argparse
from typing import Any

from swath.terminal import options


def add(parsers: Any) -> None:
    """Add the command and its verb."""
    parser = parsers.add_parser("ros2", help="a run, or a recorded one, as ROS 2 topics")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    bridge = verbs.add_parser(
        "bridge", help="publish a recorded run, or run a scenario in real time", description=_DESCRIPTION
    )
    bridge.add_argument("scenario", metavar="RUN|NAME|FILE", help="a run folder, a file .mcap, or a scenario")
    options.add_scenario_options(bridge)
    bridge.add_argument("--paused", action="store_true", help="a scenario: wait at the start for ~/pause")
    bridge.add_argument(
        "--factor", type=float, metavar="X", help="a recording: simulated seconds per second (default 1)"
    )
    bridge.set_defaults(run=run, ros2=True, real_time=True, quiet=False, events=None)


def run(args: argparse.Namespace) -> int:
    """Exit code: 0, for a scenario as of `swath run`."""
    from swath.core.errors import InputError
    from swath.link.ros2.player import play, recording_of

    file = recording_of(args.scenario)
    if file is None:
        if args.factor is not None:
            raise InputError("--factor", args.factor, "expected a recording, there is no run.mcap")
        from swath.commands import run

        return run.run(args)
    factor = 1.0 if args.factor is None else args.factor
    if not 0.01 <= factor <= 100.0:
        raise InputError("--factor", factor, "expected 0.01 to 100")
    print(f"{play(file, factor=factor)} messages of {file}")
    return 0


_DESCRIPTION = """Publish run.mcap of a run folder at its pace; or run a scenario in real time with its topics
and services, as `swath run --ros2 --real-time` does. A run folder that has a run.mcap is played."""
