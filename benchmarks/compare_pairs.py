"""`swath test compare` on driven runs: false alarms between equal candidates, and a planted bias of 1 cm.

    nice python -m benchmarks.compare_pairs --out DIR [--seeds 40] [--workers 2]

Runs of 26 m at `empirical`. Equal candidates: 200 comparisons of 20 pairs, drawn from the runs without
a bias, those of a pair with other seeds. Planted: the edge is told 1 cm farther out, 20 pairs of a seed.
"""

import argparse
from pathlib import Path

import numpy as np

from swath.tools.function_test.compare import METRICS, Comparison
from swath.tools.function_test.plan import Plan
from swath.tools.function_test.session import begin

CASE = """
format: swath test case 1
objective: drives along a straight edge
source: made
scenario: straight
set:
  run.distance_m: 26
  run.record: none
  combine.lidar: {level: empirical, rate_hz: 12.5}
  combine.motion: {level: kinematic}
seeds: SEEDS
expect: {distance_m: {min: 25}}
"""
PLANTED = ("combine.edge.fault={bias: {offset_cm: 1}}",)
PAIRS, COMPARISONS = 20, 200


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    case = args.out / "straight-pairs.yaml"
    case.write_text(CASE.replace("SEEDS", str(args.seeds)), encoding="utf-8")
    session = begin(args.out / "runs", Plan(str(case), candidates={"base": (), "biased": PLANTED}))
    session.do(args.workers, lambda result: print(result["candidate"], result["seed"], result["verdict"]))
    results = session.results()
    base = [r for r in results if r["candidate"] == "base"]
    biased = [r for r in results if r["candidate"] == "biased"]
    rng, false = np.random.default_rng(1), 0
    for _ in range(COMPARISONS):
        drawn = [base[i] for i in rng.permutation(len(base))[: 2 * PAIRS]]
        false += bool(Comparison(list(zip(drawn[::2], drawn[1::2], strict=True)), METRICS, 0).shown)
    print(f"equal candidates: {false} false alarms in {COMPARISONS} comparisons of {PAIRS} pairs")
    for start in range(0, len(base) - PAIRS + 1, PAIRS):
        found = Comparison(list(zip(base, biased, strict=True))[start : start + PAIRS], METRICS, 0)
        for name in sorted(found.shown):
            told = found.differences[name]
            print(f"1 cm planted, pairs {start + 1} to {start + PAIRS}: {name} {told.estimate:+.4f} "
                  f"({told.low:+.4f} to {told.high:+.4f}) m")  # fmt: skip


if __name__ == "__main__":
    main()
