"""What it costs to save a world every 5 s, and what a save spares a branch."""

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from _harness import machine, write_json

SCENARIOS = ("straight", "two-combines", "unload-on-the-go")
LENGTH_S, BACK = 60.0, 0.9  # of a run at most, and where it is gone back to, as a share


def measure(name: str, folder: Path) -> dict[str, Any]:
    """A run with saves, then a branch of it with and without them."""
    from swath.runtime.branch import Start
    from swath.runtime.job import run_job
    from swath.runtime.saves import SAVES, Saves
    from swath.scenario.scenario import load_scenario

    def timed(out: str, **more: Any) -> tuple[float, dict[str, Any]]:
        plan = load_scenario(name, sets=[f"run.max_duration_s={LENGTH_S}"])
        began = time.process_time()
        summary = run_job(plan, folder / out, **more).summary
        return time.process_time() - began, summary

    cpu_s, whole = timed("run", hooks=[Saves()])
    at = round(BACK * whole["simulated_s"] * 1e9)
    with_saves, first = timed("with", start=Start(folder / "run", at))
    without, second = timed("without", start=Start(folder / "run", at, saves=False))
    assert first["digest"] == second["digest"] == whole["digest"]
    told = whole["saves"]
    pages = (folder / "run" / SAVES / "field.bin").stat().st_size
    return {
        "saves": told["count"],
        "save_kb": (told["bytes"] - pages) / told["count"] / 1e3,
        "pages_kb": pages / 1e3,
        "save_cpu_ms": 1e3 * told["cpu_s"] / told["count"],
        "share_percent": 100.0 * told["cpu_s"] / (cpu_s - told["cpu_s"]),
        "cpu_s": cpu_s,
        "branch_cpu_s": with_saves,
        "from_start_cpu_s": without,
    }


def main(out_dir: str = "out/bench") -> None:
    """Measure, print, write branch.json."""
    found = {}
    for name in SCENARIOS:
        with tempfile.TemporaryDirectory() as folder:
            m = found[name] = measure(name, Path(folder))
        size = f"{m['save_kb']:.0f} kB, field {m['pages_kb']:.0f} kB in all"
        cost = f"{m['save_cpu_ms']:.0f} ms | {m['share_percent']:.1f} %"
        spared = f"{m['branch_cpu_s']:.1f} s | {m['from_start_cpu_s']:.1f} s"
        print(f"| {name} | {m['saves']} | {size} | {cost} | {spared} |", flush=True)
    write_json(Path(out_dir), "branch", {"machine": machine(), "scenarios": found})


if __name__ == "__main__":
    main(*sys.argv[1:2])
