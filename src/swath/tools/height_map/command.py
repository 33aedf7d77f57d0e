"""`swath height-map`: recorded scans become the height map that the LiDAR level `replay` looks at."""

import argparse
from pathlib import Path
from typing import Any

from swath.core.number_text import num
from swath.terminal.options import option

PLACE = "measured", 1  # among all commands


def add(parsers: Any) -> None:
    """Add the command and its verb."""
    parser = parsers.add_parser("height-map", help="recorded scans become a map of crop heights")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    made = verbs.add_parser("build", help="make a map from recorded scans", description=_DESCRIPTION)
    option(made, "source SOURCE", "run folder, .mcap, rosbag, .npz or .csv", type=Path)
    option(made, "--out FILE.npz", "the file to make", type=Path, required=True)
    option(made, "--scans TOPIC", "topic of the scans")
    option(made, "--poses TOPIC|CSV", "topic of the poses, or a table of them")
    option(
        made,
        "--mount X,Y,Z,ROLL,PITCH,YAW",
        "where the scanner sits [m, deg], seen from the poses (default: from /tf_static, or 0)",
    )
    option(made, "--field DIR", "field folder whose local metres GNSS fixes are converted to", type=Path)
    option(
        made,
        "--origin LAT,LON[,HEIGHT]",
        "without --field: origin of the local metres [deg, m] (default: the first fix)",
    )
    option(made, "--antenna X,Y,Z", "where the receiver sits on the machine [m] (default: 0,0,0)")
    option(
        made, "--ground", "ground from the poses alone, or corrected by the lowest echoes", ("pose", "echoes")
    )
    for key, unit, text in (
        ("cell", "M", "side of a cell [m] (default 0.05)"),
        ("along", "M", "length along the path whose heights share a distribution [m] (default 0.5)"),
        ("across", "M", "width across the path, likewise [m] (default 0.05)"),
        ("fill", "M", "a cell this near to an echo counts as measured [m] (default 0.1)"),
        ("reach", "M", "leave out echoes further from the path [m] (default 30)"),
        ("range-min", "M", "smaller ranges are no echo [m] (default 0.05)"),
        ("range-max", "M", "larger ranges are no echo [m] (default 200)"),
    ):
        made.add_argument(f"--{key}-m", type=float, metavar=unit, help=text)
    option(made, "--per-cell N", "heights kept per cell (default 32)", type=int)
    option(made, "--picture PNG", "the picture (default: beside the file)", type=Path)
    made.set_defaults(run=run_build)


def run_build(args: argparse.Namespace) -> int:
    """Make the file and its picture, say what is in it."""
    from swath.core.errors import InputError
    from swath.terminal.progress import progress_bar
    from swath.tools.height_map.build import Settings, build_height_map, open_source
    from swath.tools.height_map.picture import draw_height_map
    from swath.tools.height_map.source import Wanted

    if args.out.suffix != ".npz":
        raise InputError("--out", str(args.out), "expected a name that ends in .npz")
    keys = ("cell_m", "along_m", "across_m", "fill_m", "reach_m", "per_cell", "ground")
    settings = Settings(**{k: v for k in keys if (v := getattr(args, k)) is not None})
    ranges = {k: v for k in ("range_min", "range_max") if (v := getattr(args, f"{k}_m")) is not None}
    table = Path(args.poses) if args.poses and args.poses.endswith(".csv") else None
    wanted = Wanted(
        scans=args.scans,
        poses=None if table else args.poses,
        mount=mount_of(args.mount),
        to_local=local_of(args.field, args.origin),
        antenna=_antenna(args.antenna),
        **ranges,
    )
    source = open_source(args.source, wanted, table)
    with progress_bar(source.name) as progress:
        grid = build_height_map(source, settings, lambda share: progress(share, 1.0))
    grid.save(args.out)
    picture = args.picture or args.out.with_suffix(".png")
    draw_height_map(grid, picture, source.track.position[:, :2])
    _report(grid)
    print(f"heights  {args.out}")
    print(f"picture  {picture}")
    print(f"drive past them: --set 'combine.lidar={{level: replay, file: {args.out.resolve()}}}'")
    return 0


def mount_of(text: str | None, option: str = "--mount") -> Any:
    """A mounting from the command line."""
    from swath.core.frames import Pose
    from swath.core.typed_numbers import numbers_in
    from swath.core.units import DEG

    if text is None:
        return None
    units = ("m",) * 3 + ("deg",) * 3
    numbers = numbers_in(option, text, units, "x,y,z,roll,pitch,yaw [m, deg]")
    return Pose.from_euler(numbers[:3], *(n * DEG for n in numbers[3:]))


def _antenna(text: str | None) -> tuple[float, float, float] | None:
    from swath.core.typed_numbers import numbers_in

    if text is None:
        return None
    x, y, z = numbers_in("--antenna", text, ("m",) * 3, "x,y,z [m]")
    return x, y, z


def local_of(folder: Path | None, origin: str | None) -> Any:
    """What makes local metres of longitude, latitude, height; None where neither is given."""
    from swath.core.errors import InputError
    from swath.core.typed_numbers import numbers_in
    from swath.record.read.fixes import TangentPlane, field_plane

    if folder is not None and origin is not None:
        raise InputError("--origin", origin, "expected --field or --origin, not both")
    if folder is not None:
        return field_plane(folder)
    if origin is None:
        return None
    units, form = ("deg", "deg", "m"), "lat,lon[,height] [deg, m]"
    lat, lon, *height = numbers_in("--origin", origin, units, form, least=2)
    return TangentPlane(lon, lat, *height)


def _report(grid: Any) -> None:
    from swath.terminal.tables import table

    about = dict(grid.about)
    notes = about.pop("notes", {})
    about.pop("settings", None)
    rows = [(key.replace("_", " "), num(value)) for key, value in about.items()]
    table("", ("what", "value"), rows)
    for what, count in notes.items():
        print(f"warning: {what}" + (f" ({count})" if count > 1 else ""))


_DESCRIPTION = """Measured scans and the poses of the machine become plant heights above ground in a grid that
keeps their distribution in every cell. The LiDAR level `replay` looks at it: docs/how-to/again.md."""
