"""Dust that drifts over the scanner, drawn over all axes: what the shipped edge detector makes of it.

    nice python benchmarks/dust.py [--pool building|judging] [--number 40] [--first 0] [--metres 24]

A case depends on its pool and number alone. Drawn are: crop (with a table of `empirical`), stems per m2 from
a fifth of the fewest to the most, stubble of 5 to 45 cm, where the wind blows and how fast (calm in one of
eight), dust of each kg (0.2 to 50 g, evenly in its logarithm), of each metre (0.05 to 20 g), which outlets
send it (all, header, chopper, wheels), Pasquill's class, moisture of the straw, scanner, its height and where
it looks, side, speed. Every other case, marked *, has dust before the scanner: 10 g and more
of each kg of dry straw, and a wind from behind or none. `building` has no case of what is left out while the
detector is changed: two scanners, rye, the edge on the left, mountings above 2.7 m, winds over 6 m/s, wheels
alone; `judging` has all.

Of each case, with and without its dust, from 8 m on: share of the samples with an edge, its RMS error, and
the share that is wrong and sure: an edge more than 15 cm and 3 of its own deviations off.
"""

import argparse
from collections.abc import Mapping
from typing import Any

import numpy as np
from edge_pairs import CROPS, HEIGHTS, SCANNERS, STUBBLE, TALLEST_STUBBLE, Line, Poses, errors, world_of
from edge_pairs import UNSEEN_CROP as UNSEEN
from edge_pairs import UNSEEN_HEIGHT as HIGH
from edge_pairs import UNSEEN_SCANNERS as OTHERS

from swath.runtime.loop import drive

POOLS = {"building": 76003, "judging": 91736451}
WITH_TABLE = ("wheat", "barley", "rye", "rape")
OUTLETS = ("all", "header", "chopper", "wheels")
CALM, STRONG = 1 / 8, 6.0  # share of cases; m/s from which on winds are left out
OFF_M, DEVIATIONS = 0.15, 3.0  # an edge farther off than both is wrong and sure
BEHIND = 70.0  # deg from the way driven
FACTS = (
    "{crop:6} {stems:3.0f}/m2 stubble {stubble:.2f}, wind {wind:.1f} to {towards:4.0f} {air}, {grams:4.1f} "
    "g/kg {soil:4.1f} g/m {outlet:7} {moisture:2.0f} %, {scanner} {mount:.1f} m {side}"
)


def case(pool: str, number: int) -> dict[str, Any]:
    """Facts of one case."""
    rng = np.random.default_rng([POOLS[pool], number])
    while True:
        drawn = _drawn(rng, is_hard=number % 2 == 1)
        if pool == "judging" or not is_left_out(drawn):
            return drawn


def is_left_out(drawn: Mapping[str, Any]) -> bool:
    """Of what nobody looked at while the detector was changed."""
    kinds = drawn["scanner"] in OTHERS, drawn["crop"] == UNSEEN, drawn["side"] == "left"
    return any((*kinds, drawn["mount"] > HIGH, drawn["wind"] > STRONG, drawn["outlet"] == "wheels"))


def _drawn(rng: np.random.Generator, *, is_hard: bool) -> dict[str, Any]:
    crop = str(rng.choice(WITH_TABLE, p=[0.45, 0.25, 0.15, 0.15]))
    few, many, _ = CROPS[crop]
    mount = rng.uniform(1.8, 3.6)
    least, wettest, aside = (10.0, 9.0, BEHIND) if is_hard else (0.2, 16.0, 180.0)
    return {
        "crop": crop,
        "stems": float(np.exp(rng.uniform(np.log(0.2 * few), np.log(many)))),
        "stubble": rng.uniform(STUBBLE[0], min(STUBBLE[1], TALLEST_STUBBLE * HEIGHTS[crop])),
        "towards": rng.uniform(-aside, aside),
        "wind": 0.0 if rng.uniform() < CALM else rng.uniform(0.5, 9.0),
        "grams": float(np.exp(rng.uniform(np.log(least), np.log(50.0)))),
        "soil": float(np.exp(rng.uniform(np.log(0.05), np.log(20.0)))),
        "outlet": str(rng.choice(OUTLETS, p=[0.55, 0.15, 0.15, 0.15])),
        "air": str(rng.choice(list("ABCDEF"))),
        "moisture": rng.uniform(6.0, wettest),
        "scanner": str(rng.choice(SCANNERS)),
        "mount": mount,
        "pitch": float(np.degrees(np.arctan2(mount, rng.uniform(6.0, 11.0)))),
        "side": str(rng.choice(["left", "right"])),
        "speed": rng.uniform(4.0, 9.0),
        "seed": int(rng.integers(1000, 10**6)),
    }


def sets_of(drawn: Mapping[str, Any], metres: float, *, dusty: bool) -> dict[str, Any]:
    """Settings of `straight` for a case."""
    d, outlet = drawn, drawn["outlet"]
    dust = {
        "grams_per_kg": 0.0 if outlet == "wheels" else d["grams"],
        "soil_g_per_m": d["soil"] if outlet in ("all", "wheels") else 0.0,
        "header_percent": {"header": 100.0, "chopper": 0.0}.get(outlet, 30.0),
        "stability": d["air"],
    }
    return {
        "run.distance_m": metres,
        "run.max_duration_s": metres,
        "seed": d["seed"],
        "combine.edge_side": d["side"],
        "field.edge.crop_side": "right" if d["side"] == "left" else "left",
        "combine.speed.speed_kmh": d["speed"],
        "combine.lidar.sensor": d["scanner"],
        "combine.lidar.mount.z_m": d["mount"],
        "combine.lidar.mount.pitch_deg": d["pitch"],
        "field.stand.crop": d["crop"],
        "field.stand.stems_per_m2": d["stems"],
        "field.stand.straw_moisture_percent": d["moisture"],
        "field.edge.stubble_height_m": d["stubble"],
        "field.weather": {"wind_m_s": d["wind"], "wind_azimuth_deg": d["towards"]},
        **({"combine.dust": dust} if dusty else {}),
    }


def told(drawn: Mapping[str, Any], metres: float, *, dusty: bool) -> tuple[float, float, float, float]:
    """Availability, RMS error [m], share wrong and sure, way driven [m]."""
    world = world_of(sets_of(drawn, metres, dusty=dusty), "likelihood_ratio", "empirical")
    watch = Poses()
    drive(world, [watch])
    rows = np.array(errors(Line.of(world), watch.at, watch.told)).reshape(-1, 4)
    error, sd, found = np.abs(rows[:, 1]), rows[:, 2], np.isfinite(rows[:, 1])
    off = found & (error > OFF_M) & (error > DEVIATIONS * sd)
    way = max(at for _, at in watch.at.values())
    if not len(rows):
        return 0.0, float("nan"), 0.0, way
    rms = float(np.sqrt(np.mean(error[found] ** 2))) if found.any() else float("nan")
    return float(found.mean()), rms, float(off.mean()), way


def main() -> None:
    """A line for each case, then what all come to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pool", choices=POOLS, default="building")
    parser.add_argument("--number", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--metres", type=float, default=24.0)
    asked = parser.parse_args()
    print("case: availability, RMS error [cm], wrong and sure, way [m]; then the same without dust")
    rows = []
    for number in range(asked.first, asked.first + asked.number):
        drawn = case(asked.pool, number)
        pair = [told(drawn, asked.metres, dusty=dusty) for dusty in (True, False)]
        rows.append(pair)
        hard = "*" if number % 2 else " "
        cells = " | ".join(f"{a:.2f} {100 * e:5.1f} {w:.2f} {way:4.1f}" for a, e, w, way in pair)
        facts = FACTS.format(**drawn)
        print(f"{number:3}{hard}{cells} | {facts}", flush=True)
    table = np.array(rows)
    for name, of in zip(("dust", "clear"), table.transpose(1, 2, 0), strict=True):
        share, rms, wrong, way = of
        error = f"RMS error median {100 * np.nanmedian(rms):.1f} cm, over 15 cm {np.sum(rms > OFF_M)}"
        sure = f"wrong and sure {100 * wrong.mean():.2f} % of the samples, in {np.sum(wrong > 0)} cases"
        early = np.sum(way < asked.metres - 1.0)
        print(f"{name}: availability {share.mean():.3f}; {error}; {sure}; stopped early {early}")


if __name__ == "__main__":
    main()
