"""Memory of a long run: resident bytes of the process after so many metres, and the size of its folder.

python benchmarks/memory.py [--level plants] [--distance 2000] [--record exact] [--set KEY=VALUE ...]

`straight` along an edge that is longer than the run, in this process, on one thread. Before each reading
Python's collector runs and the C library gives back what it has free, so what is counted is what is held.
Prints a table, writes memory.json.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
os.environ.setdefault("SWATH_THREADS", "1")

from _harness import machine, resident_bytes, write_json

from swath.api import load_scenario
from swath.core.schedule import NS
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.job import run_job
from swath.runtime.loop import driven_m
from swath.signals import Signal
from swath.terminal.tables import table as print_table

AT_M = (10.0, 125.0, 250.0, 500.0, 750.0, 1000.0, 1250.0, 1500.0, 1750.0, 2000.0)
LOOK_NS = NS // 2  # between two looks at the distance


class Memory(RunHook):
    """Reads the memory of the process once the machine has driven each of some distances [m]."""

    def __init__(self, at_m: Sequence[float]) -> None:
        self.rows: list[dict[str, float]] = []
        self._left, self._next = list(at_m), 0

    def begin(self, run: ActiveRun) -> None:
        self._run = run
        run.observers.append(self._look)

    def _look(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        if t < self._next or not self._left:
            return
        self._next = t + LOOK_NS
        if driven_m(self._run.world) < self._left[0]:
            return
        folder = self._run.out or Path()
        pages = self._run.world.field.pages
        self.rows.append(
            {
                "driven_m": self._left.pop(0),
                "simulated_s": t / NS,
                "resident_mb": resident_bytes() / 1e6,
                "pages_mb": sum(v.nbytes for v in vars(pages).values() if hasattr(v, "nbytes")) / 1e6,
                "folder_mb": sum(file.stat().st_size for file in folder.iterdir()) / 1e6,
            }
        )


def measure(level: str, distance_m: float, sets: Sequence[str], record: str) -> list[dict[str, float]]:
    """Rows of a run."""
    texts = [
        f"run.distance_m={distance_m:g}",
        f"run.max_duration_s={2.0 * distance_m:g}",
        f"run.record={record}",
        f"field.edge.length_m={distance_m + 100.0:g}",
        f"combine.lidar.level={level}",
        *sets,
    ]
    hook = Memory([m for m in AT_M if m < distance_m] + [distance_m - 2.0])
    with tempfile.TemporaryDirectory() as folder:
        run_job(load_scenario("straight", sets=texts), Path(folder) / "run", hooks=[hook])
    return hook.rows


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure, print, write memory.json."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--level", default="empirical", help="of the LiDAR (default: %(default)s)")
    parser.add_argument("--distance", type=float, default=2000.0, metavar="M")
    parser.add_argument("--record", default="exact", choices=("none", "standard", "exact", "full"))
    parser.add_argument("--set", action="append", default=[], dest="sets", metavar="KEY=VALUE")
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    options = parser.parse_args(arguments)
    rows = measure(options.level, options.distance, options.sets, options.record)
    print_table(
        f"Memory of `straight`, LiDAR `{options.level}`, record `{options.record}`",
        list(rows[0]),
        [[f"{value:.1f}" for value in row.values()] for row in rows],
    )
    data = {"machine": machine(), "level": options.level, "record": options.record, "rows": rows}
    write_json(options.out, "memory", data)
    return data


if __name__ == "__main__":
    main()
