"""CPU time of a scan at the LiDAR level `replay`, and its ratio to `plants`, from whose scans it was made.

A scanner stands over the edge of wheat as in the scenario `straight`, `plants` with 37 sub-rays; and how
long the grid takes to make, per echo.
"""

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import numpy as np
from _harness import interleave, machine, median, write_json

SCANS = 24  # of each level in a round
MEASURED = 120  # scans that the grid is made of, 8 cm apart
CASES = (("120 deg at 0.5 deg", "[-60, 60]", 0.5), ("190 deg at 0.167 deg", "null", 1 / 6))


def make(level: str, sector: str, step: float) -> Any:
    """The scanner of the scenario at a level."""
    from swath.core.random import Stream
    from swath.runtime.assembly import assemble
    from swath.scenario.scenario import load_scenario

    sets = [
        f"combine.lidar={{level: {level}, sensor: sick-lms511-hr, sector_deg: {sector}, step_deg: {step}}}"
    ]
    lidar = assemble(load_scenario("straight", sets=sets, flags={})).leader.parts["lidar"]
    lidar.reset(Stream(1, "bench"))
    return lidar


def place(lidar: Any, along: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Machine position, sensor origins and rotations at a place along the edge [m]."""
    start, count = lidar.setup.start, len(lidar.azimuth)
    at = start.position + np.array([0.0, along, 0.0])
    at[2] = float(lidar.setup.field.ground_height(at[0], at[1]))
    origin = at + start.rotation @ lidar.mounting.position
    rotation = start.rotation @ lidar.mounting.rotation
    return at, np.repeat(origin[None], count, 0), np.repeat(rotation[None], count, 0)


def build(plants: Any, path: Path) -> tuple[int, float]:
    """A grid of plants' scans; echoes and CPU seconds of the building alone."""
    from swath.tools.height_map.build import build_height_map
    from swath.tools.height_map.poses import make_track
    from swath.tools.height_map.source import Echoes, Source

    echoes, positions = [], []
    for k in range(MEASURED):
        at, origins, rotations = place(plants, 26.0 + 0.08 * k)
        points = plants.scan_from(k + 1, origins, rotations)["scan"].points()[:, 0]
        points = points[np.isfinite(points[:, 0])]
        echoes.append(Echoes(np.full(len(points), float(k)), points, np.full(len(points), np.nan)))
        positions.append(at)
    angles = np.tile(plants.setup.start.euler(), (MEASURED, 1))
    track = make_track(np.arange(MEASURED), positions, angles)
    source = Source("bench", track, plants.mounting, lambda: iter(echoes))
    started = time.process_time()
    grid = build_height_map(source)
    spent = time.process_time() - started
    grid.save(path)
    return sum(len(e.time) for e in echoes), spent


def main(out_dir: Path | str = "out/bench", *, rounds: int = 9) -> dict[str, Any]:
    """Measures, prints a table, writes replay.json; returns its content."""
    from rich.console import Console
    from rich.table import Table

    rows = []
    table = Table(title="CPU time of a scan, LMS511 HR; plants with 37 sub-rays", title_justify="left")
    for name in ("case", "beams", "plants ms", "replay ms", "plants / replay", "build us/echo"):
        table.add_column(name, justify="right")
    for name, sector, step in CASES:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "bench.npz"
            plants = make("plants, sub_rays: 37", sector, step)
            echo_count, spent = build(plants, path)
            replay = make(f"replay, file: '{path}'", sector, step)

        def work(lidar: Any) -> Any:
            places = [place(lidar, 30.0 + 0.08 * k)[1:] for k in range(SCANS)]

            def scans() -> None:
                for k, (origins, rotations) in enumerate(places):
                    lidar.scan_from(10**9 + k, origins, rotations)

            return scans

        times = interleave({"plants": work(plants), "replay": work(replay)}, rounds=rounds)
        ratios = [p / r for p, r in zip(times["plants"], times["replay"], strict=True)]
        ms = {level: 1e3 * median(t) / SCANS for level, t in times.items()}
        per_echo = 1e6 * spent / echo_count
        spread = {"ratio": median(ratios), "ratio_min": min(ratios), "ratio_max": max(ratios)}
        rows.append({"case": name, "beams": len(replay.azimuth), "ms": ms, "build_us_per_echo": per_echo})
        rows[-1] |= spread
        cells = f"{ms['plants']:.2f}", f"{ms['replay']:.2f}", f"{median(ratios):.0f}", f"{per_echo:.1f}"
        table.add_row(name, str(len(replay.azimuth)), *cells)
    Console().print(table)
    data = {"what": "CPU seconds (user + system)", "rounds": rounds, "machine": machine(), "rows": rows}
    write_json(Path(out_dir), "replay", data)
    return data


if __name__ == "__main__":
    main(*sys.argv[1:2])
