"""What a step of each level costs inside a run: what `swath levels` states.

python benchmarks/levels.py [SLOT ...] [--scenario straight] [--seconds 8] [--out out/bench]

Drives a scenario once per level, unrecorded, one thread, and takes the CPU time of every step of the slot,
with the caches and branches of a run around it. Of windows of a simulated second the cheapest
counts: what else the machine does only adds. Levels that need a file or a program of the user's are left out.
"""

import argparse
import os
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

os.environ.setdefault("SWATH_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent))

from _harness import machine, write_json

from swath.api import load_scenario
from swath.core import graph
from swath.core.errors import SwathError
from swath.core.schedule import NS
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.slots import CATALOGUE

SETTLE_S, WINDOW_S = 3.0, 1.0
COMMON = ("run.record=none", "run.distance_m=60", "run.max_duration_s=100")


def step_costs(scenario: str, sets: list[str], seconds: float) -> dict[str, tuple[float, float]]:
    """CPU time of a step [s] and its rate [Hz] by slot."""
    world = assemble(load_scenario(scenario, sets=[*COMMON, *sets]))
    nodes = world.graph.nodes
    drive(world, until_s=SETTLE_S)
    best = {n.slot.name: float("inf") for n in nodes}
    at = SETTLE_S
    while at < SETTLE_S + seconds:
        at += WINDOW_S
        before = {n.slot.name: (n.cost_s, n.step_count) for n in nodes}
        drive(world, until_s=at, resume=True)
        for n in nodes:
            cost, count = before[n.slot.name]
            if n.step_count > count:
                mean = (n.cost_s - cost) / (n.step_count - count)
                best[n.slot.name] = min(best[n.slot.name], mean)
    world.close()
    return {n.slot.name.partition(".")[2]: (best[n.slot.name], NS / n.slot.period) for n in nodes}


def main(arguments: Any = None) -> dict[str, Any]:
    """Measure, print, write levels.json."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("slots", nargs="*", help="of the first machine (default: all)")
    parser.add_argument("--scenario", default="straight")
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    options = parser.parse_args(arguments)
    graph.time = SimpleNamespace(perf_counter=time.process_time)  # type: ignore[assignment]
    name = next(iter(load_scenario(options.scenario).machines))
    found: dict[str, Any] = {}
    for slot in (s.name for s in CATALOGUE.slots if not options.slots or s.name in options.slots):
        for level in CATALOGUE.registry.names(slot):
            sets = [f"{name}.lidar.level=empirical", f"{name}.{slot}.level={level}"]
            try:
                cost, rate = step_costs(options.scenario, sets, options.seconds)[slot]
            except (SwathError, KeyError) as error:
                print(f"{slot}: {level}: {str(error).splitlines()[0]}", file=sys.stderr)
                continue
            found[f"{slot}: {level}"] = {"us": 1e6 * cost, "hz": rate}
            print(f"{slot + ': ' + level:28} {1e6 * cost:9.1f} us a step {rate:7.1f} Hz", flush=True)
    data = {"machine": machine(), "steps": found}
    write_json(options.out, "levels", data)
    return data


if __name__ == "__main__":
    main()
