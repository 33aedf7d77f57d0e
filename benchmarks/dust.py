"""Dust that drifts over the scanner, in drawn worlds: what the shipped edge detector makes of it.

    nice python -m benchmarks.dust [--pool building|judging] [--number 40] [--first 0]

The cases are those of `benchmarks.edge_worlds`, each with dust of its own; every other one, marked *, has
dust before the scanner: 10 g and more of each kg of dry straw, and a wind from behind or none.

Of each case, with and without its dust, from 8 m on: share of the samples with an edge, its RMS error, and
the share that is wrong and sure: an edge more than 15 cm and 3 of its own deviations off.
"""

import argparse

import numpy as np
from benchmarks.edge_worlds import FIRST_SEED, METRES, Case, drawn, driven, facts_of, samples, sets_of, texts

OFF_M, DEVIATIONS = 0.15, 3.0  # an edge farther off than both is wrong and sure
MORE, LEAST = 5.0, 10.0  # hard: dust of each kg, over that of the other cases and at least [g]
BEHIND, DRY = 70.0, 9.0  # hard: deg of the wind from the way driven; the most water in the straw [%]


def told(sets: dict[str, object]) -> tuple[float, float, float, float]:
    """Availability, RMS error [m], share wrong and sure, way driven [m]."""
    row = driven(Case("", texts(sets)))
    _, error, sd, _ = samples(row).T
    found = np.isfinite(error)
    off = found & (np.abs(error) > OFF_M) & (np.abs(error) > DEVIATIONS * sd)
    way = row["way"][-1]
    if not len(error):
        return 0.0, float("nan"), 0.0, way
    rms = float(np.sqrt(np.mean(error[found] ** 2))) if found.any() else float("nan")
    return float(found.mean()), rms, float(off.mean()), way


def main() -> None:
    """A line for each case, then what all come to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pool", choices=FIRST_SEED, default="building")
    parser.add_argument("--number", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    asked = parser.parse_args()
    print("case: availability, RMS error [cm], wrong and sure, way [m]; then the same without dust")
    rows = []
    for number in range(asked.first, asked.first + asked.number):
        d = drawn(asked.pool, number) | {"air": "plume"}
        if is_hard := number % 2 == 1:
            d["plume"] |= {"grams_per_kg": max(MORE * d["plume"]["grams_per_kg"], LEAST)}
            d |= {"blows": d["blows"] * BEHIND / 180.0, "moisture": min(d["moisture"], DRY)}
        pair = [told(sets_of(d | {"air": air})) for air in ("plume", "clear")]
        rows.append(pair)
        cells = " | ".join(f"{a:.2f} {100 * e:5.1f} {w:.2f} {way:4.1f}" for a, e, w, way in pair)
        dust = "{grams_per_kg:.1f} g/kg {soil_g_per_m:.1f} g/m".format(**d["plume"])
        print(f"{number:3}{' *'[is_hard]}{cells} | {dust} {d['outlet']} | {facts_of(d)}", flush=True)
    table = np.array(rows)
    for name, of in zip(("dust", "clear"), table.transpose(1, 2, 0), strict=True):
        share, rms, wrong, way = of
        error = f"RMS error median {100 * np.nanmedian(rms):.1f} cm, over 15 cm {np.sum(rms > OFF_M)}"
        sure = f"wrong and sure {100 * wrong.mean():.2f} % of the samples, in {np.sum(wrong > 0)} cases"
        early = np.sum(way < METRES - 1.0)
        print(f"{name}: availability {share.mean():.3f}; {error}; {sure}; stopped early {early}")


if __name__ == "__main__":
    main()
