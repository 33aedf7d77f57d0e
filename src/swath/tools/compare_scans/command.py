"""`swath compare scans`: two sets of scans of a crop, cell by cell."""

import argparse
from pathlib import Path
from typing import Any

from swath.terminal.options import add_folder, option

DESCRIPTION = """
Echoes of two recordings over one stand, or over stands of one kind, in cells along the path: how far
apart the heights are, how many beams come back from crop, how deep they go; and how much of that is
noise. A is what is trusted more. Run folders, .mcap, rosbag, .npz, .csv as for `swath height-map build`; .las
and .laz (extra las)."""


FILES = ("results.json", "profiles.png", "map.png", "report.html")


def add(verbs: Any) -> None:
    """Add the verb."""
    made = verbs.add_parser("scans", help="two sets of scans of a crop", description=DESCRIPTION)
    option(made, "a A", "scans that are trusted more", type=Path)
    option(made, "b B", "scans that are compared with them", type=Path)
    add_folder(made, "comparison", *FILES, text="write report, pictures and JSON", required=False)
    option(
        made,
        "--align",
        "by the poses (default), each along its own path, or by the poses and then ICP (extra mesh)",
        ("pose", "path", "icp"),
    )
    option(
        made,
        "--ground",
        "ground from the poses, or from the lowest echoes; of LAS always the latter",
        ("pose", "echoes"),
    )
    for key, unit, text in (
        ("cell", "M", "width of a cell across the path [m] (default 0.25)"),
        ("block", "M", "length of a block along the path [m] (default 2)"),
        ("reach", "M", "leave out echoes further from the path [m] (default 30)"),
        ("range-max", "M", "larger ranges are no echo [m] (default 200)"),
    ):
        made.add_argument(f"--{key}-m", type=float, metavar=unit, help=text)
    for which in "ab":
        made.add_argument(f"--scans-{which}", metavar="TOPIC", help=f"topic of the scans of {which.upper()}")
        made.add_argument(f"--poses-{which}", metavar="TOPIC|CSV", help="topic of its poses, or a table")
        mount = "where its scanner sits [m, deg]"
        made.add_argument(f"--mount-{which}", metavar="X,Y,Z,ROLL,PITCH,YAW", help=mount)
    origin = "without --field: origin of local metres [deg, m]"
    option(made, "--field DIR", "field folder whose metres fixes and LAS get", type=Path)
    option(made, "--origin LAT,LON[,HEIGHT]", origin)
    option(made, "--white A,B", "intensity of a white target in A and in B")
    option(made, "--json", "print all numbers and cells as JSON")
    made.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Compare, print, write."""
    from swath.documents.json_file import json_text
    from swath.terminal.progress import progress_bar
    from swath.terminal.tables import table
    from swath.tools.compare_scans.clouds import read_cloud
    from swath.tools.compare_scans.compare import Grid, compare_clouds
    from swath.tools.compare_scans.page import HEAD, number_rows, write_comparison

    grid = Grid(**{k: v for k in ("cell_m", "block_m") if (v := getattr(args, k)) is not None})
    white = _white(args.white)
    with progress_bar("comparing") as progress:
        a, b = (read_cloud(getattr(args, which), _reading(args, which)) for which in "ab")
        made = compare_clouds(
            a, b, grid=grid, align=args.align, white=white, progress=lambda share: progress(share, 1.0)
        )
    if args.json:
        print(json_text(made.to_dict()))
    else:
        table(f"{made.names[1]} against {made.names[0]}", HEAD, number_rows(made))
        for note in made.notes:
            print(f"note: {note}")
    if args.out is not None:
        write_comparison(made, args.out)
        if not args.json:
            print(f"written: {args.out}/report.html")
    return 0


def _reading(args: argparse.Namespace, which: str) -> Any:
    from swath.core.errors import InputError
    from swath.tools.compare_scans.clouds import Reading
    from swath.tools.height_map.command import local_of, mount_of
    from swath.tools.height_map.source import Wanted

    poses = getattr(args, f"poses_{which}")
    reach = 30.0 if args.reach_m is None else args.reach_m
    if not 1.0 <= reach <= 200.0:
        raise InputError("--reach-m", reach, "expected 1 to 200")
    if args.range_max_m is not None and not args.range_max_m > 0.0:
        raise InputError("--range-max-m", args.range_max_m, "expected a number above 0")
    is_table = bool(poses) and poses.endswith(".csv")
    wanted = Wanted(
        scans=getattr(args, f"scans_{which}"),
        poses=None if is_table else poses,
        mount=mount_of(getattr(args, f"mount_{which}"), f"--mount-{which}"),
        to_local=local_of(args.field, args.origin),
        **({} if args.range_max_m is None else {"range_max": args.range_max_m}),
    )
    return Reading(wanted, Path(poses) if is_table else None, args.ground, reach)


def _white(text: str | None) -> tuple[float, float] | None:
    from swath.core.errors import InputError
    from swath.core.typed_numbers import numbers_in

    if text is None:
        return None
    a, b = numbers_in("--white", text, ("",) * 2, "A,B")
    if not min(a, b) > 0.0:
        raise InputError("--white", text, "expected numbers above 0")
    return a, b
