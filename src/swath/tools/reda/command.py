"""`swath reda`: where sensors detect a person, by crop and weather."""

import argparse
from pathlib import Path
from typing import Any

_DESCRIPTION = """A person on a grid of places before and behind a crop edge, seen by a LiDAR, two radars and
a camera, for every combination of crop height, density and weather: maps of the share of looks that detect
the person, three scores, and whether and why a sensor sees somebody 3 m inside the crop.
How: docs/explanation/validation.md."""


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser(
        "reda", help="where sensors detect a person in crop", description=_DESCRIPTION
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where to write")
    parser.add_argument("--height", nargs="+", type=float, metavar="M", help="of the crop (default 0.6 0.85)")
    parser.add_argument("--density", nargs="+", type=float, metavar="N", help="stems/m2 (default 300 500)")
    parser.add_argument("--weather", nargs="+", metavar="NAME", help="of clear, dust, rain (default all)")
    parser.add_argument("--sensor", nargs="+", metavar="NAME", help="lidar, radar sheets, camera (default 4)")
    parser.add_argument("--target", default="person", choices=("person", "animal"), help="default person")
    parser.add_argument("--target-height", type=float, metavar="M", help="default: its sheet's")
    parser.add_argument("--crop", default="wheat", metavar="NAME|FILE", help="crop (default wheat)")
    parser.add_argument("--moisture", type=float, default=12.0, metavar="PERCENT", help="of the straw")
    parser.add_argument("--camera-px", type=int, default=1280, metavar="N", help="width (default 1280)")
    parser.add_argument("--camera-least-px", type=float, default=40.0, metavar="N", help="a detector needs")
    parser.add_argument("--least", type=float, default=0.9, metavar="SHARE", help="that covers a place")
    parser.add_argument("--repeats", type=int, default=2, metavar="N", help="at each place (default 2)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="default 1")
    parser.add_argument("--workers", type=int, metavar="N", help="processes (default: cores)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Look, write, print what is asked most."""
    import os

    from swath.terminal.progress import progress_bar
    from swath.terminal.tables import table
    from swath.tools.reda.page import ASKED_HEAD, SCORE_HEAD, asked_rows, score_rows, write_all
    from swath.tools.reda.reda import ASKED, KEPT, run_reda

    settings = _settings(args)
    _check_out(args.out)
    processes = args.workers or os.cpu_count() or 1
    kept = args.out / KEPT
    try:
        with progress_bar("looking") as progress:
            found = run_reda(settings, processes=processes, progress=progress, kept=kept)
    except KeyboardInterrupt as error:
        goes_on = f"; what is done is in {kept}, the same command goes on from there"
        raise type(error)(f"stopped{goes_on if kept.is_file() else ', nothing was done yet'}") from None
    files = write_all(args.out, settings, found)
    kept.unlink(missing_ok=True)
    table("scores", SCORE_HEAD, score_rows(settings, found))
    table(f"{ASKED:g} m inside the crop", ASKED_HEAD, asked_rows(settings, found))
    print(files[-1])
    return 0


def _settings(args: argparse.Namespace) -> Any:
    from swath.tools.reda.scene import Settings

    lists = {
        "heights": args.height,
        "densities": args.density,
        "weathers": args.weather,
        "sensors": args.sensor,
    }
    given: dict[str, Any] = {k: tuple(v) for k, v in lists.items() if v is not None}
    names = (
        "target",
        "target_height",
        "crop",
        "moisture",
        "camera_px",
        "camera_least_px",
        "least",
        "repeats",
    )
    return Settings(**given, **{name: getattr(args, name) for name in names}, seed=args.seed)


def _check_out(out: Path) -> None:
    from swath.core.errors import InputError
    from swath.tools.reda.reda import KEPT

    known = {KEPT, "reda.csv", "scores.csv", "report.html"}
    if out.exists() and (not out.is_dir() or any(_is_strange(f.name, known) for f in out.iterdir())):
        raise InputError("--out", str(out), "expected a new or empty folder, or an earlier result")


def _is_strange(name: str, known: set[str]) -> bool:
    return name not in known and not (name.startswith("reda-") and name.endswith(".png"))
