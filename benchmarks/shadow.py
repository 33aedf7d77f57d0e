"""What ten edge detectors cost: in shadow beside one run, and each steering a run of its own.

    python -m benchmarks.shadow [--distance 30] [--loops 3] [--rounds 3] [--set KEY=VALUE]

Prints CPU seconds, medians of rounds in which closed loops and the run with shadows take turns. Of the ten
closed loops only `--loops` are run, evenly chosen; their mean counts ten times.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from swath.runtime.hooks import RunHook
from swath.runtime.job import run_job
from swath.scenario.scenario import Scenario, load_scenario
from swath.tools.function_test.shadow import ShadowHook

DETECTORS = (
    "{level: likelihood_ratio}",
    "{level: likelihood_ratio, hold_m: 2}",
    "{level: likelihood_ratio, crab: 0}",
    "{level: otsu}",
    "{level: otsu, gate_m: 0.2}",
    "{level: otsu, gate_m: 0.7}",
    "{level: otsu, learn_m: 0}",
    "{level: otsu, track_m: 4}",
    "{level: otsu, min_gain: 30}",
    "{level: otsu, lean_share: 0}",
)


def seconds(scenario: Scenario, hooks: Sequence[RunHook] = ()) -> float:
    """CPU time of a run with its world."""
    started = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        run_job(scenario, Path(folder) / "run", hooks=hooks)
    return time.process_time() - started


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--distance", type=float, default=30.0)
    parser.add_argument("--loops", type=int, default=3)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--set", action="append", default=[], dest="sets", metavar="KEY=VALUE")
    args = parser.parse_args()
    sets = [f"run.distance_m={args.distance}", "run.record=none", *args.sets]
    scenarios = [load_scenario("straight", sets=[*sets, f"combine.edge={edge}"]) for edge in DETECTORS]
    seconds(load_scenario("straight", sets=["run.distance_m=2", "run.record=none"]))  # kernels are compiled
    chosen = scenarios[:: -(-len(scenarios) // args.loops)]
    shadows = {DETECTORS[i]: scenario for i, scenario in enumerate(scenarios)}
    rounds = []
    for _ in range(args.rounds):
        closed = [seconds(scenario) for scenario in chosen]
        rounds.append(
            (statistics.mean(closed) * len(scenarios), seconds(scenarios[0], [ShadowHook(shadows)]))
        )
    ratios = [loops / shadow for loops, shadow in rounds]
    loops, shadow = (statistics.median(of) for of in zip(*rounds, strict=True))
    print(f"ten closed loops      {loops:6.1f} s of CPU ({len(chosen)} of them run)")
    print(f"one run, ten shadows  {shadow:6.1f} s of CPU")
    print(
        f"ratio of rounds       1 / {statistics.median(ratios):.1f} ({min(ratios):.1f} to {max(ratios):.1f})"
    )


if __name__ == "__main__":
    main()
