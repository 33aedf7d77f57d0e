"""Dust that drifts over the scanner: what the shipped edge detector makes of it, by the wind.

python benchmarks/dust.py [--metres M] [--steps N]    N directions of the wind, three amounts of dust
"""

import argparse
from math import nan

from swath.api import load_scenario
from swath.runtime.job import run_unrecorded

DUSTS = (2.4, 24.0, 50.0)  # g/kg: the most that emission factors give, and ten and twenty times that
FIELDS = {
    "wheat": (),
    "barley, 2 m/s": (
        "field.stand.crop=barley",
        "field.weather.wind_m_s=2",
        "field.terrain.slope_percent=-3",
        "seed=12",
    ),
    "wheat of 150/m2, 5 m/s": ("field.stand.stems_per_m2=150", "field.weather.wind_m_s=5", "seed=13"),
}


def row(azimuth: float, dust: float, metres: float, field: tuple[str, ...]) -> tuple[float, ...]:
    """Of the edge in a wind towards an azimuth [deg]: availability, RMS error [m], share sure and wrong."""
    sets = [
        *field,
        f"field.weather.wind_azimuth_deg={azimuth}",
        f"combine.dust.grams_per_kg={dust}",
        f"run.distance_m={metres}",
        f"run.max_duration_s={metres}",
    ]
    told = run_unrecorded(load_scenario("drifting-dust", sets=sets))
    names = "detection_availability", "edge_rmse_m", "sure_wrong_share"
    return tuple(nan if (value := told.get(name)) is None else value for name in names)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--metres", type=float, default=24.0)
    parser.add_argument("--steps", type=int, default=8)
    asked = parser.parse_args()
    print("availability, RMS error, share of samples sure and wrong")
    for name, field in FIELDS.items():
        print(f"{name:>24}" + "".join(f"{f'{d:g} g/kg':>24}" for d in DUSTS))
        for k in range(asked.steps):
            azimuth = 360.0 * k / asked.steps
            rows = [row(azimuth, dust, asked.metres, field) for dust in DUSTS]
            cells = (f"{a:12.3f} {100 * e:5.1f} cm {s:.2f}" for a, e, s in rows)
            print(f"{azimuth:20.0f} deg" + "".join(cells), flush=True)
