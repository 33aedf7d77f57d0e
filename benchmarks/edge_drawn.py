"""What hard edges shall come to, on values drawn at random within each row's ranges.

    python benchmarks/edge_drawn.py --out runs.jsonl [--number 20] [--rows NAME ...] [--pool training]
                                    the same line goes on after a stop: runs that the file holds stay
    python benchmarks/edge_drawn.py --table runs.jsonl
    python benchmarks/edge_drawn.py --figure reliability.png --table runs.jsonl

A run is a line of JSON; `--table` prints what the lines hold, and `--rows` picks rows by how their names
begin. Draws depend on the pool, the row and the number alone: pools `judged` and
`second` to `eighth` judge, each drawn after changes to the detector; `training` is for setting constants.
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass
from math import erf
from pathlib import Path
from typing import Any

import numpy as np
from edge_hard import DENSITY, DUST, EDGE, SLOPE, STAND, Watch, bend, gap, lean, patch, teeth, wind

from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import load_scenario

POOLS = {
    "judged": 5021, "training": 7, "second": 9377, "third": 80211, "fourth": 66391, "fifth": 907531,
    "sixth": 350617, "seventh": 774193, "eighth": 118409,
}  # fmt: skip
Draw = Callable[[np.random.Generator], dict[str, Any]]
Run = dict[str, Any]
DISTANCE = 46.0
SECOND = {  # beside the one at the left end: at the right end, across the header from over the crop
    "combine.lidar": "off",
    "combine.lidar_left": {"level": "plants", "mount": {"at": "left_end"}},
    "combine.lidar_right": {
        "level": "plants", "mount": {"at": "right_end", "z_m": 3.0, "pitch_deg": 14, "yaw_deg": -30},
    },
    "combine.edge": {"level": "joined", "wires": {"left": "lidar_left.scan", "right": "lidar_right.scan"}},
}  # fmt: skip


@dataclass(frozen=True)
class Row:
    """A line of the table: what varies, the mark in words, and whether a run meets it."""

    draw: Draw
    mark: str
    holds: Callable[[Run], bool]


def within(p95: float = np.inf, worst: float = np.inf) -> Callable[[Run], bool]:
    return lambda r: r["p95"] <= p95 and r["worst"] <= worst and not r["is_stopped"]


def or_stops(holds: Callable[[Run], bool]) -> Callable[[Run], bool]:
    return lambda r: r["is_stopped"] or holds(r)


def found(p95: float) -> Callable[[Run], bool]:
    return lambda r: r["found"] >= 0.9 and within(p95)(r)


def unsure(r: Run) -> bool:
    return r["sure"] == 0.0 and r["speed"] <= 5.0


def side(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def notch(r: Run) -> bool:
    return r["worst"] <= 30.0 and r["late"] <= 10.0 and not r["is_stopped"]


def ditch(depth: tuple[float, float], length: tuple[float, float], **more: Any) -> Draw:
    def draw(rng: np.random.Generator) -> dict[str, Any]:
        start = rng.uniform(20, 24)
        return {**gap(start, start + rng.uniform(*length), rng.uniform(*depth)), **more}

    return draw


def lodged(toward: float) -> Draw:
    def draw(rng: np.random.Generator) -> dict[str, Any]:
        radius, azimuth = rng.uniform(2.5, 4.5), toward * rng.uniform(60, 120)
        return patch(rng.uniform(-0.5, 2.0), rng.uniform(24, 28), radius, rng.uniform(40, 65), azimuth)

    return draw


def dust(rng: np.random.Generator) -> dict[str, Any]:
    near, reach, loss = rng.uniform(0.3, 0.7), rng.uniform(1.5, 2.5), rng.uniform(0.2, 0.5)
    return {DUST: {"near_returns": near, "near_reach_m": reach, "extinction_per_m": loss}}


def low(rng: np.random.Generator) -> dict[str, Any]:
    tall, stubble = rng.uniform(0.45, 0.5), rng.uniform(0.22, 0.25)
    return {f"{STAND}.height_factor": tall, f"{EDGE}.stubble_height_m": stubble}


ROWS = {
    "straight, 100 to 500 stems/m2": Row(
        lambda rng: {DENSITY: rng.uniform(100, 500)}, "95 % <= 8, RMS <= 3.5 cm",
        lambda r: within(8.0)(r) and r["rms"] <= 3.5,
    ),
    "R = 15 to 20 m, both sides": Row(
        lambda rng: bend(rng.uniform(15, 20), side(rng) * 75), "95 % <= 8 cm", within(8.0)
    ),
    "R = 12 to 14 m, both sides": Row(
        lambda rng: bend(rng.uniform(12, 14), side(rng) * 80), "95 % <= 25 cm", within(25.0)
    ),
    "45 to 60 stems/m2": Row(
        lambda rng: {DENSITY: rng.uniform(45, 60)}, "found >= 90 % and 95 % <= 10 cm, or stops",
        or_stops(found(10.0)),
    ),
    "notch, 0.8 to 1.3 m deep": Row(
        ditch((0.8, 1.3), (1.5, 4.0)), "worst <= 30 cm, 10 cm after 3 m", notch
    ),
    "100 stems/m2 and a gap of 2 to 5 m": Row(
        ditch((2.0, 5.0), (2.0, 5.0), **{DENSITY: 100}), "worst <= 30 cm, 10 cm after 3 m", notch
    ),
    "gap of 3 to 6 m": Row(ditch((5.0, 5.0), (3.0, 6.0)), "worst <= 10 cm", within(worst=10.0)),
    "gap of 10 to 14 m": Row(
        ditch((5.0, 5.0), (10.0, 14.0)), "stops, or worst <= 30 cm", or_stops(within(worst=30.0))
    ),
    "teeth, 0.2 to 0.3 m": Row(
        lambda rng: teeth(rng.uniform(0.2, 0.3), rng.uniform(2, 5), "random"), "worst <= 30 cm",
        within(worst=30.0),
    ),
    "saw, 0.4 to 0.6 m": Row(
        lambda rng: teeth(rng.uniform(0.4, 0.6), rng.uniform(4, 8), "sawtooth"), "worst <= 30 cm",
        within(worst=30.0),
    ),
    "lodged patch leans out": Row(
        lodged(-1.0), "worst <= 30 cm, or not sure where it is more", lambda r: r["wrong"] < 1.0
    ),
    "lodged patch leans in": Row(
        lodged(1.0), "worst <= 30 cm, or not sure where it is more", lambda r: r["wrong"] < 1.0
    ),
    "stand leans 30 to 45 deg in": Row(
        lambda rng: lean(rng.uniform(30, 45), rng.uniform(70, 110)), "95 % <= 10 cm", within(10.0)
    ),
    "stand leans 30 to 45 deg out": Row(
        lambda rng: lean(rng.uniform(30, 45), -rng.uniform(70, 110)), "never sure, <= 5 km/h", unsure
    ),
    "the same, two scanners and level joined": Row(
        lambda rng: {**lean(rng.uniform(30, 45), -rng.uniform(70, 110)), **SECOND}, "95 % <= 15 cm",
        within(15.0),
    ),
    "0.38 to 0.42 m over stubble 0.25 m": Row(
        low, "found and 95 % <= 10 cm, or stops", or_stops(found(10.0))
    ),
    "dense dust": Row(dust, "found and 95 % <= 10 cm, or stops", or_stops(found(10.0))),
    "side slope, 8 to 15 %": Row(
        lambda rng: {SLOPE: side(rng) * rng.uniform(8, 15)}, "95 % <= 10 cm", within(10.0)
    ),
    "wind, 5 to 8 m/s": Row(
        lambda rng: wind(rng.uniform(5, 8), rng.uniform(-180, 180)), "95 % <= 15 cm", within(15.0)
    ),
}  # fmt: skip
HEAD = ("row", "shall be", "held", "95 % [cm]", "worst [cm]", "sure and wrong [m]", "errors in 95 % band")


def run(name: str, number: int, pool: str, level: str) -> Run:
    """One drawn run, as numbers; errors and distances in cm and m."""
    rng = np.random.default_rng([POOLS[pool], list(ROWS).index(name), number])
    drawn = ROWS[name].draw(rng)
    sets = {
        "run.distance_m": DISTANCE,
        "combine.edge": level,
        **drawn,
        "seed": int(rng.integers(1000, 10**6)),
    }
    world = assemble(load_scenario("straight", sets=[f"{k}={json.dumps(v)}" for k, v in sets.items()]))
    watch = Watch(world)
    drive(world, [watch])
    hole = drawn.get(f"{EDGE}.gaps", [{}])[0]
    return {"row": name, "number": number, "sets": sets, **watch.numbers(hole.get("end_m", np.nan) + 3.0)}


def drawn_before(file: Path) -> set[tuple[str, int]]:
    """(row, number) of the runs that a file holds; a line that a stop cut short is taken out of it."""
    lines = file.read_text().splitlines(keepends=True) if file.exists() else []
    whole = [line for line in lines if line.endswith("\n")]
    if len(whole) < len(lines):
        file.write_text("".join(whole))
    return {(run["row"], run["number"]) for run in map(json.loads, whole)}


def rows_of(names: list[str]) -> list[str]:
    """Rows whose names begin with one of these, all where there is none."""
    return [row for row in ROWS if not names or any(row.startswith(name) for name in names)]


def table(runs: list[Run]) -> list[list[str]]:
    """The lines of the table: medians, and the worst in brackets."""
    lines = []
    for name, row in ROWS.items():
        mine = [r for r in runs if r["row"] == name]
        if not mine:
            continue
        held = sum(row.holds(r) for r in mine)
        seen = samples_of(mine)
        share = np.mean(np.abs(seen[:, 0]) < 1.96 * seen[:, 1]) if len(seen) else np.nan
        columns = [np.array([r[key] for r in mine], dtype=float) for key in ("p95", "worst", "wrong")]
        both = [f"{np.nanmedian(c):.1f} ({np.nanmax(c):.1f})" for c in columns]
        lines.append([name, row.mark, f"{held} of {len(mine)}", *both, f"{share:.2f}"])
    return lines


def samples_of(runs: list[Run]) -> np.ndarray:
    """(error [m], its standard deviation [m], confidence), (n, 3), of detectors that tell a deviation."""
    seen = np.concatenate([np.reshape(np.array(r["samples"], dtype=float), (-1, 3)) for r in runs])
    return seen[np.isfinite(seen[:, 1])]


def reliability(runs: list[Run]) -> tuple[list[float], list[float]]:
    """(share of the errors that shall lie within k standard deviations, share that does), pooled."""
    seen = samples_of(runs)
    ratio = np.abs(seen[:, 0]) / seen[:, 1]
    ks = np.linspace(0.1, 3.0, 30)
    return [erf(k / np.sqrt(2.0)) for k in ks], [float(np.mean(ratio < k)) for k in ks]


def figure(runs: list[Run], path: Path) -> None:
    """Reliability of the standard deviation and of the confidence."""
    import matplotlib.pyplot as plt

    seen = samples_of(runs)
    fig, (left, right) = plt.subplots(1, 2, figsize=(9, 4.2), layout="constrained")
    left.plot([0, 1], [0, 1], color="0.7")
    left.plot(*reliability(runs), marker="o", markersize=3)
    left.set(
        xlabel="share within k standard deviations, normal", ylabel="share of the errors", title="offset_sd"
    )
    bins = np.clip((seen[:, 2] * 10).astype(int), 0, 9)
    good = np.abs(seen[:, 0]) <= 0.10
    used = [b for b in range(10) if np.count_nonzero(bins == b) >= 20]
    right.plot([0, 1], [0, 1], color="0.7")
    right.plot([seen[bins == b, 2].mean() for b in used], [good[bins == b].mean() for b in used], marker="o")
    right.set(xlabel="confidence", ylabel="share of the errors <= 0.10 m", title="confidence")
    fig.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description="Hard edges on values drawn at random.")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--table", type=Path)
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--number", type=int, default=20)
    parser.add_argument("--rows", nargs="+", default=[], help="beginnings of the names of rows")
    parser.add_argument("--pool", default="judged", choices=list(POOLS))
    parser.add_argument("--level", default="likelihood_ratio")
    options = parser.parse_args()
    rows = rows_of(options.rows)
    if not rows:
        parser.error(f"--rows {options.rows}: expected beginnings of {', '.join(ROWS)}")
    if options.out:
        known = drawn_before(options.out)
        for number, name in [(n, r) for n in range(options.number) for r in rows if (r, n) not in known]:
            with options.out.open("a") as file:
                print(json.dumps(run(name, number, options.pool, options.level)), file=file, flush=True)
    if options.table:
        runs = [json.loads(line) for line in options.table.read_text().splitlines()]
        runs = [r for r in runs if r["row"] in rows]
        print("| " + " | ".join(HEAD) + " |\n" + "|---" * len(HEAD) + "|")
        for line in table(runs):
            print("| " + " | ".join(line) + " |")
        wanted, met = reliability(runs)
        print(
            f"\nwithin 1.96 standard deviations, all rows: {np.interp(erf(1.96 / 2**0.5), wanted, met):.3f}"
        )
        if options.figure:
            figure(runs, options.figure)


if __name__ == "__main__":
    main()
