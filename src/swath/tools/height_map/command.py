"""`swath height-map`: recorded scans become the height map that the LiDAR level `replay` looks at."""

import argparse
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.number_text import num
from swath.terminal.options import made_of, option, verb

PLACE = "measured", 1  # among all commands


def add(parsers: Any) -> None:
    """Add the command and its verb."""
    parser = parsers.add_parser("height-map", help="recorded scans become a map of crop heights")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    made = verb(verbs, "build", "make a map from recorded scans", run_build, _DESCRIPTION)
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
    option(made, "--cell-m M", "side of a cell [m]", 0.05)
    option(made, "--along-m M", "length along the path whose heights share a distribution [m]", 1.0)
    option(made, "--across-m M", "width across the path, likewise [m]", 0.05)
    option(made, "--fill-m M", "a cell this near to an echo counts as measured [m]", 0.1)
    option(made, "--reach-m M", "leave out echoes further from the path [m]", 30.0)
    option(made, "--range-min-m M", "smaller ranges are no echo [m]", 0.05)
    option(made, "--range-max-m M", "larger ranges are no echo [m]", 200.0)
    option(made, "--per-cell N", "heights kept per cell", 32)
    option(made, "--picture PNG", "the picture (default: beside the file)", type=Path)


def run_build(args: argparse.Namespace) -> int:
    """Make the file and its picture, say what is in it."""
    from swath.terminal.progress import progress_bar
    from swath.tools.height_map.build import Settings, build_height_map, open_source
    from swath.tools.height_map.picture import draw_height_map

    if args.out.suffix != ".npz":
        raise InputError("--out", str(args.out), "expected a name that ends in .npz")
    settings = made_of(Settings, args)
    antenna = _numbers("--antenna", args.antenna, ("m",) * 3, "x,y,z [m]")
    wanted, table = wanted_of(args, range_min=args.range_min_m, antenna=antenna)
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


def wanted_of(args: argparse.Namespace, which: str = "", **more: Any) -> tuple[Any, Path | None]:
    """What options say about a source, and its table of poses. which: `-a` of one of several sources."""
    from swath.core.frames import Pose
    from swath.core.units import DEG
    from swath.tools.height_map.source import Wanted

    scans, poses, mount = (
        getattr(args, name + which.replace("-", "_")) for name in ("scans", "poses", "mount")
    )
    table = Path(poses) if poses and poses.endswith(".csv") else None
    units, form = ("m",) * 3 + ("deg",) * 3, "x,y,z,roll,pitch,yaw [m, deg]"
    pose = _numbers(f"--mount{which}", mount, units, form)
    if pose is not None:
        pose = Pose.from_euler(pose[:3], *(n * DEG for n in pose[3:]))
    place = {"mount": pose, "to_local": _local_of(args.field, args.origin)}
    return Wanted(scans, None if table else poses, range_max=args.range_max_m, **place, **more), table


def _numbers(key: str, text: str | None, units: tuple[str, ...], form: str) -> Any:
    """Numbers of an option; None where it is not given."""
    from swath.core.typed_numbers import numbers_in

    return None if text is None else tuple(numbers_in(key, text, units, form))


def _local_of(folder: Path | None, origin: str | None) -> Any:
    """What makes local metres of longitude, latitude, height; None where neither is given."""
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
