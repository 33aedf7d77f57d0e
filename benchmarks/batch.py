"""What comes before and after a run, alone and in a batch, and what many runs cost. CPU time, one thread.

The short and the long run of a scenario give seconds per simulated second; what is left of the short one
comes before and after: imports where it is alone, assembly, first tiles, metrics, report. `empirical` is the
cheapest level of a LiDAR that sees the crop; nothing is recorded in a batch.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
os.environ["SWATH_THREADS"] = "1"

from _harness import machine, write_json

CHEAP = {"combine.lidar.level": "empirical"}
SHORT, LONG, SAMPLE_S = 4.0, 24.0, 60.0  # m, m, s
ROUNDS, SAMPLE, RUNS, CORES = 3, 3, 1000, 2
STARTS = {
    "alone, with report and replay": [],
    "alone, without replay": ["--no-replay"],
}


def in_batch(sets: dict[str, Any], seed: int, feed: "Feed") -> tuple[float, float]:
    """CPU time and simulated time [s] of one run of a batch."""
    feed.append({"scenario": "straight", "sets": {**CHEAP, **sets}, "seed": seed})
    started = time.process_time()
    summary = next(feed.batch).summary
    return time.process_time() - started, float(summary["simulated_s"])


class Feed:
    """A batch whose entries are given one at a time."""

    def __init__(self) -> None:
        import swath

        self._entries: list[dict[str, Any]] = []
        self.batch = swath.batch(iter(self._entries.pop, {}))

    def append(self, entry: dict[str, Any]) -> None:
        self._entries.append(entry)


def alone(options: list[str], folder: Path) -> float:
    """CPU time [s] of `swath run` in a process of its own, over a tenth of a metre."""
    command = "import sys; from swath.commands.main import main; main(sys.argv[1:])"
    run = ["run", "straight", "--set", "run.distance_m=0.1", "--set", "combine.lidar.level=empirical"]
    before = os.times()
    subprocess.run(
        [sys.executable, "-c", command, *run, "--out", str(folder), "--quiet", *options],
        check=True,
        capture_output=True,
    )
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def main(out_dir: Path | str = "out/bench") -> dict[str, Any]:
    """Measure, print, write batch.json."""
    from rich.console import Console
    from rich.table import Table

    found: dict[str, list[float]] = {}
    feed = Feed()
    in_batch({"run.distance_m": SHORT}, 1, feed)  # what is kept is there from now on
    with tempfile.TemporaryDirectory() as folder:
        for number in range(ROUNDS):
            for name, options in STARTS.items():
                seconds = alone(options, Path(folder) / "run")
                found.setdefault(name, []).append(seconds)
            for name, seed in (("the same field", 1), ("another field each", 100 + number)):
                short, at_short = in_batch({"run.distance_m": SHORT}, seed, feed)
                other = seed if seed == 1 else seed + 1000
                long, at_long = in_batch({"run.distance_m": LONG}, other, feed)
                each = (long - short) / (at_long - at_short)
                found.setdefault(f"in a batch, {name}", []).append(short - each * at_short)
                found.setdefault(f"a simulated second, {name}", []).append(each)
        for number in range(SAMPLE):
            for name, seed in (("the same field", 1), ("another field each", 2000 + number)):
                sets = {"run.max_duration_s": SAMPLE_S, "run.distance_m": 400}
                seconds, _ = in_batch(sets, seed, feed)
                found.setdefault(f"a run of {SAMPLE_S:.0f} s, {name}", []).append(seconds)
    table = Table(title="CPU time, one thread, `straight`, LiDAR `empirical`", title_justify="left")
    for column in ("", "median", "least", "most"):
        table.add_column(column, justify="right" if column else "left")
    for name, values in found.items():
        low, high = min(values), max(values)
        table.add_row(name, *(f"{v:.3f} s" for v in (statistics.median(values), low, high)))
    minutes = {}
    for name in ("the same field", "another field each"):
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
