"""Closed loops over crops, densities, slopes and bends: how well the edge is found and followed.

    python benchmarks/edge.py [--metres 60] [--workers 2] [--set KEY=VALUE ...]

Prints the Markdown table of docs/control.md: bias and RMSE of the edge, bias and RMS of the header end [cm].
"""

import argparse
from concurrent.futures import ProcessPoolExecutor

from swath.sim.loop import drive
from swath.sim.scenario import load_scenario
from swath.sim.world import assemble
from swath.study.referee import Referee

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
COLUMNS = ("edge_bias_m", "edge_rmse_m", "lateral_bias_m", "lateral_rms_m")


def judge(case: tuple[str, tuple[str, ...]]) -> list[float]:
    """The four metrics of one run [m]."""
    name, sets = case
    world = assemble(load_scenario(name, sets=list(sets)))
    referee = Referee(world.field, world.leader.recorded(), overlap=world.leader.overlap)
    drive(world, [referee])
    metrics = referee.metrics()
    return [metrics[name] for name in COLUMNS]


def main() -> None:
    """Run all cases, print a row each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--metres", type=float, default=60.0, help="length of the straight runs")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--set", action="append", default=[], dest="sets", metavar="KEY=VALUE")
    args = parser.parse_args()
    cases = [
        (
            scenario,
            (*((f"run.distance_m={args.metres:g}",) if scenario == "straight" else ()), *sets, *args.sets),
        )
        for scenario, sets in CASES.values()
    ]
    print("| | edge bias | edge RMSE | lateral bias | lateral RMS |\n|---|---|---|---|---|")
    with ProcessPoolExecutor(args.workers) as pool:
        for label, row in zip(CASES, pool.map(judge, cases), strict=True):
            bias, rmse, beside, rms = (100.0 * value for value in row)
            print(f"| {label} | {bias:+.1f} | {rmse:.1f} | {beside:+.1f} | {rms:.1f} |", flush=True)


if __name__ == "__main__":
    main()
