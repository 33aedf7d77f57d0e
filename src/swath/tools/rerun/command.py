"""`swath replay`: a recorded run again, or measured scans as what the LiDAR level `replay` looks at."""

import argparse
from pathlib import Path
from typing import Any


def add(parsers: Any) -> None:
    """Add the command and its verbs."""
    parser = parsers.add_parser(
        "replay",
        help="a recorded run again; or recorded scans made into a field of heights",
        description="`swath replay RUN` is short for `swath replay play RUN`.",
    )
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    _add_play(verbs)
    made = verbs.add_parser("build", help="heights in a grid from recorded scans", description=_DESCRIPTION)
    made.add_argument("source", type=Path, metavar="SOURCE", help="run folder, .mcap, rosbag, .npz or .csv")
    made.add_argument("--out", type=Path, required=True, metavar="FILE.npz", help="the file to make")
    made.add_argument("--scans", metavar="TOPIC", help="topic of the scans")
    made.add_argument("--poses", metavar="TOPIC|CSV", help="topic of the poses, or a table of them")
    made.add_argument(
        "--mount",
        metavar="X,Y,Z,ROLL,PITCH,YAW",
        help="where the scanner sits [m, deg], seen from the poses (default: from /tf_static, or 0)",
    )
    made.add_argument(
        "--field", type=Path, metavar="DIR", help="positions (NavSatFix) become local metres of this folder"
    )
    made.add_argument(
        "--origin",
        metavar="LAT,LON[,HEIGHT]",
        help="or those of the plane that touches the ellipsoid there [deg, m] (default: the first fix)",
    )
    made.add_argument(
        "--antenna", metavar="X,Y,Z", help="where the receiver sits on the machine [m] (default: 0,0,0)"
    )
    made.add_argument(
        "--ground",
        choices=("pose", "echoes"),
        default="pose",
        help="the ground is where the machine stood, or that corrected by the lowest echoes",
    )
    for key, unit, text in (
        ("cell", "M", "side of a cell [m] (default 0.05)"),
        ("along", "M", "heights within this length along the way share a distribution [m] (default 0.5)"),
        ("across", "M", "and within this width across it [m] (default 0.05)"),
        ("fill", "M", "a cell this near to an echo counts as measured [m] (default 0.1)"),
        ("reach", "M", "leave out what is further from the way [m] (default 30)"),
        ("range-min", "M", "smaller ranges are no echo [m] (default 0.05)"),
        ("range-max", "M", "larger ranges are no echo [m] (default 200)"),
    ):
        made.add_argument(f"--{key}-m", type=float, metavar=unit, help=text)
    made.add_argument("--per-cell", type=int, metavar="N", help="heights kept of a cell (default 32)")
    made.add_argument("--picture", type=Path, metavar="PNG", help="the picture (default: beside the file)")
    made.set_defaults(run=run_build)


def _add_play(verbs: Any) -> None:
    from swath.terminal.options import add_scenario_options

    played = verbs.add_parser("play", help="a recorded run with recorded signals", description=_PLAY)
    played.add_argument("source", type=Path, metavar="RUN", help="a run folder, or its run.mcap")
    played.add_argument(
        "--slots",
        metavar="LIST",
        help="slots that play the log, e.g. combine.lidar,odometry (default: motion and all sensors)",
    )
    add_scenario_options(played)
    played.add_argument("--quiet", action="store_true", help="print nothing but the folder of the run")
    played.set_defaults(run=run_play)


def with_verb(argv: list[str]) -> list[str]:
    """`replay runs/x` as `replay play runs/x`."""
    is_short = len(argv) > 1 and argv[1] not in ("play", "build", "-h", "--help")
    return [argv[0], "play", *argv[1:]] if is_short else argv


def run_play(args: argparse.Namespace) -> int:
    """Exit code as of `swath run`; 0 too where slots came out otherwise than recorded."""
    from swath.runtime.folder import choose_run_folder
    from swath.terminal.outcome import print_outcome
    from swath.tools.rerun.rerun import plan_again

    slots = None if args.slots is None else [s.strip() for s in args.slots.split(",") if s.strip()]
    again = plan_again(args.source, slots=slots, sets=args.sets, seed=args.seed)
    scenario = again.scenario
    out = choose_run_folder(scenario.name, scenario.seed, args.out, what="replay")
    result = again.run(out, progress=not args.quiet)
    if args.quiet:
        print(out)
        return int(result.exit_code)
    print_outcome(result.summary, out)
    _report_play(result.summary["replay"])
    return int(result.exit_code)


def _report_play(replay: dict[str, Any]) -> None:
    from swath.documents.data_sheets import viewer_layout
    from swath.terminal.tables import table

    rows = []
    for slot, told in replay["slots"].items():
        result = "identical"
        if not told["identical"]:
            result = f"differs from {told['differs_from_s']:.3f} s on ({told['differs_in']})"
        rows.append((slot, str(told["samples"]), told["digest"][:12], told["recorded_digest"][:12], result))
    print(f"layout  {viewer_layout()}, to look at run.mcap in Foxglove")
    print(f"played from the log: {', '.join(replay['played']) or 'nothing'}")
    table("", ("slot", "samples", "digest", "recorded", "against the recording"), rows)


def run_build(args: argparse.Namespace) -> int:
    """Make the file and its picture, say what is in it."""
    from swath.core.errors import InputError
    from swath.tools.height_map.build import Settings, build_replay, open_source
    from swath.tools.height_map.picture import draw_replay
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
        mount=_mount(args.mount),
        to_local=_to_local(args.field, args.origin),
        antenna=_antenna(args.antenna),
        **ranges,
    )
    source = open_source(args.source, wanted, table)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    with _bar(source.name) as progress:
        grid = build_replay(source, settings, progress)
    grid.save(args.out)
    picture = args.picture or args.out.with_suffix(".png")
    draw_replay(grid, picture, source.track.position[:, :2])
    _report(grid)
    print(f"heights  {args.out}")
    print(f"picture  {picture}")
    print(f"drive past them: --set 'combine.lidar={{level: replay, file: {args.out.resolve()}}}'")
    return 0


def _mount(text: str | None) -> Any:
    from swath.core.frames import Pose
    from swath.core.units import DEG

    if text is None:
        return None
    numbers = _numbers("--mount", text, (6,), "x,y,z,roll,pitch,yaw [m, deg]")
    return Pose.from_euler(numbers[:3], *(n * DEG for n in numbers[3:]))


def _antenna(text: str | None) -> tuple[float, float, float]:
    x, y, z = (0.0, 0.0, 0.0) if text is None else _numbers("--antenna", text, (3,))
    return x, y, z


def _to_local(folder: Path | None, origin: str | None) -> Any:
    from swath.core.errors import InputError
    from swath.record.read.tangent_plane import TangentPlane, field_plane

    if folder is not None and origin is not None:
        raise InputError("--origin", origin, "expected --field or --origin, not both")
    if folder is not None:
        return field_plane(folder)
    if origin is None:
        return None
    lat, lon, *height = _numbers("--origin", origin, (2, 3), "lat,lon[,height] [deg, m]")
    return TangentPlane(lon, lat, *height)


def _numbers(option: str, text: str, counts: tuple[int, ...], form: str = "x,y,z [m]") -> list[float]:
    from math import isfinite

    from swath.core.errors import InputError

    try:
        numbers = [float(n) for n in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not all(isfinite(n) for n in numbers):
        words = {2: "two", 3: "three", 6: "six"}
        raise InputError(option, text, f"expected {words[counts[-1]]} numbers {form}")
    return numbers


def _report(grid: Any) -> None:
    from swath.terminal.tables import number, table

    about = dict(grid.about)
    notes = about.pop("notes", {})
    about.pop("settings", None)
    rows = [(key.replace("_", " "), number(value)) for key, value in about.items()]
    table("", ("what", "value"), rows)
    for what, count in notes.items():
        print(f"warning: {what}" + (f" ({count})" if count > 1 else ""))


def _bar(name: str) -> Any:
    """A rich bar on stderr; nothing where there is no terminal."""
    from contextlib import contextmanager

    from rich.console import Console
    from rich.progress import Progress

    @contextmanager
    def shown() -> Any:
        console = Console(stderr=True)
        if not console.is_terminal:
            yield lambda share: None
            return
        with Progress(console=console, transient=True) as bar:
            task = bar.add_task(name, total=1.0)
            yield lambda share: bar.update(task, completed=share)

    return shown()


_DESCRIPTION = """Measured scans and the poses of the machine become plant heights above ground in a grid that
keeps their distribution in every cell. The LiDAR level `replay` looks at it: docs/replay.md."""

_PLAY = """A recorded run again, with the recorded signals in the place of the chosen slots: the open-loop
test of a detector (`--set combine.edge.level=otsu`). Says which of the other slots came out as recorded:
docs/replay-log.md."""
