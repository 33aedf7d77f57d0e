"""`swath calibrate`: fit a cheap level to a dear one, or to measurements."""

import argparse
from pathlib import Path
from typing import Any

SHIPPED = {  # name: crop, echo rule, is the design the narrow one
    "wheat-median": ("wheat", "percentile", False),
    "wheat-nearest": ("wheat", "nearest", False),
    "barley-median": ("barley", "percentile", True),
    "rye-median": ("rye", "percentile", True),
    "rape-median": ("rape", "percentile", True),
}


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("calibrate", help="fit a cheap level to a dear one or to measurements")
    kinds = parser.add_subparsers(metavar="WHAT", required=True)
    lidar = kinds.add_parser("lidar", help="the table of the LiDAR level empirical", description=_DESCRIPTION)
    lidar.add_argument("--out", type=Path, metavar="FILE.npz", help="table to write, a .yaml lies beside it")
    lidar.add_argument(
        "--from",
        dest="source",
        default="plants",
        metavar="SOURCE",
        help="plants (default), a run folder, or a CSV or npz of measured beams over known stands",
    )
    lidar.add_argument("--crop", default="wheat", help="crop file (default: wheat; a run names its own)")
    lidar.add_argument("--echo", choices=("percentile", "nearest"), default="percentile", help="echo rule")
    lidar.add_argument("--percentile", type=float, default=50.0, metavar="P", help="of the spot (default 50)")
    lidar.add_argument("--sub-rays", type=int, default=37, metavar="N", help="per beam (default 37)")
    lidar.add_argument("--profile", choices=("gaussian", "uniform"), default="gaussian", help="of the spot")
    lidar.add_argument(
        "--sensor",
        default="sick-lms111",
        metavar="NAME",
        help="scanner whose receiver loses what comes back too weakly (default sick-lms111, a middling one)",
    )
    lidar.add_argument("--lines", type=int, metavar="N", help="scan lines of 24 beams per place (default 80)")
    lidar.add_argument(
        "--narrow", action="store_true", help="spots up to 90 mm and usual stands only: a smaller table"
    )
    lidar.add_argument("--quick", action="store_true", help="a coarse design, to try things out")
    lidar.add_argument("--seed", type=int, default=1, help="another seed")
    lidar.add_argument(
        "--shipped", action="store_true", help=f"remake {', '.join(SHIPPED)} into the folder --out"
    )
    lidar.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Fit, judge on what was held out, write, print."""
    from swath.core.errors import InputError

    if args.out is None or (args.out.suffix == ".npz") == args.shipped:
        expected = "a folder" if args.shipped else "a name that ends in .npz"
        raise InputError("--out", None if args.out is None else str(args.out), f"expected {expected}")
    if not 1 <= args.sub_rays <= 217 or not 0.0 <= args.percentile <= 100.0:
        raise InputError("--sub-rays", args.sub_rays, "expected 1 to 217, and --percentile 0 to 100")
    if args.shipped:
        for k, (name, (crop, echo, narrow)) in enumerate(SHIPPED.items(), start=1):
            print(f"{name}, table {k} of {len(SHIPPED)}", flush=True)
            args.narrow = narrow
            _one(args, args.out / f"{name}.npz", crop, echo)
        return 0
    _one(args, args.out, args.crop, args.echo)
    return 0


def _one(args: argparse.Namespace, out: Path, crop: str, echo: str) -> None:
    from swath.field.crop import load_crop
    from swath.sensing.tables import save_table
    from swath.tools.calibrate.fit import described, quality
    from swath.tools.calibrate.stand_rays import Reading

    percentile = args.percentile if echo == "percentile" else 0.0
    reading = Reading(args.sub_rays, args.profile, echo, percentile, args.sensor)
    if args.source == "plants":
        table, judged, source = _from_plants(args, crop, reading)
    else:
        from swath.tools.calibrate.measured import fit_samples, read_run, read_samples

        path = Path(args.source)
        if path.is_dir():
            samples, crop = read_run(path)
        else:
            samples = read_samples(path)
        table, judged = fit_samples(load_crop(crop), samples, args.seed)
        source = f"{len(samples.height)} measured beams of {path.name}"
    fit: dict[str, object] = {"held_out_places": len(judged), **(quality(judged) if judged else {})}
    table = described(table, source=source, reading=reading, crop=crop, fit=fit)
    files = save_table(table, out)
    _report(table, judged)
    for file in files:
        print(file)


def _from_plants(args: argparse.Namespace, crop: str, reading: Any) -> Any:
    from dataclasses import replace

    from swath.field.crop import load_crop
    from swath.terminal.progress import progress_bar
    from swath.tools.calibrate.fit import NARROW, SMALL, Design, fit_plants

    design = SMALL if args.quick else NARROW if args.narrow else Design()
    if args.lines is not None:
        design = replace(design, lines=max(args.lines, 1))
    with progress_bar(f"{crop}, {reading.echo}") as progress:
        table, judged = fit_plants(load_crop(crop), design, reading, args.seed, progress=progress)
    source = f"level plants, {design.beam_count} beams of {reading.sub_rays} sub-rays, seed {args.seed}"
    return table, judged, source


def _report(table: Any, judged: Any) -> None:
    from dataclasses import asdict

    from swath.sensing.tables import valid_range
    from swath.terminal.tables import number
    from swath.terminal.tables import table as show
    from swath.tools.calibrate.fit import quality

    show("range of validity", ("axis", "from", "to"),
         [(k, number(a), number(b)) for k, (a, b) in valid_range(table).items()])  # fmt: skip
    if not judged:
        print("nothing was left to hold out")
        return
    rows = [
        (k, ", ".join(f"{n} {number(v)}" for n, v in parts.items())) for k, parts in quality(judged).items()
    ]
    show(f"table against {len(judged)} places held out", ("number", "over the places"), rows)
    worst = max(judged, key=lambda h: h.agreement.wasserstein_m)
    place = ", ".join(f"{k} {number(v)}" for k, v in asdict(worst.place).items())
    print(f"worst place: {place}")


_DESCRIPTION = """Fit the spread table of the LiDAR level empirical: from the level plants over a design of
stands, from a recorded run, or from measured beams over known stands (CSV or npz with the columns
stems_per_m2, crop_height_m, depression_deg, spot_mm, height_m). Prints how the table agrees with what was
held out."""
