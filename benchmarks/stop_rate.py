"""How often a machine stops in time before a person at the edge, and how often for nothing.

python benchmarks/stop_rate.py [--sensors lidar radar both] [--seeds 100] [--km 10] [--gaps] [--file FILE]

The scenario is `person-at-edge`. Every seed walks otherwise: speed, how near the machine is when the person
sets off, and how far it goes come evenly out of the ranges of WALK. A run passes when the machine stands with
at least 1 m of clearance and has touched nothing.
Without a person the machine drives pieces of PIECE_M, each with its own seed, and every stop counts. With
--gaps it enters the crop from a headland and passes a gap in every 30 m, 2 to 6 m long, 0.5 to 2.5 m deep.
Every run is a line of the file; what is there already is not run again, so it can be stopped at any time.
Shares with their interval of 95 % (Wilson).
"""

import argparse
import json
from collections.abc import Iterator
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

import swath

WALK = {"speed_kmh": (3.0, 6.0), "start_within_m": (21.0, 28.0), "beyond_m": (0.0, 2.0)}
PIECE_M = 250.0
RADAR = {"sensor": "radar-24ghz"}


def sets_of(sensors: str, level: str) -> dict[str, Any]:
    if sensors == "lidar":
        return {}
    radar = {"combine.radar": {"level": level, **RADAR}}
    if sensors == "radar":
        return radar | {"combine.objects.level": "radar", "combine.lidar": "off"}
    return radar | {"combine.objects.level": "joined"}


def walk_of(seed: int) -> list[dict[str, Any]]:
    """The obstacle of a seed."""
    draw = np.random.default_rng(seed)
    speed, within, beyond = (float(draw.uniform(*WALK[key])) for key in WALK)
    path = {"to": [[1.5 + beyond, 24.0]], "speed_kmh": speed, "start_within_m": within}
    return [{"kind": "person", "x_m": -3, "y_m": 26, "path": path}]


def jobs(args: Any) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """What a run is, and its entry of a batch; the sensors in turns."""
    for number in range(1, args.seeds + 1):
        for sensors in args.sensors:
            sets = {
                **sets_of(sensors, args.radar_level),
                "field.obstacles": walk_of(number),
                "run.record": "none",
            }
            yield _named(sensors, args, "person", number), _entry(sets, number)
    for number in range(1, int(1000.0 * args.km / PIECE_M) + 1):
        for sensors in args.sensors:
            run = {"run.distance_m": PIECE_M, "run.max_duration_s": 300, "run.record": "none"}
            sets = {**sets_of(sensors, args.radar_level), "field.obstacles": [], **run}
            if args.gaps:
                sets |= gaps_of(number)
            yield _named(sensors, args, "gaps" if args.gaps else "empty", number), _entry(sets, 1000 + number)


def gaps_of(number: int) -> dict[str, Any]:
    """The edge of a piece, and where the machine starts."""
    draw, gaps = np.random.default_rng(number), []
    for begin in np.arange(20.0, PIECE_M + 20.0, 30.0):
        start, length, depth = (float(draw.uniform(*r)) for r in ((begin, begin + 20), (2, 6), (0.5, 2.5)))
        gap = {"start_m": start, "end_m": start + length, "depth_m": depth, "stubble_height_m": 0.15}
        gaps.append(gap)
    start = {"combine.start.along_edge_m": -15.0, "combine.speed.guard.when_lost": "ignore"}
    return {"field.edge.gaps": gaps, **start}


def _named(sensors: str, args: Any, case: str, number: int) -> dict[str, Any]:
    level = "" if sensors == "lidar" else args.radar_level
    return {"sensors": sensors, "radar": level, "case": case, "number": number}


def _entry(sets: dict[str, Any], seed: int) -> dict[str, Any]:
    return {"scenario": "person-at-edge", "sets": sets, "seed": seed}


def wilson(passed: int, count: int) -> tuple[float, float]:
    z, share = 1.96, passed / count
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z * sqrt(share * (1 - share) / count + z * z / (4 * count * count)) / (1 + z * z / count)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def tell(rows: list[dict[str, Any]]) -> None:
    """The table of what is there."""
    print(
        f"{'sensors':8}{'radar':8}{'stood >= 1 m before':>22}{'95 %':>16}{'least':>9}{'touched':>9}", end=""
    )
    print(f"{'empty km':>10}{'stops':>7}")
    for kind in sorted({(r["sensors"], r["radar"]) for r in rows}):
        mine = [r for r in rows if (r["sensors"], r["radar"]) == kind]
        met = [r for r in mine if r["case"] == "person"]
        empty = [r for r in mine if r["case"] in ("empty", "gaps")]
        good = sum(r["stops"] > 0 and r["clearance"] >= 1.0 and r["contacts"] == 0 for r in met)
        text = f"{kind[0]:8}{kind[1]:8}{f'{good} of {len(met)}':>22}"
        if met:
            low, high = wilson(good, len(met))
            least = min(r["clearance"] for r in met)
            text += f"{f'{low:.3f}-{high:.3f}':>16}{least:>9.2f}{sum(r['contacts'] > 0 for r in met):>9}"
        else:
            text += 34 * " "
        way = sum(r["distance"] for r in empty) / 1000.0
        print(text + f"{way:>10.2f}{sum(r['stops'] for r in empty):>7.0f}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sensors", nargs="+", default=["lidar", "radar", "both"])
    parser.add_argument("--radar-level", default="error")
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--km", type=float, default=10.0)
    parser.add_argument("--gaps", action="store_true")
    parser.add_argument("--file", type=Path, default=Path("out/bench/stops.jsonl"))
    args = parser.parse_args()
    args.file.parent.mkdir(parents=True, exist_ok=True)
    lines = args.file.read_text(encoding="utf-8").splitlines() if args.file.exists() else []
    rows = [json.loads(line) for line in lines if line.endswith("}")]
    done = {(r["sensors"], r["radar"], r["case"], r["number"]) for r in rows}
    todo = [(name, entry) for name, entry in jobs(args) if tuple(name.values()) not in done]
    for (name, _), made in zip(todo, swath.batch([entry for _, entry in todo]), strict=True):
        metrics = made.summary
        row = name | {
            "stops": metrics["stop_count"],
            "clearance": metrics.get("least_clearance_m"),
            "contacts": metrics["contact_count"],
            "distance": metrics["distance_m"],
        }
        rows.append(row)
        with args.file.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
    tell(rows)


if __name__ == "__main__":
    main()
