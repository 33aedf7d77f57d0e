"""`swath compare scans`: two sets of scans of a crop, cell by cell."""

import argparse
from pathlib import Path
from typing import Any

from swath.core.errors import InputError, check_within
from swath.terminal.options import add_folder, option, verb

DESCRIPTION = """
Echoes of two recordings over one stand, or over stands of one kind, in cells along the path: how far
apart the heights are, how many beams come back from crop, how deep they go; and how much of that is
noise. A is what is trusted more. Run folders, .mcap, rosbag, .npz, .csv as for `swath height-map build`; .las
and .laz (extra las)."""


FILES = ("results.json", "profiles.png", "map.png", "report.html")


def add(verbs: Any) -> None:
    """Add the verb."""
    made = verb(verbs, "scans", "two sets of scans of a crop", run, DESCRIPTION)
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
    option(made, "--cell-m M", "width of a cell across the path [m]", 0.25)
    option(made, "--block-m M", "length of a block along the path [m]", 2.0)
    option(made, "--reach-m M", "leave out echoes further from the path [m]", 30.0)
    option(made, "--range-max-m M", "larger ranges are no echo [m]", 200.0)
    for which in "ab":
        option(made, f"--scans-{which} TOPIC", f"topic of the scans of {which.upper()}")
        option(made, f"--poses-{which} TOPIC|CSV", "topic of its poses, or a table")
        option(made, f"--mount-{which} X,Y,Z,ROLL,PITCH,YAW", "where its scanner sits [m, deg]")
    origin = "without --field: origin of local metres [deg, m]"
    option(made, "--field DIR", "field folder whose metres fixes and LAS get", type=Path)
    option(made, "--origin LAT,LON[,HEIGHT]", origin)
    option(made, "--white A,B", "intensity of a white target in A and in B")
    option(made, "--json", "print all numbers and cells as JSON")


def run(args: argparse.Namespace) -> int:
    """Compare, print, write."""
    from swath.documents.json_file import json_text
    from swath.terminal.progress import progress_bar
    from swath.terminal.tables import table
    from swath.tools.compare_scans.clouds import read_cloud
    from swath.tools.compare_scans.compare import Grid, compare_clouds
    from swath.tools.compare_scans.page import HEAD, number_rows, write_comparison

    grid = Grid(args.cell_m, args.block_m)
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
    from swath.tools.compare_scans.clouds import Reading
    from swath.tools.height_map.command import wanted_of

    check_within("--reach-m", args.reach_m, 1.0, 200.0)
    if not args.range_max_m > 0.0:
        raise InputError("--range-max-m", args.range_max_m, "expected a number above 0")
    return Reading(*wanted_of(args, f"-{which}"), args.ground, args.reach_m)


def _white(text: str | None) -> tuple[float, float] | None:
    from swath.core.typed_numbers import numbers_in

    if text is None:
        return None
    a, b = numbers_in("--white", text, ("",) * 2, "A,B")
    if not min(a, b) > 0.0:
        raise InputError("--white", text, "expected numbers above 0")
    return a, b
