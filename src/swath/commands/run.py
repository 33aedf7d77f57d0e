"""`swath run`: drive a scenario."""

import argparse
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from shlex import quote
from typing import Any

from swath.terminal.options import (
    add_allow,
    add_replace,
    add_ros2_network,
    add_scenario_options,
    load,
    option,
    verb,
)
from swath.terminal.outcome import tell

PLACE = "start", 0  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "run", "run a scenario, write a run folder", run, _DESCRIPTION)
    option(parser, "scenario NAME|FILE", "a bundled scenario, a YAML file, or a run folder")
    add_scenario_options(parser)
    add_replace(parser)
    option(parser, "--real-time", "at the pace of real time (section realtime)")
    option(
        parser,
        "--device SLOT=ADDRESS",
        "serve a slot as a device, e.g. lidar=lms://127.0.0.1:2111; several times",
        [],
        dest="devices",
    )
    option(parser, "--ros2", "publish everything as ROS 2 topics, offer services (extra ros2)")
    add_ros2_network(parser)
    option(
        parser,
        "--isobus INTERFACE:CHANNEL",
        "the machine as a node of a CAN bus: engine, speeds, header, task controller client (extra can)",
        nargs="?",
        const="",
    )
    option(parser, "--view", "serve a page to watch and control the run, on this machine alone (extra view)")
    option(
        parser,
        "--foxglove HOST:PORT",
        "serve everything to Foxglove over a WebSocket, on this machine alone (extra foxglove)",
        nargs="?",
        const="127.0.0.1:8765",
    )
    option(parser, "--paused", "with --ros2 or --view: wait at the start for ~/pause or the page")
    option(
        parser,
        "--events RUN",
        "repeat the changes made while an earlier run was driven (its folder)",
        type=Path,
    )
    add_allow(parser)
    option(parser, "--field-state FILE", "start on the field as a run left it (key field.state_file)")
    option(parser, "--save-field FILE", "write the state of the field after the run, a .npz", type=Path)
    option(
        parser,
        "--save-every-s S",
        "save the world every S simulated seconds, for swath branch (default: 0 = never; with --view 5)",
        type=float,
    )
    option(parser, "--defaults", "print all default values in use")
    parser.add_argument("--no-defaults", action="store_true", help=argparse.SUPPRESS)  # of version 0.1
    option(parser, "--no-report", "do not write report.html")
    option(parser, "--no-replay", "do not write replay.html")
    option(parser, "--quiet", "print nothing but the folder of the run")


def run(args: argparse.Namespace) -> int:
    """Exit code: 0 all limits pass, 1 a limit fails, 3 none fails but one was not measured or judged."""
    from swath.core.errors import InputError, SwathError
    from swath.core.process.shell import command
    from swath.judge.summary import read_summary
    from swath.runtime.folder import folder_for, remove_empty

    if args.paused and not (args.ros2 or args.view):
        raise InputError(
            "--paused",
            None,
            "expected together with --ros2 or --view: a ROS 2 service call, or the page, starts a paused run",
        )
    scenario = load(args)
    from swath.runtime.changes import read_events

    events = read_events(args.events) if args.events is not None else []
    out = folder_for(scenario, args.out, events=events, replace=args.replace)
    from swath.runtime.job import run_job
    from swath.runtime.saves import EVERY_S, Saves, SavesField
    from swath.scenario.scenario import code_of

    if args.events is None and (changed := _changed_on_the_way(args.scenario)) is not None:
        how = f"--events {quote(str(changed))}"
        print(f"swath: {changed} was changed on its way, {how} repeats that", file=sys.stderr)
    if not args.quiet and (code := code_of(scenario)):
        print(f"code that runs with your rights: {', '.join(map(str, code))}", flush=True)
    pages = [] if scenario.run.record == "none" else _pages(args)
    begun = None if args.quiet or args.no_defaults else partial(print_defaults, scenario, whole=args.defaults)
    try:
        saves: list[Any] = [] if args.save_field is None else [SavesField(args.save_field)]
        every_s = args.save_every_s if args.save_every_s is not None else EVERY_S if args.view else 0.0
        saves += [Saves(every_s)] if every_s else []
        with _steered(args, saves, is_paced=scenario.is_paced) as steering, _on_bus(args) as bus:
            result = run_job(
                scenario,
                out,
                progress=not args.quiet,
                events=events,
                hooks=[*steering, *bus, *saves, *pages],
                begun=begun,
                allow=args.allow,
            )
            out = result.folder
    except SwathError as error:
        remove_empty(out)
        raise (scenario.locate(error) if isinstance(error, InputError) else error) from error
    except KeyboardInterrupt as error:
        file = out / "summary.json"
        has_samples = os.path.isfile(file) and read_summary(file).get("simulated_s", 0.0) > 0.0
        kept = f"; what was recorded is in {out}, to look at: {command('report', out)}" if has_samples else ""
        raise type(error)(f"stopped{kept or ' before its first step' * os.path.isfile(file)}") from None
    return tell(result, out, quiet=args.quiet, evaluators=scenario.evaluators)


def _changed_on_the_way(source: str) -> Path | None:
    """The folder of a run with events, where the scenario is that of a run."""
    from swath.core.errors import InputError
    from swath.runtime.changes import read_events
    from swath.scenario.scenario import find_scenario

    file = find_scenario(source)
    is_of_a_run = file.name == "scenario.yaml" and os.path.isfile(file.with_name("summary.json"))
    try:
        return file.parent if is_of_a_run and read_events(file.parent) else None
    except InputError:
        return None  # a summary that nobody asked for


def _pages(args: argparse.Namespace) -> list[Any]:
    """What writes the pages of a run."""
    pages: list[Any] = []
    if not args.no_report:
        from swath.report.report import ReportWriter

        pages.append(ReportWriter())
    if not args.no_replay:
        from swath.replay.writer import ReplayWriter

        pages.append(ReplayWriter())
    return pages


def print_defaults(scenario: Any, *, whole: bool = True) -> None:
    """Print every default value in use, a paragraph per slot; or in one line how many slots have some."""
    from swath.scenario.defaults import paragraphs as by_slot
    from swath.terminal.tables import paragraphs

    items = by_slot(scenario)
    if items and whole:
        print(f"defaults in use, not written in {scenario.name} (meanings: swath levels SLOT):", flush=True)
        paragraphs(items)
    elif items:
        print(
            f"{len(items)} slots use default values: --defaults prints them, the report marks them",
            flush=True,
        )


@contextmanager
def _steered(args: argparse.Namespace, saves: list[Any], *, is_paced: bool) -> Iterator[list[Any]]:
    """The ROS 2 bridge with --ros2, the page with --view, both over one run control; --foxglove looks on."""
    if not (args.ros2 or args.view or args.foxglove):
        yield []
        return
    from swath.runtime.run_control import RunControl
    from swath.runtime.saves import Saves

    with ExitStack() as stack:
        control = RunControl(
            is_paused=args.paused,
            speed=1.0 if args.view and not is_paced else 0.0,
            saves=next((hook for hook in saves if isinstance(hook, Saves)), None),
        )
        hooks: list[Any] = []
        if args.ros2:
            from swath.link.ros2.bridge import Bridge

            hooks.append(Bridge(control=control))
            stack.callback(hooks[-1].close)
            if args.paused and not args.quiet:
                call = "ros2 service call /swath/pause std_srvs/srv/SetBool '{data: false}'"
                print(f"paused before the first tick, start it with: {call}", file=sys.stderr)
        if args.foxglove:
            from swath.link.foxglove import Foxglove

            hooks.append(Foxglove(args.foxglove))
            stack.callback(hooks[-1].close)
            print(f"Foxglove WebSocket at {hooks[-1].address}", file=sys.stderr, flush=True)
        if args.view:
            from swath.replay.live.view import LiveView

            hooks.append(LiveView(control))
            stack.callback(hooks[-1].close)
            print(f"watch and control it at {hooks[-1].address}", file=sys.stderr, flush=True)
        yield hooks


@contextmanager
def _on_bus(args: argparse.Namespace) -> Iterator[list[Any]]:
    """The machine on a CAN bus with --isobus."""
    if args.isobus is None:
        yield []
        return
    from swath.core.errors import InputError
    from swath.link.can.bus import Where, check_bus
    from swath.link.can.isobus import IsobusMachine
    from swath.link.can.steering import Params

    interface, colon, channel = args.isobus.partition(":")
    if args.isobus and not (interface and colon and channel):
        raise InputError("--isobus", args.isobus, "expected INTERFACE:CHANNEL, such as socketcan:can0")
    machine = IsobusMachine(check_bus(Where(interface, channel, {}) if args.isobus else Params().where))
    try:
        yield [machine]
    finally:
        machine.close()


_DESCRIPTION = """Run a scenario. Exit code: 0 all limits pass, 1 a limit fails, 2 bad input,
3 no limit fails but one was not measured (in a run of 10 m or less) or not judged (it rests on a level
outside the range in which it was checked),
130 stopped by Ctrl-C and 143 by SIGTERM (the folder then holds what was recorded, marked incomplete)."""
