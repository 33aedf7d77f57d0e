"""`swath dataset`: labelled pictures or scans of varied scenarios, for training and testing detectors."""

import argparse
import os
from pathlib import Path
from typing import Any

from swath.terminal.options import add_folder, add_sets, option, verb

PLACE = "many", 5  # among all commands
PICTURES = {  # what says how pictures are made, and its default
    "--width-px": ("width of a picture", 640),
    "--height-px": ("height of a picture", 480),
    "--per-scene": ("pictures per field and light", 5),
}
PLACES = "1,2,3,4,6,8"


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "dataset", "labelled pictures or scans of varied scenarios", run, _DESCRIPTION)
    option(parser, "scenario NAME|FILE", "a bundled scenario, or a YAML file")
    files = "dataset.json", "annotations.json", "overview.png", "drive-*.parquet"
    help_ = "where to write, and go on (default: pictures, or scans)"
    add_folder(parser, "data set", *files, text=help_, required=False, alone=False)
    option(parser, "--scans", "scans of drives in the loop, as parquet, in place of pictures")
    option(parser, "--count N", "pictures, or drives", 100)
    option(parser, "--seed N", "another seed, other pictures or drives", 1)
    for name, (text, usual) in PICTURES.items():
        option(parser, f"{name} N", f"{text} (default {usual})", type=int)
    option(
        parser, "--places-m M,M", f"where the true edge is told, ahead of the knife (default {PLACES})", ""
    )
    option(parser, "--workers N", "processes (default: cores)", os.cpu_count() or 1)
    add_sets(parser, "change the scenario; what is set does not vary; may be given several times")


def run(args: argparse.Namespace) -> int:
    """Make what is missing; print where it is."""
    from swath.core.errors import InputError

    if args.workers < 1:
        raise InputError("--workers", args.workers, "expected >= 1")
    make, usual = (_scans, "scans") if args.scans else (_pictures, "pictures")
    if args.out is not None:
        return make(args, args.out)
    with args.holds(Path(usual)):
        return make(args, Path(usual))


def _key(name: str) -> str:
    return name[2:].replace("-", "_")


def _pictures(args: argparse.Namespace, out: Path) -> int:
    from swath.core.errors import InputError
    from swath.terminal.progress import progress_bar
    from swath.tools.dataset.dataset import make_dataset, settings_of, write_overview

    if args.places_m:
        raise InputError("--places-m", args.places_m, "expected --scans with it")
    sizes = {
        key: usual if (given := getattr(args, _key(name))) is None else given
        for key, (name, (_, usual)) in zip(("width", "height", "per_scene"), PICTURES.items(), strict=True)
    }
    settings = settings_of(
        args.scenario,
        count=args.count,
        seed=args.seed,
        sets=tuple(args.sets),
        **sizes,
    )
    with progress_bar("pictures") as progress:
        file = make_dataset(settings, out, workers=args.workers, progress=progress)
    print(file)
    print(write_overview(out))
    return 0


def _scans(args: argparse.Namespace, out: Path) -> int:
    from swath.core.errors import InputError
    from swath.core.typed_numbers import numbers_in
    from swath.terminal.progress import progress_bar
    from swath.tools.dataset.scans import make_scans, settings_of

    for name in PICTURES:
        if (value := getattr(args, _key(name))) is not None:
            raise InputError(name, value, "expected no --scans with it")
    form = "or fewer, metres ahead of the knife"
    places = tuple(numbers_in("--places-m", args.places_m or PLACES, ("m",) * 6, form, least=1))
    settings = settings_of(
        args.scenario, count=args.count, seed=args.seed, sets=tuple(args.sets), places=places
    )
    with progress_bar("drives") as progress:
        files = make_scans(settings, out, workers=args.workers, progress=progress)
    print(*files, sep="\n")
    return 0


_DESCRIPTION = """Pictures of a scenario's camera with masks and boxes of everything in them, as COCO. Field,
light, air, place of the camera and things around vary from the seed. With --scans drives of the scenario:
each scan of its first scanner, what each echo is of, and the true edge. A command that was stopped resumes
when it is given again."""
