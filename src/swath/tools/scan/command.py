"""`swath scan`: one scan of a scenario, as a picture and a file."""

import argparse
import sys
from typing import Any

from swath.terminal.options import add_replace, add_scenario_options, load, option, verb

PLACE = "start", 7  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "scan", "one scan of a scenario, as a picture and a file", run)
    option(parser, "scenario NAME|FILE", "a bundled scenario, or a YAML file")
    add_scenario_options(parser)
    add_replace(parser)
    option(parser, "--at-s S", "after S seconds of driving (default: where it starts)", 0.0)
    option(parser, "--format LIST", "what to write, of png,csv,npz,ply,las,laz (default: the first four)")
    option(parser, "--camera", "what the camera sees too; a scenario without one gets the default camera")


def run(args: argparse.Namespace) -> int:
    """Make the scan, print where its files are."""
    from swath.core.errors import InputError, check_within
    from swath.runtime.folder import choose_scan_folder, scan_of

    at = args.at_s
    check_within("--at-s", at, 0.0, 1e5)
    scenario = _with_camera(args) if args.camera else load(args)
    out = choose_scan_folder(
        scenario.name, scenario.seed, args.out, of=scan_of(scenario, at), replace=args.replace
    )
    from swath.tools.scan import scan

    formats = None if args.format is None else [name.strip() for name in args.format.split(",")]
    try:
        notes: list[str] = []
        files = scan.scan_job(scenario, out, at_s=at, formats=formats, camera=args.camera, tell=notes.append)
        for file in files:
            print(file)
        for note in notes:
            print(f"note    {note}", file=sys.stderr)
    except InputError as error:
        raise scenario.locate(error) from error
    return 0


def _with_camera(args: argparse.Namespace) -> Any:
    """The scenario; its scanning machine gets a camera where it has none."""
    from swath.tools.scan.scan import first_of_kind, seeing_machine

    scenario = load(args)
    name, _ = seeing_machine(scenario)
    if first_of_kind("camera", scenario.machines[name].slots) is None:
        args.sets = [*args.sets, f"{name}.camera=rays"]
        scenario = load(args)
    return scenario
