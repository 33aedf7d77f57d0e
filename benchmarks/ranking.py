"""Whether edge detectors are ranked at `empirical` as at `plants`.

    nice python -m benchmarks.ranking --out DIR [--seeds 6] [--distance 36] [--stands wheat-500 rye] [--show]

Ten detectors in shadow of a machine on the true edge (ranking.yaml), so all see the same scans; the same
seeds at both levels. Kendall's tau of their mean edge RMSE between the levels, beside that between two halves
of the seeds at `plants`, which no level exceeds but by chance. A pair is decided at a level where its
mean difference over the seeds is shown (5 %) and more than 2 mm; turned round where both levels decide it
otherwise. `told`: decided at `empirical` as `swath test compare` says, which leaves differences
between unlike detectors up to 3 cm undecided there.
"""

import argparse
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from swath.core.foreign_code import allow_code
from swath.documents.yaml_document import parse_value
from swath.tools.function_test.candidates import read_candidates
from swath.tools.function_test.fidelity import CHEAP, DEAR, LEVEL_BIAS_M
from swath.tools.function_test.judging.paired import difference
from swath.tools.function_test.plan import Plan
from swath.tools.function_test.session import begin, open_session

DETECTORS = Path(__file__).with_name("ranking.yaml")
STANDS = {
    "wheat-500": "{level: uniform, crop: wheat, stems_per_m2: 500}",
    "wheat-200": "{level: uniform, crop: wheat, stems_per_m2: 200}",
    "rye": "{level: uniform, crop: rye}",
}
CASE = """
format: swath test case 1
objective: ranks detectors
source: made
scenario: straight
set:
  run.distance_m: DISTANCE
  run.record: none
  field.stand: STAND
seeds: SEEDS
expect: {edge_rmse_m: {max: 1.0}}
"""
MATTERS_M = 0.002
SHOWN = 0.05
Errors = Mapping[str, Sequence[float]]  # edge RMSE [m] of each detector by seed


def errors_of(folder: Path) -> Errors:
    """The edge RMSE [m] of each detector, in the order of the seeds."""
    found: dict[str, list[float]] = {}
    session = open_session(folder, same_code=False)
    for result in session.results():
        if result["candidate"] not in session.plan.steering:
            value = result["metrics"].get("edge_rmse_m")
            found.setdefault(result["candidate"], []).append(1.0 if value is None else value)
    return found


def decided(errors: Errors, a: str, b: str) -> float:
    """Mean difference of two detectors [m] where it is decided, else 0."""
    d = difference([x - y for x, y in zip(errors[a], errors[b], strict=True)])
    return d.estimate if d.p <= SHOWN and abs(d.estimate) > MATTERS_M else 0.0


def is_told(a: str, b: str, estimate: float) -> bool:
    """Whether `swath test compare` decides a pair at the cheap level."""
    sets = read_candidates(DETECTORS)
    levels = {parse_value(sets[name][0].partition("=")[2], name)["level"] for name in (a, b)}
    return bool(estimate) and (len(levels) == 1 or abs(estimate) > LEVEL_BIAS_M)


def tau(a: Sequence[float], b: Sequence[float]) -> float:
    """Kendall's rank correlation, tau-b (1945, doi:10.1093/biomet/33.3.239)."""
    from scipy import stats

    return float(stats.kendalltau(a, b).statistic)


def means(errors: Errors, part: slice = slice(None)) -> list[float]:
    return [float(np.mean(values[part])) for values in errors.values()]


def row(stand: str, dear: Errors, cheap: Errors) -> str:
    """A row of the table."""
    pairs = [(a, b, decided(dear, a, b), decided(cheap, a, b)) for a, b in combinations(dear, 2)]
    both = [pair for pair in pairs if pair[2] and pair[3]]
    turned = [pair for pair in both if pair[2] * pair[3] < 0.0]
    told = [pair for pair in pairs if is_told(pair[0], pair[1], pair[3])]
    wrong = [pair for pair in told if pair[2] * pair[3] < 0.0]
    ceiling = tau(means(dear, slice(0, None, 2)), means(dear, slice(1, None, 2)))
    best = [min(errors, key=lambda name: float(np.mean(errors[name]))) for errors in (dear, cheap)]
    for a, b, x, y in turned:
        print(f"    {stand}: {a} - {b}: {100 * x:+.1f} cm at {DEAR}, {100 * y:+.1f} cm at {CHEAP}")
    return (f"| {stand} | {tau(means(dear), means(cheap)):.2f} | {ceiling:.2f} | {len(pairs)} | "
            f"{sum(bool(p[2]) for p in pairs)} | {len(both)} | {len(turned)} | {len(told)} | {len(wrong)} | "
            f"{' / '.join(dict.fromkeys(best))} |")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--distance", type=float, default=36.0)
    parser.add_argument("--stands", nargs="+", default=list(STANDS), choices=STANDS)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--show", action="store_true", help="what is there already; runs nothing")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    allow_code()
    rows = []
    for stand in args.stands:
        found = {}
        for level in (DEAR, CHEAP):
            folder = args.out / f"{stand}-{level}"
            if not args.show:
                case = args.out / f"{stand}.yaml"
                text = CASE.replace("DISTANCE", f"{args.distance:g}").replace("STAND", STANDS[stand])
                case.write_text(text.replace("SEEDS", str(args.seeds)), encoding="utf-8")
                plan = Plan(str(case), candidates=read_candidates(DETECTORS), shadow=True, level=level)
                begin(folder, plan).do(
                    args.workers, lambda result: print(result["case"], result["seed"], result["verdict"])
                )
            found[level] = errors_of(folder)
        for name in found[DEAR]:
            said = [f"{100 * float(np.mean(found[level][name])):5.1f} cm" for level in (DEAR, CHEAP)]
            print(f"    {stand}: {name:28} {DEAR} {said[0]}, {CHEAP} {said[1]}")
        rows.append(row(stand, found[DEAR], found[CHEAP]))
    print("| stand | tau | of halves of the seeds | pairs | decided at plants | at both levels | "
          "turned round | told at empirical | told wrongly | best at plants / empirical |")  # fmt: skip
    print("|---" * 10 + "|")
    print("\n".join(rows))


if __name__ == "__main__":
    main()
