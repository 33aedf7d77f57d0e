"""What `swath tune` finds: planted optima, pure noise, the steering law `preview` with three gains spoilt.

    python benchmarks/tune.py [closed] [preview] [--seeds 20] [--tries 60] [--workers N] [--out DIR]

closed: of closed forms of three parameters with noise of 3 % of their span, how many winners lie within 5 %
of the ranges of the optimum; of as many of noise alone, how many are called no better.
preview: tuned in six cases, then held against what is shipped in six others; the edge is known.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from swath.signals import F64
from swath.tools.function_test.compare import Comparison, compare
from swath.tools.function_test.plan import Plan
from swath.tools.function_test.search.boundary import sobol_points
from swath.tools.function_test.session import begin
from swath.tools.tune.optimiser import Measured, optimise, winner
from swath.tools.tune.parameters import Parameter, as_sets
from swath.tools.tune.tune import ALPHA, NO_BETTER, Proof, Tune, run_tune

NOISE, NEAR = 0.03, 0.05  # of the span of the values, of the ranges
PAIRS = 32  # of the proof
PARAMETERS = [Parameter(name) for name in "abc"]
KNOWN_EDGE = ("combine.edge={level: truth}", 'combine.lidar="off"')
SPOILT = {"combine.steer.lookahead_s": 5.0, "combine.steer.dead_time_s": 1.0, "combine.steer.lag_s": 1.5}
RANGES = ("combine.steer.lookahead_s=0..6", "combine.steer.dead_time_s=0..1.5", "combine.steer.lag_s=0..2")
TUNED_IN = ("straight-clean", "bend", "bend-fast", "s-bend", "steering-slow", "steering-dead-band")
PROVEN_IN = ("entry", "wheel-slip", "side-slope", "slope-along", "waves", "bend-tight")
AIM = "lateral_rms_m"


class Planted:
    """A bowl with a drawn optimum, curvatures and interaction, flat far off; values of 0 to 1."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.best = rng.uniform(0.2, 0.8, 3)
        self._steep, self._skew = rng.uniform(0.5, 1.5, 3), rng.uniform(-0.3, 0.3)
        self._top = 1.0
        self._top = float(np.max(self.at(sobol_points(4096, 3))))

    def at(self, points: F64) -> F64:
        off = np.atleast_2d(points) - self.best
        square = (self._steep * off**2).sum(axis=1) + self._skew * off[:, 0] * off[:, 1]
        return np.asarray(square / (0.3 + square) / self._top)


def planted(seed: int, tries: int) -> float:
    """How far the winner lies from the optimum, the largest share of a range."""
    rng = np.random.default_rng(seed)
    form = Planted(rng)

    def measure(shares: F64) -> list[Measured]:
        return [Measured((float(v + NOISE * rng.standard_normal()),), 1.0) for v in form.at(shares)]

    tried = optimise(PARAMETERS, 1, tries, seed, measure)
    return float(np.abs(tried[winner(tried)].shares - form.best).max())


def noise(seed: int, tries: int) -> str:
    """The verdict where no setting does anything."""
    rng = np.random.default_rng(seed)
    optimise(
        PARAMETERS, 1, tries, seed, lambda shares: [Measured((rng.standard_normal(),), 1.0) for _ in shares]
    )
    pairs = [tuple({"metrics": {AIM: float(v)}, "digest": str(v), "verdict": "pass"} for v in two)
             for two in rng.standard_normal((PAIRS, 2))]  # fmt: skip
    return Proof(Comparison(pairs, [AIM], 0, alpha=ALPHA, directions={AIM: "lower"}), (0, 0)).says


def closed(seeds: int, tries: int) -> None:
    since = time.process_time()
    off = [planted(seed, tries) for seed in range(seeds)]
    print(
        f"planted optimum, {tries} runs: {sum(o < NEAR for o in off)} of {seeds} winners within "
        f"{100 * NEAR:g} % of the ranges, median {100 * np.median(off):.1f} %, worst {100 * max(off):.1f} %"
    )
    said = [noise(seed, tries) for seed in range(seeds)]
    print(
        f"noise alone: {said.count(NO_BETTER)} of {seeds} no better; {time.process_time() - since:.0f} CPU-s"
    )


def preview(out: Path, tries: int, workers: int) -> None:
    sets = (*KNOWN_EDGE, *as_sets(SPOILT))
    tune = Tune(TUNED_IN, RANGES, (AIM,), PROVEN_IN, tries, 6, 18, sets)
    spent = [0.0]

    def done(result: dict) -> None:
        spent[0] += result["cpu_s"]

    found = run_tune(out / "tuned", tune, workers, done)
    print(f"spoilt {SPOILT}\ntuned  {found.winner}: {found.verdict} as spoilt, {spent[0] / 60:.1f} CPU-min")
    candidates = {"shipped": [], "tuned": as_sets(found.winner)}
    session = begin(out / "held", Plan(PROVEN_IN, candidates=candidates, sets=KNOWN_EDGE, drawn=3, seeds=1))
    session.do(workers, done)
    session.table()
    made = compare(f"{out / 'held'}:shipped", f"{out / 'held'}:tuned", [AIM, "lateral_p95_m"], ALPHA)
    for name, d in made.differences.items():
        print(
            f"held-out cases, tuned less shipped, {name}: {100 * d.estimate:+.2f} cm "
            f"({100 * d.low:+.2f} to {100 * d.high:+.2f}), {d.count} pairs, {made.says(name)}"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", nargs="*", default=["closed"], choices=["closed", "preview"])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--tries", type=int, default=60)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=None)
    args = parser.parse_args()
    if "closed" in args.what:
        closed(args.seeds, args.tries)
    if "preview" in args.what:
        preview(args.out or Path(tempfile.mkdtemp()), args.tries, args.workers)
    sys.exit(0)
