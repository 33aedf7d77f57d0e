"""Closed loops over crops, densities, slopes and bends: how well the edge is found and followed.

    python benchmarks/edge.py [--table runs|crops|dust|wind|terrain|dem|rows] [--metres 60] [--workers 2]
        [--set KEY=VALUE ...]

Prints a Markdown table [cm]. Wind: the mean of three seeds, terrain, dem and rows of
two. `dem`: measured heights of SWATH_DATA where they are steepest, as they are and 1.6 times as high.
"""

import argparse
import cmath
import math
import os
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from swath.runtime.assembly import assemble
from swath.runtime.evaluation import make_evaluation
from swath.runtime.loop import drive
from swath.scenario.scenario import load_scenario

BARLEY = ("field.stand.crop=barley", "field.edge.stubble_height_m=0.15")
CASES: dict[str, tuple[str, tuple[str, ...]]] = {
    "wheat, 200 /m2": ("straight", ("field.stand.stems_per_m2=200",)),
    "wheat, 300": ("straight", ("field.stand.stems_per_m2=300",)),
    "wheat, 500": ("straight", ()),
    "wheat, 700": ("straight", ("field.stand.stems_per_m2=700",)),
    "barley, 400": ("straight", (*BARLEY, "field.stand.stems_per_m2=400")),
    "barley, 775": ("straight", BARLEY),
    "rye, 250": ("straight", ("field.stand.crop=rye", "field.stand.stems_per_m2=250")),
    "rye, 500": ("straight", ("field.stand.crop=rye",)),
    "oilseed rape": ("straight", ("field.stand.crop=rape",)),
    "oilseed rape, seed 2": ("straight", ("field.stand.crop=rape", "seed=2")),
    "wheat 500, slope 5 % up to the crop": ("straight", ("field.terrain.slope_percent=5",)),
    "wheat 500, slope 5 % down to the crop": ("straight", ("field.terrain.slope_percent=-5",)),
    "`bend`, R = 40 m, left": ("bend", ("run.distance_m=140",)),
    "`bend`, left, seed 2": ("bend", ("run.distance_m=140", "seed=2")),
    "`bend`, left, seed 3": ("bend", ("run.distance_m=140", "seed=3")),
    "`bend`, right": ("bend", ("run.distance_m=140", "field.edge.angle_deg=-60")),
    "`laser-pilot`": ("laser-pilot", ("run.distance_m=130",)),
}
COLUMNS = {
    "edge bias": "edge_bias_m",
    "edge RMSE": "edge_rmse_m",
    "lateral bias": "lateral_bias_m",
    "lateral RMS": "lateral_rms_m",
}
SHORT = {
    "found": "detection_availability",
    "edge RMSE": "edge_rmse_m",
    "edge bias": "edge_bias_m",
    "lateral RMS": "lateral_rms_m",
}
FEW_RAYS = ("run.distance_m=12", "combine.lidar.sub_rays=7", "combine.lidar.sector_deg=[-45,45]")
TALL_STUBBLE = "field.edge.stubble_height_m=0.3"
CROPS: dict[str, tuple[str, ...]] = {
    "wheat": (),
    "wheat with weeds, 40 /m2 of 0.5 m": (
        "field.stand.weeds.plants_per_m2=40",
        "field.stand.weeds.height_m=0.5",
    ),
    "barley": BARLEY,
    "rye": ("field.stand.crop=rye", "field.edge.stubble_height_m=0.25"),
    "rape": ("field.stand.crop=rape", TALL_STUBBLE),
    "maize": ("field.stand.crop=maize", TALL_STUBBLE),
}
DUST_RAYS = ("run.distance_m=16", "combine.lidar.sub_rays=7")
PUFFS = "combine.lidar.weather.near_returns"
DUST: dict[str, tuple[str, ...]] = {
    f"{crop}, {puffs:g}": (f"field.stand.crop={crop}", f"{PUFFS}={puffs:g}")
    for crop in ("wheat", "rye")
    for puffs in (0, 0.1, 0.3, 0.6)
} | {"wheat, 0.3, reach 2.5 m": (f"{PUFFS}=0.3", "combine.lidar.weather.near_reach_m=2.5")}
WINDS = {
    "none": (),
    "5 m/s along the edge": (5, 0),
    "3 m/s into the crop": (3, 90),
    "5 m/s into the crop": (5, 90),
    "8 m/s into the crop": (8, 90),
    "5 m/s out over the edge": (5, -90),
    "8 m/s out over the edge": (8, -90),
    "5 m/s out over the edge, `steady_deg: 0`": (5, -90, 0),
}
LEVEL = "field.terrain={level: plane}"
ROLLING = "field.terrain={{level: formula, waves: [{{amplitude_m: {}, wavelength_m: {}, azimuth_deg: 30}}]}}"
SLOPING = "field.terrain={{level: formula, slope_percent: {}, slope_azimuth_deg: {}}}"
TERRAIN: dict[str, str] = {
    "level": LEVEL,
    "waves of 0.5 m over 40 m": ROLLING.format(0.5, 40),
    "waves of 0.3 m over 15 m": ROLLING.format(0.3, 15),
    "side slope, 10 % up to the crop": SLOPING.format(10, 90),
    "side slope, 10 % down to the crop": SLOPING.format(-10, 90),
    "10 % uphill": SLOPING.format(10, 0),
    "10 % downhill": SLOPING.format(-10, 0),
}
MEASURED = Path("wheat_combine_logs_msu", "si", "farmerI_henrys_terrain_4m_utm12n.tif")
STEEPEST = (334.0, 830.0)  # in it, from its middle [m]: 5.3 % up to the south over 60 m, 6.9 % at most
STEEPER = 1.6  # slopes of 8.5 % over 60 m, 11 % at most
HEADINGS = {"crop above": 0, "crop below": 180, "uphill": -90, "downhill": 90}  # the crop is on the right
ROWS = (0, 20, 90)  # of the rows, and so of the tiles, against the edge [deg]
THIN = (60, 200, 500)  # [1/m2]
WIND_KEYS = ("speed_m_s", "azimuth_deg", "steady_deg")
SEEDS = (1, 2, 3)  # of a wind
TWO_SEEDS = (1, 2)  # of a terrain, of rows

Case = tuple[str, tuple[str, ...]]


def judge(case: Case) -> dict[str, float]:
    """The metrics of one run [m], 1."""
    name, sets = case
    world = assemble(load_scenario(name, sets=list(sets)))
    evaluation = make_evaluation(world)
    drive(world, [evaluation])
    return {**evaluation.metrics("combine"), **evaluation.metrics("field")}


def measured_slopes(folder: Path, metres: float) -> dict[str, list[Case]]:
    """Straight edges through the steepest place of the measured heights.

    folder: where the steeper map is written
    """
    import rasterio

    source = Path(os.environ["SWATH_DATA"], MEASURED)
    steeper = folder / "steeper.tif"
    with rasterio.open(source) as map_:
        values, profile = map_.read(1, masked=True).filled(float("nan")), map_.profile
    with rasterio.open(steeper, "w", **{**profile, "nodata": float("nan")}) as map_:
        map_.write(STEEPER * values, 1)
    cases = {}
    for name, file in (("measured", source), (f"{STEEPER:g} times as high", steeper)):
        for way, heading in HEADINGS.items():
            start = complex(*STEEPEST) - cmath.rect(0.5 * metres, math.radians(heading))
            place = f"x_m: {start.real:.1f}, y_m: {start.imag:.1f}, heading_deg: {heading}"
            sets = (f"field.terrain={{level: dem, file: {file}}}", f"field.edge={{shape: straight, {place}}}")
            cases[f"{name}, {way}"] = [
                ("straight", (f"run.distance_m={metres:g}", *sets, f"seed={seed}")) for seed in TWO_SEEDS
            ]
    return cases


def cases_of(table: str, metres: float) -> dict[str, list[Case]]:
    """The runs of each row."""
    if table == "crops":
        return {name: [("straight", (*FEW_RAYS, *sets))] for name, sets in CROPS.items()}
    if table == "dust":
        return {name: [("straight", (*DUST_RAYS, *sets))] for name, sets in DUST.items()}
    if table == "wind":
        winds = {
            name: tuple(
                f"field.stand.wind.{key}={value}" for key, value in zip(WIND_KEYS, wind, strict=False)
            )
            for name, wind in WINDS.items()
        }
        return {
            name: [("straight", (*FEW_RAYS, *sets, f"seed={seed}")) for seed in SEEDS]
            for name, sets in winds.items()
        }
    if table == "terrain":
        short = {"laser-pilot": (), "straight": (f"run.distance_m={metres:g}",)}
        return {
            f"`{run}`, {name}": [(run, (*sets, ground, f"seed={seed}")) for seed in TWO_SEEDS]
            for run, sets in short.items()
            for name, ground in TERRAIN.items()
        }
    if table == "dem":
        return measured_slopes(Path(tempfile.mkdtemp()), metres)
    if table == "rows":
        stand = "field.stand.stems_per_m2={}", "field.stand.row_azimuth_deg={}"
        return {
            f"{density} /m2, rows turned by {turned} deg": [
                ("straight", (f"run.distance_m={metres:g}", stand[0].format(density),
                              stand[1].format(turned), f"seed={seed}"))
                for seed in TWO_SEEDS
            ]
            for density in THIN
            for turned in ROWS
        }  # fmt: skip
    length = {"straight": (f"run.distance_m={metres:g}",)}
    return {name: [(run, (*length.get(run, ()), *sets))] for name, (run, sets) in CASES.items()}


def text_of(key: str, runs: list[dict[str, float]]) -> str:
    """A cell: centimetres, with a sign where it is a bias, or percent."""
    mean = 100.0 * sum(run[key] for run in runs) / len(runs)
    if key == "detection_availability":
        return f"{mean:.0f} %"
    return f"{mean:+.1f}" if "bias" in key else f"{mean:.1f}"


def main() -> None:
    """Run all cases, print a row each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    tables = ("runs", "crops", "dust", "wind", "terrain", "dem", "rows")
    parser.add_argument("--table", choices=tables, default="runs")
    parser.add_argument("--metres", type=float, default=60.0, help="length of the straight runs")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--set", action="append", default=[], dest="sets", metavar="KEY=VALUE")
    args = parser.parse_args()
    columns = {"runs": COLUMNS, "terrain": SHORT | COLUMNS, "dem": SHORT | COLUMNS}.get(args.table, SHORT)
    rows = cases_of(args.table, args.metres)
    runs = [(run, (*sets, *args.sets)) for row in rows.values() for run, sets in row]
    print(f"| | {' | '.join(columns)} |\n|---{'|---' * len(columns)}|")
    with ProcessPoolExecutor(args.workers) as pool:
        done = pool.map(judge, runs)
        for label, row in rows.items():
            found = [next(done) for _ in row]
            print(f"| {label} | {' | '.join(text_of(key, found) for key in columns.values())} |", flush=True)


if __name__ == "__main__":
    main()
