"""`swath dataset`: labelled pictures of varied scenarios, for training and testing detectors."""

import argparse
import os
from typing import Any

from swath.terminal.options import add_folder, add_sets


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser(
        "dataset", help="labelled pictures of varied scenarios (COCO)", description=_DESCRIPTION
    )
    parser.add_argument("scenario", metavar="NAME|FILE", help="a bundled scenario, or a YAML file")
    add_folder(parser, "data set", "dataset.json", "annotations.json", "overview.png", alone=False)
    parser.add_argument("--count", type=int, default=100, metavar="N", help="pictures (default 100)")
    parser.add_argument(
        "--seed", type=int, default=1, metavar="N", help="another seed, other pictures (default 1)"
    )
    parser.add_argument(
        "--width-px", type=int, default=640, metavar="PX", help="width of a picture (default 640)"
    )
    parser.add_argument(
        "--height-px", type=int, default=480, metavar="PX", help="height of a picture (default 480)"
    )
    parser.add_argument(
        "--per-scene", type=int, default=5, metavar="N", help="pictures per field and light (default 5)"
    )
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, metavar="N", help="processes (default: cores)"
    )
    add_sets(parser, "change the scenario; what is set does not vary; may be given several times")
    parser.set_defaults(run=run)


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
