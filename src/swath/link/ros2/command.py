"""`swath ros2`: a recorded run as ROS 2 topics, and swath's own message types."""

import argparse
from pathlib import Path
from typing import Any

from swath.terminal.options import add_ros2_network, option, verb

PLACE = "connect", 0  # among all commands


def add(parsers: Any) -> None:
    """Add the command and its verb."""
    parser = parsers.add_parser("ros2", help="a recorded run as ROS 2 topics; swath's message types")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    play = verb(verbs, "play", "publish a recorded run at its pace", run_play, _DESCRIPTION)
    option(play, "source RUN", "a run folder, or its run.mcap", type=Path)
    option(play, "--factor X", "simulated seconds per second", 1.0)
    add_ros2_network(play)
    text = "write swath_msgs, the package of swath's own message types, for colcon to build"
    package = verb(verbs, "package", text, run_package, text)
    option(package, "--out DIR", "where to write (default: here)", Path())


def run_play(args: argparse.Namespace) -> int:
    """Publish the recording, print how many messages it had."""
    from swath.core.errors import InputError
    from swath.link.ros2.player import find_recording, play

    if not 0.01 <= args.factor <= 100.0:
        raise InputError("--factor", args.factor, "expected 0.01 to 100")
    file = find_recording(args.source)
    print(f"{play(file, factor=args.factor)} messages of {file}")
    return 0


def run_package(args: argparse.Namespace) -> int:
    """Write the package, print its folder."""
    from swath.link.ros2.message_package import write_package

    files = write_package(args.out)
    print(
        f"{files[0].parent}  {len(files) - 2} message types; build it with `colcon build` in your workspace"
    )
    return 0


_DESCRIPTION = """Publishes run.mcap of a run folder at its pace, with /clock. A scenario publishes its
topics while it is driven: `swath run SCENARIO --ros2`, with `--real-time` at real-time pace."""
