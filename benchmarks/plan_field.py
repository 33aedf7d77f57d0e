"""Does `swath test plan-field` find a level that is wrong? Eight planned passes against eight drawn ones.

    python benchmarks/plan_field.py [--setup 1] [--pool 60] [--pairs 40] [--seeds 50] [--workers N]

`Wrong` is `empirical` with a canopy lower than the crop in wheat above 400 stems/m2, inside what it declares.
A set-up is drawn by its number: how much lower, which crop there is beside wheat, how often which crop and
density occur (the level is wrong in 5 to 15 % of the time), and two of five further axes, on which its being
wrong does not depend. Real passes are runs of `plants` with seeds of their own. Runs are made once, for a
pool of conditions; each seed plans with some of them, by `--metric scans`. A pass finds the level where it is
wrong and the heights of its echoes differ by more than those of `plants` from themselves in 99 of 100
conditions.
"""

import argparse
import json
import os
import tempfile
from pathlib import Path

import numpy as np

from swath.core.foreign_code import allow_code
from swath.sensing.lidar import empirical
from swath.tools.function_test.case import Point, read_case
from swath.tools.function_test.field_plan.plan import Condition, choose, draw, spread, value_of
from swath.tools.function_test.field_plan.seen import REFERENCE, SCANS
from swath.tools.function_test.plan import AS_SET, Plan
from swath.tools.function_test.session import Session

RUNS = 8
WHEAT_FROM = 400.0  # stems/m2
SHRINK = "SWATH_PLAN_FIELD_SHRINK"  # environment of the workers: canopy's height of the level by the true one
LIMITS = {"edge_rmse_m": {"max": 0.1}, "lateral_rms_m": {"max": 0.15}, "distance_m": {"min": 19.0}}
STEMS = {"key": "field.stand.stems_per_m2", "range": [200, 600], "buckets": [200, 300, 400, 600]}
OTHERS = {
    "speed_kmh": {"key": "combine.speed.speed_kmh", "range": [4, 9]},
    "height": {"key": "field.stand.height_factor", "range": [0.85, 1.15]},
    "lean_deg": {"key": "field.stand.lean_deg", "range": [0, 15]},
    "slope_percent": {"key": "field.terrain.slope_percent", "range": [0, 5]},
    "overlap_m": {"key": "combine.steer.overlap_m", "range": [0.05, 0.3]},
}


def setup(number: int) -> tuple[float, dict]:
    """How low the canopy of the wrong level is, and the case."""
    rng = np.random.default_rng([74, number])
    while True:
        crop, dense = rng.integers(1, 8, 2), rng.integers(1, 8, 3)
        if 0.05 <= crop[0] / crop.sum() * dense[2] / dense.sum() <= 0.15:
            break
    shrink = float(np.round(rng.uniform(0.3, 0.7), 2))
    crops = ["wheat", str(rng.choice(["barley", "rye"]))]
    vary = {
        "crop": {
            "at": crops,
            "sets": {crop: {"field.stand.crop": crop} for crop in crops},
            "exposure": crop.tolist(),
        },
        "stems": {**STEMS, "exposure": dense.tolist()},
        **{name: OTHERS[name] for name in rng.choice(list(OTHERS), 2, replace=False).tolist()},
    }
    about = {"format": "swath test case 1", "objective": "keeps to the edge", "source": "estimated"}
    driven = {"scenario": "straight", "set": {"run.distance_m": 20}}
    return shrink, {**about, **driven, "vary": vary, "expect": LIMITS}


class Wrong(empirical.EmpiricalLidar):
    """`empirical`, but for wheat above 400 stems/m2."""

    Params = empirical.Params

    def begin(self, stream):  # noqa: ANN001, ANN201
        """The canopy is lower from here on."""
        super().begin(stream)
        stand = self.setup.field.stand
        if stand.crop == "wheat" and float(stand.density(20.0, 8.0)) > WHEAT_FROM:
            self.beam = {**self.beam, "crop_height": float(os.environ[SHRINK]) * self.beam["crop_height"]}


def is_wrong(point: Point) -> bool:
    return point["crop"] == "wheat" and float(point["stems"]) > WHEAT_FROM


def values(out: Path, text: str, count: int, workers: int) -> tuple[list[Point], np.ndarray]:
    """Conditions, and the heights seen there by the level, by `plants`, and by a real pass, (n, 3, 10)."""
    out.mkdir(parents=True, exist_ok=True)
    case = out / "wheat.yaml"
    case.write_text(text, encoding="utf-8")
    points = draw(read_case(case), None, count, 1)
    levels = {"wrong": f"{Path(__file__).resolve()}:Wrong", "plants": "plants"}
    columns = []
    for name, level, first in (("wrong", "wrong", 1), ("plants", "plants", 1), ("real", "plants", 1001)):
        chosen = tuple((first + n, point) for n, point in enumerate(points))
        sets = [f"combine.lidar.level={json.dumps(levels[level])}", f"evaluators={json.dumps([REFERENCE])}"]
        plan = Plan(str(case), candidates={name: sets}, level=AS_SET, chosen={"wheat": chosen})
        with allow_code(None):
            session = Session(out / name, plan)
            session.write()
            session.do(workers, lambda result: None)
        columns.append([value_of(result, SCANS) for result in session.results()])
    return points, np.swapaxes(np.array(columns), 0, 1)


def main(out: Path, number: int, count: int, pairs: int, seeds: int, workers: int) -> None:
    shrink, case_of = setup(number)
    os.environ[SHRINK] = str(shrink)
    print(f"set-up {number}: canopy at {shrink:g} of its height; {json.dumps(case_of['vary'])}")
    points, of = values(out, json.dumps(case_of), count, workers)
    case = read_case(out / "wheat.yaml")
    apart, real, limit = (np.abs(of[:, a] - of[:, b]).mean(axis=1) for a, b in ((0, 1), (0, 2), (1, 2)))
    limit = float(np.quantile(limit, 0.99))
    finds = np.array([is_wrong(p) for p in points]) & (real > limit)
    wrong = np.array([is_wrong(p) for p in points])
    print(
        f"{len(points)} conditions, {wrong.sum()} where the level is wrong, a pass finds it in {finds.sum()} "
        f"of these; `plants` differs from itself by up to {limit:.2g}"
    )
    counts = {"planned": 0, "drawn": 0}
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        some = rng.choice(len(points), min(pairs, len(points)), replace=False)
        conditions = [Condition(points[n], float(apart[n]), 1.0, ()) for n in some]
        passes = choose(case, conditions, spread(case, conditions), RUNS)
        chosen = [int(some[conditions.index(each.condition)]) for each in passes]
        counts["planned"] += bool(finds[chosen].any())
        counts["drawn"] += bool(finds[rng.choice(len(points), RUNS, replace=False)].any())
    for name, found in counts.items():
        print(f"{RUNS} {name} passes find it with {found} of {seeds} seeds")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--setup", type=int, default=1)
    parser.add_argument("--pool", type=int, default=60)
    parser.add_argument("--pairs", type=int, default=40)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=None)
    args = parser.parse_args()
    out = args.out or Path(tempfile.mkdtemp())
    main(out, args.setup, args.pool, args.pairs, args.seeds, args.workers)
