"""`swath reda`: where sensors detect a person, by crop and weather."""

import argparse
import os
from typing import Any

from swath.core.number_text import num
from swath.terminal.options import add_folder, former, made_of, option, verb

TARGETS = ("person", "animal", "person-lying", "animal-fawn", "animal-hare")
PLACE = "many", 4  # among all commands
_DESCRIPTION = """A person on a grid of places before and behind a crop edge, seen by a LiDAR, two radars and
a camera, for every combination of crop height, density and weather: maps of the share of looks that detect
the person, three scores, and whether and why a sensor sees somebody 3 m inside the crop.
How: docs/explanation/validation.md."""


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "reda", "where sensors detect a person in crop", run, _DESCRIPTION)
    add_folder(parser, "result", "reda.part.jsonl", "reda.csv", "scores.csv", "report.html", "reda-*.png")
    option(parser, "--crop-height-m M", "height of the crop (default 0.6 0.85)", nargs="+", type=float)
    option(parser, "--stems-per-m2 N", "density of the stand (default 300 500)", nargs="+", type=float)
    option(parser, "--weather NAME", "clear, dust or rain (default: all)", nargs="+")
    option(parser, "--hour H", "hours of 25 July, summer time: sun, air (extra light)", nargs="+", type=float,
           unit="h")  # fmt: skip
    option(
        parser,
        "--sensor NAME",
        "lidar, camera, thermal with --hour, or data sheets of radars (default: lidar, camera, two radars)",
        nargs="+",
    )
    option(parser, "--target", "what to detect", TARGETS)
    option(parser, "--target-height-m M", "its height (default: that of its data sheet)", type=float)
    option(parser, "--crop NAME|FILE", "crop", "wheat")
    option(parser, "--moisture-percent PERCENT", "moisture of the straw", 12.0)
    option(parser, "--camera-px N", "width of the camera picture", 1280)
    option(parser, "--camera-least-px N", "pixels that a detector needs on the target", 40.0)
    option(
        parser, "--least SHARE", "share of looks from which a place counts as covered", 0.9, unit="fraction"
    )
    option(parser, "--repeats N", "persons per place", 2)
    option(parser, "--seed N", "seed", 1)
    option(parser, "--workers N", "processes (default: cores)", type=int)
    former(parser, crop_height_m="--height", stems_per_m2="--density")


def run(args: argparse.Namespace) -> int:
    """Look, write, print what is asked most."""
    from swath.core.files.place import remove
    from swath.terminal.progress import progress_bar
    from swath.terminal.tables import table
    from swath.tools.reda.page import ASKED_HEAD, SCORE_HEAD, asked_rows, score_rows, write_all
    from swath.tools.reda.reda import ASKED, KEPT, run_reda

    settings = _settings(args)
    processes = args.workers or os.cpu_count() or 1
    kept = args.out / KEPT
    try:
        with progress_bar("looking") as progress:
            found = run_reda(settings, processes=processes, progress=progress, kept=kept)
    except KeyboardInterrupt as error:
        goes_on = f"; what is done is in {kept}, the same command resumes from there"
        raise type(error)(f"stopped{goes_on if os.path.isfile(kept) else ', nothing was done yet'}") from None
    files = write_all(args.out, settings, found)
    remove(kept)
    table("scores", SCORE_HEAD, score_rows(settings, found))
    table(f"{num(ASKED)} m inside the crop", ASKED_HEAD, asked_rows(settings, found))
    print(files[-1])
    return 0


def _settings(args: argparse.Namespace) -> Any:
    from swath.tools.reda.scene import Settings

    names = {
        "heights": "crop_height_m", "densities": "stems_per_m2", "weathers": "weather", "hours": "hour",
        "sensors": "sensor", "target_height": "target_height_m", "moisture": "moisture_percent",
    }  # fmt: skip
    return made_of(Settings, args, names)
