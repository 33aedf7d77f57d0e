"""`swath dataset`: labelled pictures of varied scenarios, for training and testing detectors."""

import argparse
import os
from pathlib import Path
from typing import Any

from swath.terminal.options import add_folder, add_sets, option, verb

PLACE = "many", 5  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "dataset", "labelled pictures of varied scenarios (COCO)", run, _DESCRIPTION)
    option(parser, "scenario NAME|FILE", "a bundled scenario, or a YAML file")
    files = "dataset.json", "annotations.json", "overview.png"
    help_ = "where to write, and go on (default: pictures)"
    add_folder(parser, "data set", *files, text=help_, required=False, alone=False)
    parser.set_defaults(out=Path("pictures"))
    option(parser, "--count N", "pictures", 100)
    option(parser, "--seed N", "another seed, other pictures", 1)
    option(parser, "--width-px PX", "width of a picture", 640)
    option(parser, "--height-px PX", "height of a picture", 480)
    option(parser, "--per-scene N", "pictures per field and light", 5)
    option(parser, "--workers N", "processes (default: cores)", os.cpu_count() or 1)
    add_sets(parser, "change the scenario; what is set does not vary; may be given several times")


def run(args: argparse.Namespace) -> int:
    """Make what is missing; print where it is."""
    from swath.core.errors import InputError
    from swath.terminal.progress import progress_bar
    from swath.tools.dataset.dataset import make_dataset, settings_of, write_overview

    if args.workers < 1:
        raise InputError("--workers", args.workers, "expected >= 1")
    settings = settings_of(
        args.scenario,
        count=args.count,
        seed=args.seed,
        sets=tuple(args.sets),
        width=args.width_px,
        height=args.height_px,
        per_scene=args.per_scene,
    )
    with progress_bar("pictures") as progress:
        file = make_dataset(settings, args.out, workers=args.workers, progress=progress)
    print(file)
    print(write_overview(args.out))
    return 0


_DESCRIPTION = """Pictures of a scenario's camera with masks and boxes of everything in them, as COCO. Field,
light, air, place of the camera and things around vary from the seed. A command that was stopped resumes when
it is given again."""
