"""Does `swath test plan-field` find a level that is wrong? Eight planned passes against eight drawn ones.

    python benchmarks/plan_field.py [--pool 120] [--pairs 48] [--seeds 50] [--workers N] [--out DIR]

`Wrong` is `empirical` with a canopy half as high in wheat above 400 stems/m2, inside what it declares: the
machine stands, for it sees no edge. Real passes are runs of `plants` with seeds of their own. Runs are made
once, for a pool of conditions; each seed plans with some of them. A pass finds the level where it is wrong
and the distance driven differs by more than `plants` differs from itself in 99 of 100 conditions.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np

from swath.core.foreign_code import allow_code
from swath.rays.bodies import BodyCaster
from swath.sensing.lidar import empirical
from swath.tools.function_test.case import Point, read_case
from swath.tools.function_test.field_plan.plan import Condition, choose, draw, spread
from swath.tools.function_test.plan import AS_SET, Plan
from swath.tools.function_test.session import Session

RUNS = 8
SHRINK, WHEAT_FROM = 0.5, 400.0  # of the canopy's height; stems/m2
METRIC = "distance_m"
CASE = """
format: swath test case 1
objective: detects the edge
source: estimated
scenario: straight
set: {run.distance_m: 20}
vary:
  crop:
    at: [wheat, barley]
    sets: {wheat: {field.stand.crop: wheat}, barley: {field.stand.crop: barley}}
    exposure: [1, 1]
  stems:
    {key: field.stand.stems_per_m2, range: [200, 600], buckets: [200, 300, 400, 600], exposure: [2, 2, 1]}
  speed_kmh: {key: combine.speed.speed_kmh, range: [4, 9]}
expect: {edge_rmse_m: {max: 0.1}}
"""


class Wrong(empirical.EmpiricalLidar):
    """`empirical`, but for wheat above 400 stems/m2."""

    Params = empirical.Params

    def begin(self, stream):  # noqa: ANN001, ANN201
        """The canopy is lower from here on."""
        super().begin(stream)
        stand = self.setup.field.stand
        if stand.crop == "wheat" and float(stand.density(20.0, 8.0)) > WHEAT_FROM:
            beam = {**self.beam, "crop_height": SHRINK * self.beam["crop_height"]}
            lines = self.scanner.line_count
            self.caster = BodyCaster(
                self.setup.field, self.table, self.rays.beams, self.apart, line_count=lines, **beam
            )


def is_wrong(point: Point) -> bool:
    return point["crop"] == "wheat" and float(point["stems"]) > WHEAT_FROM


def values(out: Path, count: int, workers: int) -> tuple[list[Point], np.ndarray]:
    """Conditions, and the metric there of the level, of `plants`, and of a real pass, (n, 3)."""
    out.mkdir(parents=True, exist_ok=True)
    case = out / "wheat.yaml"
    case.write_text(CASE, encoding="utf-8")
    points = draw(read_case(case), None, count, 1)
    levels = {"wrong": f"{Path(__file__).resolve()}:Wrong", "plants": "plants"}
    columns = []
    for name, level, first in (("wrong", "wrong", 1), ("plants", "plants", 1), ("real", "plants", 1001)):
        chosen = tuple((first + n, point) for n, point in enumerate(points))
        sets = [f"combine.lidar.level={json.dumps(levels[level])}"]
        plan = Plan(str(case), candidates={name: sets}, level=AS_SET, chosen={"wheat": chosen})
        with allow_code(None):
            session = Session(out / name, plan)
            session.write()
            session.do(workers, lambda result: None)
        found = [result["metrics"].get(METRIC) for result in session.results()]
        columns.append([np.nan if value is None else value for value in found])
    return points, np.array(columns).T


def main(out: Path, count: int, pairs: int, seeds: int, workers: int) -> None:
    points, of = values(out, count, workers)
    kept = np.isfinite(of).all(axis=1)
    points, of = [p for p, k in zip(points, kept, strict=True) if k], of[kept]
    case = read_case(out / "wheat.yaml")
    limit = float(np.quantile(np.abs(of[:, 1] - of[:, 2]), 0.99))
    finds = np.array([is_wrong(p) for p in points]) & (np.abs(of[:, 0] - of[:, 2]) > limit)
    wrong = np.array([is_wrong(p) for p in points])
    print(
        f"{len(points)} conditions, {wrong.sum()} where the level is wrong, a pass finds it in {finds.sum()} "
        f"of these; `plants` differs from itself by up to {limit:.2g}"
    )
    counts = {"planned": 0, "drawn": 0}
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        some = rng.choice(len(points), min(pairs, len(points)), replace=False)
        conditions = [Condition(points[n], float(of[n, 1] - of[n, 0]), 1.0, ()) for n in some]
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
    parser.add_argument("--pool", type=int, default=120)
    parser.add_argument("--pairs", type=int, default=48)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=None)
    args = parser.parse_args()
    main(args.out or Path(tempfile.mkdtemp()), args.pool, args.pairs, args.seeds, args.workers)
