"""`swath field export`: a field to take away, beside the other verbs of `swath field`."""

import argparse
from pathlib import Path
from typing import Any

from swath.field_io import command as field
from swath.terminal.options import add_sets, load

MB = 1e6


def add(parsers: Any) -> None:
    """Add the command `field` with all its verbs."""
    verbs = field.add(parsers)
    parser = verbs.add_parser(
        "export", help="take a field to Gazebo, Blender, or as a survey", description=_DESCRIPTION
    )
    parser.add_argument("scenario", metavar="FIELD", help="a scenario, a run folder or a field folder")
    parser.add_argument("--to", choices=("sdf", "glb", "las"), required=True, help="the form")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="F", help="folder of sdf, file of the others"
    )
    add_sets(parser, "change the scenario, e.g. field.stand.crop=rye; may be given several times")
    parser.add_argument("--seed", metavar="N", help="another seed")
    parser.add_argument("--field-state", metavar="FILE", help="the field as a run left it (--save-field)")
    parser.add_argument("--at-s", type=float, default=0.0, metavar="S", help="after S seconds of driving")
    parser.add_argument(
        "--place", metavar="X,Y", help="the middle [m] (default: where the first machine meets the crop)"
    )
    parser.add_argument(
        "--ground-m", type=float, default=60.0, metavar="L", help="side of the square of ground (60)"
    )
    parser.add_argument(
        "--plants-m",
        type=float,
        default=3.0,
        metavar="R",
        help="radius with plants of sdf and glb (3; 0 = none)",
    )
    parser.add_argument(
        "--points-per-m2", type=float, default=50.0, metavar="N", help="pulses of the survey, las (50)"
    )
    parser.add_argument(
        "--most-mb", type=float, default=250.0, metavar="MB", help="refuse to write more than that (250)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Say what comes and how large it is, then write it."""
    from swath.core.errors import InputError
    from swath.runtime.assembly import assemble
    from swath.runtime.loop import drive
    from swath.tools.field_export.export import Wanted, export

    for name, low, high in (
        ("ground_m", 5.0, 1000.0), ("plants_m", 0.0, 100.0), ("points_per_m2", 0.1, 1e5),
        ("at_s", 0.0, 1e5), ("most_mb", 1.0, 1e5),
    ):  # fmt: skip
        if not low <= getattr(args, name) <= high:
            flag = f"--{name.replace('_', '-')}"
            raise InputError(flag, getattr(args, name), f"expected {low:g} to {high:g}")
    wanted = Wanted(
        args.to,
        args.out,
        _place(args.place),
        args.ground_m,
        args.plants_m,
        args.points_per_m2,
        args.most_mb * MB,
    )
    scenario = load(args)
    world = assemble(scenario)
    try:
        drive(world, [], until_s=args.at_s)
        for file in export(world, wanted, tell=lambda text: print(text, flush=True)):
            print(file)
    finally:
        world.close()
    return 0


def _place(text: str | None) -> tuple[float, float] | None:
    """Two numbers from the command line."""
    from swath.core.errors import InputError

    if text is None:
        return None
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x = y = float("nan")
    if not (abs(x) <= 1e6 and abs(y) <= 1e6):
        raise InputError("--place", text, "expected two numbers X,Y in metres")
    return x, y


_DESCRIPTION = """Writes what lies around a place of a field: the ground, plants within a radius, what is cut,
straw, obstacles and machines, as they stand. sdf: a world for Gazebo Harmonic; glb: for Blender and others;
las: points of a virtual survey (LAZ where the name ends so). Says how large it becomes before it writes."""
