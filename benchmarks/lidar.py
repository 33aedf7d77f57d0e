"""CPU time of a scan at each LiDAR level that needs no measured file, and its ratio to `plants`.

A scanner drives along the edge of wheat as in the scenario `straight`; 37 sub-rays; the levels take turns.
"""

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import numpy as np
from _harness import interleave, machine, median, write_json

SCANS = 24  # of each level in a round
CASES = (  # name of the case, sector, step [deg]
    ("120 deg at 0.5 deg", [-60, 60], 0.5),
    ("120 deg at 0.167 deg", [-60, 60], 1 / 6),
    ("190 deg at 0.167 deg", None, 1 / 6),
)


def make(level: str, sector: Any, step: float, density: float | None = None) -> Any:
    """The scanner of the scenario at a level, and the work of SCANS scans with it."""
    from swath.core.random import Stream
    from swath.runtime.assembly import assemble
    from swath.scenario.scenario import load_scenario

    keys = {"sector_deg": sector, "step_deg": step} | ({"sub_rays": 37} if level == "plants" else {})
    sets = [f"combine.lidar.level={level}"]
    sets += [f"combine.lidar.{k}={'null' if v is None else v}" for k, v in keys.items()]
    sets += [] if density is None else [f"field.stand.stems_per_m2={density}"]
    lidar = assemble(load_scenario("straight", sets=sets, flags={})).leader.parts["lidar"]
    lidar.reset(Stream(1, "bench"))
    start, count = lidar.setup.start, len(lidar.azimuth)
    rotation = np.repeat((start.rotation @ lidar.mounting.rotation)[None], count, 0)
    places = start.apply(lidar.mounting.position) + 0.08 * np.arange(SCANS)[:, None] * [0.0, 1.0, 0.0]
    places[:, 1] += 30.0
    places[:, 2] += lidar.setup.field.ground_height(places[:, 0], places[:, 1])
    origins = [np.repeat(place[None], count, 0) for place in places]

    def work() -> None:
        for k, origin in enumerate(origins):
            lidar.scan_from(10**9 + k, origin, rotation)

    return work, count


def main(out_dir: Path | str = "out/bench", *, rounds: int = 9) -> dict[str, Any]:
    """Measures, prints a table, writes lidar.json; returns its content."""
    from rich.console import Console
    from rich.table import Table

    rows = []
    table = Table(title="CPU time of a scan, 37 sub-rays, LMS511 HR", title_justify="left")
    for name in ("case", "beams", "plants ms", "empirical ms", "plants / empirical"):
        table.add_column(name, justify="right")
    for name, sector, step in CASES:
        jobs, count = {}, 0
        for level in ("plants", "empirical"):
            jobs[level], count = make(level, sector, step)
        times = interleave(jobs, rounds=rounds)
        ratios = [p / e for p, e in zip(times["plants"], times["empirical"], strict=True)]
        ms = {level: 1e3 * median(t) / SCANS for level, t in times.items()}
        rows.append({"case": name, "beams": count, "ms": ms, "ratio": median(ratios),
                     "ratio_min": min(ratios), "ratio_max": max(ratios)})  # fmt: skip
        table.add_row(name, str(count), *(f"{ms[k]:.2f}" for k in jobs), f"{median(ratios):.0f}")
    Console().print(table)
    data = {
        "what": "CPU seconds (user + system) per scan",
        "rounds": rounds,
        "machine": machine(),
        "rows": rows,
    }
    write_json(Path(out_dir), "lidar", data)
    return data


if __name__ == "__main__":
    main(*sys.argv[1:2])
