"""How often the shipped detector tells an edge while the combine's own dust drifts, by where the wind blows.

    nice python -m benchmarks.dust_wind [--steps 16] [--figure docs/figures/dust-wind.png]

`drifting-dust` over 24 m with two sources of dust, wind of 3 m/s: share of the judged samples with an edge
(`detection_availability`), and the way that was driven before it stopped.
"""

import argparse
from pathlib import Path

import numpy as np

from swath.runtime.job import run_unrecorded
from swath.scenario.scenario import load_scenario

SOURCES = (0.6, 2.4)  # usual, and the most that is given [g/kg]
WAY, WIND = 24.0, 3.0  # [m], [m/s]


def availability(grams: float, azimuth: float) -> tuple[float, float]:
    """Share of samples with an edge, and way driven [m]."""
    sets = [f"combine.dust.grams_per_kg={grams}", f"field.weather.wind_azimuth_deg={azimuth:g}"]
    sets += [f"field.weather.wind_m_s={WIND:g}", "run.max_duration_s=24"]
    told = run_unrecorded(load_scenario("drifting-dust", sets=[*sets, f"run.distance_m={WAY:g}"]))
    return told["detection_availability"], told["distance_m"]


def main() -> None:
    """Print the table, and draw it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=16)
    parser.add_argument("--figure", type=Path)
    args = parser.parse_args()
    azimuths = np.linspace(0.0, 360.0, args.steps, endpoint=False)
    found = {grams: [availability(grams, float(a)) for a in azimuths] for grams in SOURCES}
    print("| wind blows towards | " + " | ".join(f"{g:g} g/kg" for g in SOURCES) + " |\n|---|---|---|")
    for k, azimuth in enumerate(azimuths):
        cells = [f"{found[g][k][0]:.2f}, {found[g][k][1]:.0f} m" for g in SOURCES]
        print(f"| {azimuth:g} deg | {' | '.join(cells)} |")
    if args.figure is not None:
        draw(args.figure, azimuths, {g: [share for share, _ in rows] for g, rows in found.items()})


def draw(path: Path, azimuths: np.ndarray, found: dict[float, list[float]]) -> None:
    """A rose of shares; the combine drives to 0 deg, its crop is to the right."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(4.2, 4.2), subplot_kw={"projection": "polar"}, layout="constrained")
    ax.set_theta_zero_location("N")
    ax.set_theta_direction(-1)
    for (grams, shares), colour in zip(found.items(), ("#0072B2", "#D55E00"), strict=True):
        angles, values = np.radians([*azimuths, azimuths[0]]), [*shares, shares[0]]
        ax.plot(angles, values, "o-", color=colour, label=f"{grams:g} g/kg", clip_on=False)
    ax.set_rlim(0.0, 1.0)
    ax.set_rticks([0.25, 0.5, 0.75, 1.0])
    ax.set_title("edge told, by where a wind of 3 m/s blows", fontsize=9)
    ax.legend(loc="lower left", bbox_to_anchor=(-0.12, -0.08), fontsize=8, frameon=False)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
