"""What comes before and after a run, alone and in a batch, and what many runs cost. CPU time, one thread.

Before and after: all but the ticks; on another field with the pages that its first ticks need. A simulated
second is the difference of two runs of unlike length. `empirical` is the cheapest level of a LiDAR that sees
the crop; nothing is recorded in a batch.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
os.environ["SWATH_THREADS"] = "1"

from _harness import environment, machine, write_json

CHEAP = {"combine.lidar.level": "empirical"}
NOTHING, SHORT, LONG, SAMPLE_S = 0.1, 4.0, 24.0, 60.0  # m, m, m, s
ROUNDS, SAMPLE, RUNS, CORES = 5, 3, 1000, 2
STARTS = {
    "alone, with report and replay": [],
    "alone, without replay": ["--no-replay"],
}


@dataclass(frozen=True)
class Cost:
    """CPU time of a run and of its ticks, simulated time [s]."""

    whole: float
    ticks: float
    simulated: float


class Feed:
    """A batch whose entries are given one at a time."""

    def __init__(self) -> None:
        import swath
        from swath.core.graph import Graph

        self._entries: list[dict[str, Any]] = []
        self._batch = swath.batch(iter(self._entries.pop, {}))
        self._ticks, run = 0.0, Graph.run

        def timed(graph: Graph, *args: Any, **more: Any) -> None:
            started = time.process_time()
            run(graph, *args, **more)
            self._ticks += time.process_time() - started

        Graph.run = timed  # type: ignore[method-assign]

    def run(self, sets: dict[str, Any], seed: int) -> Cost:
        """What one run of the batch costs."""
        self._entries.append({"scenario": "straight", "sets": {**CHEAP, **sets}, "seed": seed})
        started, self._ticks = time.process_time(), 0.0
        summary = next(self._batch).summary
        return Cost(time.process_time() - started, self._ticks, float(summary["simulated_s"]))


def alone(options: list[str], folder: Path) -> float:
    """CPU time [s] of `swath run` in a process of its own, over a tenth of a metre."""
    command = "import sys; from swath.commands.main import main; main(sys.argv[1:])"
    run = ["run", "straight", "--set", "run.distance_m=0.1", "--set", "combine.lidar.level=empirical"]
    before = os.times()
    subprocess.run(
        [sys.executable, "-c", command, *run, "--out", str(folder), "--quiet", *options],
        check=True,
        capture_output=True,
        env=environment(),
    )
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def main(out_dir: Path | str = "out/bench") -> dict[str, Any]:
    """Measure, print, write batch.json."""
    from rich.console import Console
    from rich.table import Table

    found: dict[str, list[float]] = {}
    feed, fields = Feed(), ("the same field", "another field each")
    feed.run({"run.distance_m": SHORT}, 1)  # what is kept is there from now on
    seeds = iter(range(100, 10_000))
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(ROUNDS):
            for name, options in STARTS.items():
                found.setdefault(name, []).append(alone(options, Path(folder) / "run"))
            ticks = feed.run({"run.distance_m": NOTHING}, 1).ticks
            for name in fields:
                nothing, short, long = (
                    feed.run({"run.distance_m": metres}, 1 if name == fields[0] else next(seeds))
                    for metres in (NOTHING, SHORT, LONG)
                )
                found.setdefault(f"in a batch, {name}", []).append(nothing.whole - ticks)
                each = (long.whole - short.whole) / (long.simulated - short.simulated)
                found.setdefault(f"a simulated second, {name}", []).append(each)
        for _ in range(SAMPLE):
            for name in fields:
                sets = {"run.max_duration_s": SAMPLE_S, "run.distance_m": 400}
                cost = feed.run(sets, 1 if name == fields[0] else next(seeds))
                found.setdefault(f"a run of {SAMPLE_S:.0f} s, {name}", []).append(cost.whole)
    table = Table(title="CPU time, one thread, `straight`, LiDAR `empirical`", title_justify="left")
    for column in ("", "median", "least", "most"):
        table.add_column(column, justify="right" if column else "left")
    for name, values in found.items():
        low, high = min(values), max(values)
        table.add_row(name, *(f"{v:.3f} s" for v in (statistics.median(values), low, high)))
    minutes = {}
    for name in fields:
        each = statistics.median(found[f"a run of {SAMPLE_S:.0f} s, {name}"])
        minutes[name] = RUNS * each / CORES / 60.0
        what = f"{RUNS} runs of {SAMPLE_S:.0f} s on {CORES} cores, {name} (from {SAMPLE} runs)"
        table.add_row(what, f"{minutes[name]:.1f} min", "", "")
    Console(width=120).print(table)
    data = {"machine": machine(), "cpu_s": found, "minutes": minutes}
    write_json(Path(out_dir), "batch", data)
    return data


if __name__ == "__main__":
    main()
