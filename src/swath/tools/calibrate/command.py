"""`swath calibrate`: fits a LiDAR table, or the engine of a machine, to what was measured."""

import argparse
from pathlib import Path
from typing import Any

from swath.core.number_text import num
from swath.terminal.options import option, verb
from swath.tools.calibrate.engine_command import add_engine

PLACE = "measured", 2  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("calibrate", help="fit a LiDAR table or a machine's engine to measurements")
    kinds = parser.add_subparsers(metavar="WHAT", required=True)
    lidar = verb(kinds, "lidar", "the table of the LiDAR level empirical", run, _DESCRIPTION)
    option(lidar, "--out FILE.npz", "table to write, with a .yaml beside it", type=Path, required=True)
    option(
        lidar,
        "--from SOURCE",
        "plants (default), or a CSV of measured beams over known stands",
        "plants",
        dest="source",
    )
    option(lidar, "--crop", "crop", "wheat")
    option(lidar, "--echo", "echo rule", ("percentile", "nearest"))
    option(lidar, "--percentile P", "of the ranges in a spot, for --echo percentile", 50.0, unit="percent")
    option(lidar, "--sub-rays N", "sub-rays per beam", 37)
    option(lidar, "--profile", "intensity over the spot", ("gaussian", "uniform"))
    option(lidar, "--sensor NAME", "scanner whose receiver decides which echoes are too weak", "sick-lms111")
    option(lidar, "--lines N", "scan lines of 24 beams per place (default 80)", type=int)
    option(lidar, "--narrow", "only spots up to 90 mm and usual stands: a smaller table")
    option(lidar, "--quick", "a coarse design, for a first try")
    option(lidar, "--seed N", "seed", 1)
    add_engine(kinds)


def run(args: argparse.Namespace) -> int:
    """Fit, compare with what was held out, write, print."""
    from dataclasses import replace

    from swath.core.errors import InputError
    from swath.field.crop_sheet import load_crop
    from swath.sensing.tables import save_table
    from swath.tools.calibrate.stand_scans import EchoSettings

    if args.out.suffix != ".npz":
        raise InputError("--out", str(args.out), "expected a name that ends in .npz")
    if not 1 <= args.sub_rays <= 217 or not 0.0 <= args.percentile <= 100.0:
        raise InputError("--sub-rays", args.sub_rays, "expected 1 to 217, and --percentile 0 to 100")
    percentile = args.percentile if args.echo == "percentile" else 0.0
    echo = EchoSettings(args.sub_rays, args.profile, args.echo, percentile, args.sensor)
    if args.source == "plants":
        table, held_out, source = _from_plants(args, echo)
    else:
        from swath.terminal.progress import progress_bar
        from swath.tools.calibrate.measured import fit_samples, read_samples

        path = Path(args.source)
        samples = read_samples(path)
        with progress_bar(f"{args.crop}, stubble") as progress:
            table, held_out = fit_samples(
                load_crop(args.crop), samples, _designs(args).stubble, echo, args.seed, progress=progress
            )
        source = f"{len(samples.height)} measured beams of {path.name}"
    fit, stubble = _quality(held_out, False), _quality(held_out, True)
    reading = {"echo": echo.rule, "percentile": percentile, "sub_rays": echo.sub_rays}
    reading |= {"profile": echo.profile, "sensor": echo.sensor}
    about = {"crop": args.crop, "source": source, "reading": reading, "fit": fit, "stubble_fit": stubble}
    files = save_table(replace(table, about=about), args.out)
    _report(table, held_out)
    for file in files:
        print(file)
    return 0


def _designs(args: argparse.Namespace) -> Any:
    from swath.tools.calibrate.fit import NARROW, SMALL, Designs

    designs = SMALL if args.quick else NARROW if args.narrow else Designs()
    return designs if args.lines is None else designs.with_lines(max(args.lines, 1))


def _from_plants(args: argparse.Namespace, echo: Any) -> Any:
    from swath.field.crop_sheet import load_crop
    from swath.terminal.progress import progress_bar
    from swath.tools.calibrate.fit import fit_plants

    designs = _designs(args)
    with progress_bar(f"{args.crop}, {echo.rule}") as progress:
        table, held_out = fit_plants(load_crop(args.crop), designs, echo, args.seed, progress=progress)
    count = designs.standing.beam_count + designs.stubble.beam_count
    source = f"level plants, {count} beams of {echo.sub_rays} sub-rays, seed {args.seed}"
    return table, held_out, source


def _quality(held_out: Any, is_cut: bool) -> dict[str, object]:
    from swath.tools.calibrate.fit import quality

    mine = [h for h in held_out if h.is_cut == is_cut]
    return {"held_out_places": len(mine), **(quality(mine) if mine else {})}


def _report(table: Any, held_out: Any) -> None:
    from dataclasses import asdict

    from swath.sensing.tables import valid_range
    from swath.terminal.tables import table as show
    from swath.tools.calibrate.fit import quality

    for name, grid in (("standing crop", table.standing), ("stubble", table.stubble)):
        show(f"range of validity, {name}", ("axis", "from", "to"),
             [(k, num(a), num(b)) for k, (a, b) in valid_range(grid).items()])  # fmt: skip
        mine = [h for h in held_out if h.is_cut == (grid is table.stubble)]
        if not mine:
            print(f"nothing was left to hold out of {name}")
            continue
        rows = [
            (k, ", ".join(f"{n} {num(v)}" for n, v in parts.items())) for k, parts in quality(mine).items()
        ]
        show(f"{name} against {len(mine)} places held out", ("number", "over the places"), rows)
        worst = max(mine, key=lambda h: h.agreement.wasserstein_m)
        place = ", ".join(f"{k} {num(v)}" for k, v in asdict(worst.place).items())
        print(f"worst place: {place}")


_DESCRIPTION = """Fit the spread table of the LiDAR level empirical: from the level plants over a design of
stands, or from measured beams over known stands (CSV with the columns
stems_per_m2, crop_height_m, depression_deg, spot_mm, height_m). Prints how well the table predicts the part
of the data that was not fitted."""
