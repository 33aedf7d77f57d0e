"""How many runs of the catalogue leave the range in which a level was checked, and what moves the line.

    nice python -m benchmarks.credibility [--distance 10] [CASE ...]
    nice python -m benchmarks.credibility --ends [--distance 25] [QUANTITY ...]
    nice python -m benchmarks.credibility --beyond [--distance 25] [--number 16] [QUANTITY ...]

The first run of every case over its first metres. Runs outside: tests/runtime/test_credibility.py.

`--ends` drives `straight` just inside and just outside of every end of a range of its slots, and of the plain
values where there is none: by how much `lateral_rms_m` differs from that at plain values and from that with
every stem (lidar `plants`), and what is said. `SILENT`: nothing is said, the line moves by more than the
error that the scanner's level states, and with every stem it does not; or it is off from that by more inside.

`--beyond` draws values of a quantity beyond the range of lidar `empirical`, over crops, edges, slopes, motion
levels and seeds, and drives each with `empirical` and with `plants`: by how much metrics differ at most is
what that level states of use beyond its range.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees, inf, isfinite, nan
from statistics import fmean
from typing import Any

import numpy as np

from swath.core.errors import InputError, SwathError
from swath.core.units import KMH
from swath.runtime.assembly import assemble
from swath.runtime.credibility import Scene, outside_of, why_outside
from swath.runtime.job import run_unrecorded
from swath.runtime.met import QUANTITIES
from swath.scenario.overrides import layered
from swath.scenario.scenario import load_scenario
from swath.sensing.lidar.empirical import MOVED
from swath.tools.function_test.case import find_cases
from swath.tools.function_test.one_run import scenario_of
from swath.tools.function_test.plan import Plan

CHEAP, DEAR = "combine.lidar.level=empirical", "combine.lidar.level=plants"
SEEDS = (1, 2)
HEIGHT_M, END_M = 0.85, 6.0  # of wheat; from the middle of the machine to the edge
SLOWEST_KMH = 2.0  # that is driven here: backwards and crawling are closed forms, tests/levels/test_ranges.py
PLAIN = ""  # quantity of the run at plain values
MACHINE = (
    "ground_speed_kmh",
    "slope_across_percent",
    "slope_along_percent",
    "yaw_rate_deg_s",
    "friction",
    "cone_index_kpa",
    "roughness_gd_m3",
    "cutting_height_m",
)  # on which echoes do not depend


def _slope(azimuth: float) -> Callable[[float], list[str]]:
    """Ground that rises towards an azimuth [deg]; the machine drives north or, less than 0 %, it falls."""
    text = "field.terrain={{level: plane, slope_percent: {:g}, slope_azimuth_deg: {:g}}}"
    return lambda v: [text.format(abs(v), azimuth if v > 0 else azimuth + 180.0)]


def _bend(rate: float) -> list[str]:
    """A bend of the edge at whose side the machine turns at a rate [deg/s]."""
    radius, angle = degrees(7.0 * KMH) / rate - END_M, 90.0 if rate > 0 else -90.0
    return [f"field.edge={{shape: curve, run_in_m: 12, radius_m: {abs(radius):g}, angle_deg: {angle:g}}}"]


def _key(text: str) -> Callable[[float], list[str]]:
    return lambda v: [text.format(v=v, half=0.5 * v, share=v / HEIGHT_M)]


# Quantity -> what a run of `straight` is changed by so that it meets a value.
DRIVES: Mapping[str, Callable[[float], list[str]]] = {
    "ground_speed_kmh": lambda v: [f"combine.motion.start_speed_kmh={v:g}", f"combine.speed.speed_kmh={v:g}"],
    "slope_across_percent": _slope(90.0),
    "slope_along_percent": _slope(0.0),
    "yaw_rate_deg_s": _bend,
    "stems_per_m2": _key("field.stand.stems_per_m2={v:g}"),
    "crop_height_m": _key("field.stand.height_factor={share:g}"),
    "lean_deg": _key("field.stand.lean_deg={v:g}"),
    "wind_lean_deg": _key("field.stand.wind={{sway_deg: {half:g}, steady_deg: {half:g}}}"),
    "weeds_per_m2": _key("field.stand.weeds={{plants_per_m2: {v:g}}}"),
    "friction": _key("combine.motion.friction={v:g}"),
    "cone_index_kpa": _key(
        "combine.motion={{level: multibody, soil: brixius, cone_index_kpa: {v:g}, start_speed_kmh: 7}}"
    ),
    "roughness_gd_m3": _key("field.terrain={{level: formula, slope_percent: 1.0, gd_n0_m3: {v:g}}}"),
    "rain_mm_h": _key("combine.lidar.weather.rain_mm_h={v:g}"),
    "dust_per_m": _key("combine.lidar.weather.extinction_per_m={v:g}"),
    "straw_moisture_percent": _key("field.stand.straw_moisture_percent={v:g}"),
    "other_crop": lambda v: ["field.stand={level: uniform, crop: rye, stems_per_m2: 280}"] if v else [],
    "cutting_height_m": _key("combine.header.cutting_height_m={v:g}"),
    "depression_deg": _key("combine.lidar.mount.pitch_deg={v:g}"),
}  # fmt: skip
# How far within and beyond an end is driven, in parts of the end; absolute where that is 0.
STEP, FROM_0 = 0.04, {"wind_lean_deg": 2.0, "weeds_per_m2": 10.0, "rain_mm_h": 3.0, "dust_per_m": 0.1}


@dataclass(frozen=True)
class Met:
    """Of runs at a value of a quantity. line: mean of `lateral_rms_m` [m]; said: slots that were not checked
    there, in brackets where no range is declared; limit: stated error of the line [m], nan for none.
    """

    line: float
    said: tuple[str, ...]
    limit: float


def met(name: str, value: float, *sets: str, distance: float = 25.0, seeds: Sequence[int] = SEEDS) -> Met:
    """Drive `straight` where a quantity has a value, or at plain values for PLAIN."""
    changes = [f"run.distance_m={distance:g}", *sets, *(DRIVES[name](value) if name else ())]
    told = [run_unrecorded(load_scenario("straight", sets=[*changes, f"seed={seed}"])) for seed in seeds]
    rows = [next(e for e in summary["expect"] if e["name"] == "lateral_rms_m") for summary in told]
    lines = [nan if row["value"] is None else row["value"] for row in rows]
    limit = rows[0].get("level_error", {}).get("size", nan)
    return Met(fmean(lines), tuple(sorted(said(told[0], name))), limit)


def said(summary: Mapping[str, Any], name: str) -> set[str]:
    """Slots of which a run says that they were not checked at what it met of a quantity."""
    outside = {
        slot
        for slot, told in outside_of(summary).items()
        if any(row["quantity"] == name for row in told["quantities"])
    }
    notes = [n for n in summary.get("notes", ()) if "not checked for" in n and name and name in n]
    unchecked = summary["credibility"]["not_checked"].items() if notes else ()
    found = outside | {f"({slot})" for slot, names in unchecked if name in names}
    return {slot.replace("combine.", "") for slot in found}


def ends() -> dict[str, dict[float, list[str]]]:
    """By quantity the ends of ranges, and of plain values, and the slots that have them."""
    scene = Scene(assemble(load_scenario("straight", sets=[CHEAP])))
    ((name, ranges),) = scene.ranges.items()
    found: dict[str, dict[float, list[str]]] = {}
    for slot, own in ranges.items():
        for checked in own:
            for end in {checked.low, checked.high}:
                found.setdefault(checked.quantity, {}).setdefault(end, []).append(slot)
    for slot, quantities in scene.unchecked[name].items():
        for quantity in quantities:
            for end in filter(isfinite, set(QUANTITIES[quantity].plain)):
                found.setdefault(quantity, {}).setdefault(end, []).append(f"({slot})")
    return found


def beside(name: str, end: float) -> list[float]:
    """Values to drive, just on both sides of an end, that can be driven here."""
    step = STEP * abs(end) or FROM_0.get(name, 0.0)
    values = [end] if name == "other_crop" else sorted({end - step, end + step})
    if name == "ground_speed_kmh":
        return [v for v in values if v >= SLOWEST_KMH]
    if name == "yaw_rate_deg_s":
        return [v for v in values if 0.0 < abs(v) < 10.0]
    return [v for v in values if v >= 0.0 or name.startswith("slope")]


def drive_ends(names: Sequence[str], distance: float) -> None:
    """Print a row for every value beside an end."""
    plain = met(PLAIN, nan, CHEAP, distance=distance)
    print(f"plain: {100 * plain.line:.1f} cm, limit {100 * plain.limit:.0f} cm")
    print("| quantity | end of | end | driven | moved [cm] | off plants [cm] | said of |\n|" + 7 * "---|")
    silent = count = 0
    for name, own in ends().items():
        for end, slots in sorted(own.items() if not names or name in names else ()):
            for value in beside(name, end) if name in DRIVES else ():
                try:
                    cheap = met(name, value, CHEAP, distance=distance)
                except InputError as error:
                    print(f"| {name} | {', '.join(slots)} | {end:g} | {value:g} | - | - | refused: {error} |")
                    continue
                count += 1
                moved, off = abs(cheap.line - plain.line), nan
                trusts_scanner = not {"lidar", "(lidar)"} & {*cheap.said}
                if name not in MACHINE and (not cheap.said or ("lidar" in slots and trusts_scanner)):
                    off = abs(cheap.line - met(name, value, DEAR, distance=distance).line)
                is_silent = off > plain.limit or (
                    not cheap.said and moved > plain.limit and not isfinite(off)
                )
                silent += is_silent
                mark = "**SILENT**" if is_silent else ", ".join(cheap.said) or "inside"
                cells = name, ", ".join(slots), f"{end:g}", f"{value:g}"
                print(f"| {' | '.join(cells)} | {100 * moved:.1f} | {100 * off:.1f} | {mark} |", flush=True)
    print(f"{silent} of {count} silent")


# Drawn beyond the ranges of `empirical`, (low, high) of each side; of stems shares of those of the crop.
BEYOND: Mapping[str, tuple[tuple[float, float], ...]] = {
    "stems_per_m2": ((0.25, 0.75), (1.25, 3.0)),
    "lean_deg": ((20.0, 40.0),),
    "wind_lean_deg": ((1.0, 15.0),),
    "weeds_per_m2": ((1.0, 40.0),),
}
STEMS = {"wheat": 450.0, "barley": 500.0, "rye": 280.0}  # about those of the crop's sheet
POST_M = 3.0  # beside the edge, on the stubble


def drawn(name: str, seed: int, distance: float) -> tuple[float, list[str]]:
    """A value of a quantity beyond its range, and changes of `straight` by which a run meets it."""
    rng = np.random.default_rng([seed, *name.encode()])
    low, high = BEYOND[name][seed % len(BEYOND[name])]
    crop, share = str(rng.choice(list(STEMS))), float(rng.uniform(low, high))
    stems = STEMS[crop] * (share if name == "stems_per_m2" else 1.0)
    bend = rng.random() < 0.5
    changes = [
        f"field.stand={{level: uniform, crop: {crop}, stems_per_m2: {stems:.4g}}}",
        *(DRIVES[name](share) if name != "stems_per_m2" else ()),
        *(_bend(float(rng.choice([-3.0, 3.0]))) if bend else ()),
        *_slope(float(rng.uniform(0.0, 360.0)))(float(rng.uniform(0.0, 9.0))),
        f"combine.motion.level={rng.choice(['single_track', 'multibody'])}",
        f"field.obstacles=[{{kind: post, x_m: {-POST_M:g}, y_m: 12}}]",
        f"run.distance_m={distance:g}",
        f"seed={seed}",
    ]
    return (stems if name == "stems_per_m2" else share), changes


def drive_beyond(names: Sequence[str], distance: float, number: int) -> None:
    """Print by how much each metric differs at most between the levels, by quantity."""
    for name in names or BEYOND:
        most = dict.fromkeys(MOVED, 0.0)
        ends = []
        for seed in range(number):
            value, changes = drawn(name, seed, distance)
            told = [
                run_unrecorded(load_scenario("straight", sets=[level, *changes])) for level in (CHEAP, DEAR)
            ]
            ends.append(value)
            rows = [[nan if t.get(m) is None else t[m] for t in told] for m in MOVED]
            for m, (one, other) in zip(MOVED, rows, strict=True):  # one that only one run has is moved far
                both_lack = one != one and other != other
                most[m] = max(most[m], 0.0 if both_lack else abs(np.nan_to_num(one - other, nan=inf)))
            print(
                f"{name} {value:.4g} {changes[0][12:60]}: {dict(zip(MOVED, rows, strict=True))}", flush=True
            )
        print(f"{name} {min(ends):.4g} to {max(ends):.4g}, {number} pairs: {most}", flush=True)


def catalogue(names: Sequence[str], distance: float) -> None:
    """Say of the first run of every case what it left."""
    flagged = count = 0
    for name in names or [case.name for case in find_cases("catalogue")]:
        run = next(Plan(name).runs())
        short = replace(run, sets=layered(run.sets, [f"run.distance_m={distance:g}"]))
        try:
            found = outside_of(run_unrecorded(scenario_of(short)))
        except SwathError as error:
            print(f"{name}: {error}", flush=True)
            continue
        count += 1
        flagged += bool(found)
        told = "; ".join(f"{slot} {why_outside(of)}" for slot, of in found.items()) or "inside"
        print(f"{name} {dict(run.point)}: {told}", flush=True)
    print(f"{flagged} of {count} runs flagged")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="CASE", help="or quantities with --ends")
    parser.add_argument("--ends", action="store_true")
    parser.add_argument("--beyond", action="store_true")
    parser.add_argument("--number", type=int, default=16, metavar="N", help="pairs of each quantity")
    parser.add_argument("--distance", type=float, metavar="M", help="default 10, with --ends, --beyond 25")
    args = parser.parse_args()
    if args.beyond:
        drive_beyond(args.names, args.distance or 25.0, args.number)
    elif args.ends:
        drive_ends(args.names, args.distance or 25.0)
    else:
        catalogue(args.names, args.distance or 10.0)


if __name__ == "__main__":
    main()
