"""`swath field export`: a field to take away, beside the other verbs of `swath field`."""

import argparse
from pathlib import Path
from typing import Any

from swath.core.errors import check_within
from swath.field_io import command as field
from swath.terminal.options import add_sets, load, made_of, option, verb

PLACE = "measured", 0  # among all commands
MB = 1e6


def add(parsers: Any) -> None:
    """Add the command `field` with all its verbs."""
    verbs = field.add(parsers)
    parser = verb(verbs, "export", "take a field to Gazebo, Blender, or as a survey", run, _DESCRIPTION)
    option(parser, "scenario FIELD", "a scenario, a run folder or a field folder")
    option(parser, "--to", "the form", choices=("sdf", "glb", "las"), required=True)
    option(parser, "--out F", "folder of sdf, file of the others", type=Path, required=True)
    add_sets(parser, "change the scenario, e.g. field.stand.crop=rye; may be given several times")
    option(parser, "--seed N", "another seed", type=int)
    option(parser, "--field-state FILE", "the field as a run left it (--save-field)")
    option(parser, "--at-s S", "after S seconds of driving", 0.0)
    option(parser, "--place X,Y", "the middle [m] (default: where the first machine meets the crop)")
    option(parser, "--ground-m L", "side of the square of ground", 60.0)
    option(parser, "--plants-m R", "radius with plants of sdf and glb (0 = none)", 3.0)
    option(parser, "--points-per-m2 N", "pulses of the survey, las", 50.0)
    option(parser, "--most-mb MB", "refuse to write more than that", 250.0)


def run(args: argparse.Namespace) -> int:
    """Say what comes and how large it is, then write it."""
    from swath.runtime.assembly import assemble
    from swath.runtime.loop import drive
    from swath.tools.field_export.export import Wanted, export

    for name, low, high in (
        ("ground_m", 5.0, 1000.0), ("plants_m", 0.0, 100.0), ("points_per_m2", 0.1, 1e5),
        ("at_s", 0.0, 1e5), ("most_mb", 1.0, 1e5),
    ):  # fmt: skip
        check_within(f"--{name.replace('_', '-')}", getattr(args, name), low, high)
    names = {"ground": "ground_m", "plants": "plants_m", "per_m2": "points_per_m2"}
    wanted = made_of(Wanted, args, names, place=_place(args.place), most=args.most_mb * MB)
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
    from swath.core.typed_numbers import numbers_in

    if text is None:
        return None
    x, y = numbers_in("--place", text, ("m",) * 2, "X,Y in metres")
    for value in (x, y):
        check_within("--place", value, -1e6, 1e6)
    return x, y


_DESCRIPTION = """Writes what lies around a place of a field: the ground, plants within a radius, what is cut,
straw, obstacles and machines, as they stand. sdf: a world for Gazebo Harmonic; glb: for Blender and others;
las: points of a virtual survey (LAZ where the name ends so). Says how large it becomes before it writes."""
