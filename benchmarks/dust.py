"""Dust that drifts over the scanner: what the shipped edge detector makes of it, by the wind.

python benchmarks/dust.py [--metres M] [--steps N]    N directions of the wind, two amounts of dust
"""

import argparse
from math import nan

from swath.api import load_scenario
from swath.runtime.job import run_unrecorded

DUSTS = (2.4, 24.0)  # g/kg: the most that emission factors give, and ten times that


def row(azimuth: float, dust: float, metres: float) -> tuple[float, float]:
    """Availability of the edge, and its RMS error [m], in a wind of 3 m/s towards an azimuth [deg]."""
    sets = [
        f"field.weather.wind_azimuth_deg={azimuth}",
        f"combine.dust.grams_per_kg={dust}",
        f"run.distance_m={metres}",
        f"run.max_duration_s={metres}",
    ]
    told = run_unrecorded(load_scenario("drifting-dust", sets=sets))
    return told["detection_availability"] or nan, told["edge_rmse_m"] or nan


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--metres", type=float, default=24.0)
    parser.add_argument("--steps", type=int, default=8)
    asked = parser.parse_args()
    print(f"{'wind to [deg]':>14}" + "".join(f"{f'{d:g} g/kg':>24}" for d in DUSTS))
    for k in range(asked.steps):
        azimuth = 360.0 * k / asked.steps
        rows = [row(azimuth, dust, asked.metres) for dust in DUSTS]
        print(f"{azimuth:14.0f}" + "".join(f"{a:16.3f} {100 * e:4.1f} cm" for a, e in rows), flush=True)
