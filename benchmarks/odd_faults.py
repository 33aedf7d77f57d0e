"""Whether a fault in one pair of buckets of an ODD is found, and none where there is none.

    python -m benchmarks.odd_faults --seeds 10 --out /tmp/odd-faults
    python -m benchmarks.odd_faults --seeds 1 --runs 150 --real --out /tmp/odd-faults-real

The fault: the edge is told 20 cm to the side above a side slope of 10 % and under 150 stems/m2. By default a
closed form stands in for a run: the largest lateral error is drawn, larger on slopes, and 1 % of the runs
fail for no reason. `--real` drives, with the true edge, kinematic motion and the fault put on it where the
drawn point lies in the pair.
"""

import argparse
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.random import Stream
from swath.documents.yaml_document import dump, read_document
from swath.runtime.kept import KeptFields
from swath.tools.function_test import session
from swath.tools.function_test.case import Point
from swath.tools.function_test.journal import Journal
from swath.tools.function_test.judging.verdict import BROKEN
from swath.tools.function_test.odd.binding import Odd, find_odd, read_odd
from swath.tools.function_test.odd.campaign import ROUND, Campaign, conduct, pair_count, revision_of
from swath.tools.function_test.odd.causes import causes_of
from swath.tools.function_test.odd.cells import judged, needed_each
from swath.tools.function_test.odd.coverage import Coverage, driven_of
from swath.tools.function_test.odd.design import Design
from swath.tools.function_test.odd.dossier import write_dossier
from swath.tools.function_test.one_run import results_in
from swath.tools.function_test.plan import PlannedRun

SLOPE, DENSITY = "terrain.side_slope", "process.density"
BIAS_M, STEEP_PERCENT, THIN = 0.2, 10.0, 150.0
LIMIT_M = 0.2  # of the lateral error that stands for all limits
EDGES = [-20.0, -10.0, 0.0, 10.0, 20.0]  # of the slope, so that the pair is a cell
TRUTH = ("combine.edge=truth", "combine.motion=kinematic", "combine.lidar.level=empirical")


def is_in_cell(point: Point) -> bool:
    """Whether a drawn point lies in the pair with the fault."""
    return float(point[SLOPE]) > STEEP_PERCENT and float(point[DENSITY]) < THIN


def closed_form(point: Point, number: int, *, planted: bool) -> dict[str, Any]:
    """A result without a run."""
    rng = Stream(number, "closed form").at(0)
    slope, density = float(point[SLOPE]), float(point[DENSITY])
    error = 0.06 + 0.002 * abs(slope) + 0.02 * float(rng.standard_normal())
    error += BIAS_M if planted and is_in_cell(point) else 0.0
    fails = error > LIMIT_M or rng.random() < 0.01
    at = np.arange(0.0, 46.0, 5.0)
    alike = np.ones_like(at)
    met = {"t_s": at / 2.0, "distance_m": at, "slope_along_percent": 0.0 * at,
           "ground_speed_kmh": float(point["process.speed"]) * alike, "stems_per_m2": density * alike,
           "slope_across_percent": np.round(slope + 0.3 * rng.standard_normal(len(at)), 2)}  # fmt: skip
    told = {"id": str(number), "point": point, "verdict": "fail" if fails else "pass", "reason": ""}
    return {**told, "met": {name: column.tolist() for name, column in met.items()}}


def stood_in(odd: Odd, runs: int, seed: int, *, planted: bool) -> Coverage:
    """A campaign of such results, in rounds as one that drives."""
    design = Design(odd, needed_each(pair_count(odd), odd.file.claim), seed)
    coverage = Coverage(odd)
    while len(coverage.runs) < runs:
        done = len(coverage.runs)
        for point in design.next(coverage.counted, done, min(ROUND, runs - done)):
            number = 1000 * seed + len(coverage.runs)
            coverage.add(driven_of(odd, closed_form(point, number, planted=planted)))
    return coverage


def driven(run: PlannedRun, fields: KeptFields, *, planted: bool) -> dict[str, Any]:
    """A run, with the fault where it belongs."""
    if planted and is_in_cell(run.point):
        run = replace(run, sets=[*run.sets, f"combine.edge.fault.bias.offset_m={BIAS_M}"])
    return next(results_in([run], fields))


def here(work: Callable[..., dict[str, Any]]) -> Callable[..., None]:
    """`run_all` in this process."""

    def run_all(runs: Iterable[PlannedRun], folder: Path, workers: int, done: Callable[..., None]) -> None:
        journal, fields = Journal(folder, "here"), KeptFields()
        for run in runs:
            result = work(run, fields)
            journal.add(result)
            done(result)
        journal.close()

    return run_all


def odd_file(folder: Path) -> Path:
    """The bundled ODD with an edge of the slope's buckets where the fault begins."""
    folder.mkdir(parents=True, exist_ok=True)
    bundled = find_odd("wheat-harvest")
    text = (
        (bundled.parent / "wheat-harvest.openodd.yaml").read_text().replace("[-17 .. 17] %", "[-21 .. 21] %")
    )
    (folder / "wheat-harvest.openodd.yaml").write_text(text)
    data = read_document(bundled).data
    data["attributes"][SLOPE]["buckets"] = EDGES
    data["expect"]["lateral_error_m"] = {"hold": "always", "min": -LIMIT_M, "max": LIMIT_M, "from_m": 15}
    file = folder / "wheat-harvest.odd.yaml"
    file.write_text(dump(data))
    return file


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--real", action="store_true")
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    odd = read_odd(odd_file(args.out))
    wanted = {f"{SLOPE} 10 to 20 %", f"{DENSITY} 60 to 150 1/m2"}
    found, alarms, alone = 0, 0, 0
    for planted in (True, False):
        for seed in range(1, args.seeds + 1):
            name, begun = f"{'planted' if planted else 'none'}-{seed}", time.process_time()
            if args.real:
                session.run_all = here(partial(driven, planted=planted))
                campaign = Campaign(odd.name, revision_of(odd), (args.runs,), seed, TRUTH)
                made = conduct(args.out / name, campaign, odd, 1, lambda result: None)
                coverage, cells = made.coverage, made.cells
                write_dossier(made)
            else:
                coverage = stood_in(odd, args.runs, seed, planted=planted)
                cells = judged(coverage, odd.file.claim, is_complete=True)
            said = [cause.text for cause in causes_of(coverage, odd.file.claim, is_complete=True)]
            hit = any(set(text.split(", ")) == wanted for text in said)
            broken = sum(cell.verdict == BROKEN for cell in cells)
            found += planted and hit
            alone += planted and hit and len(said) == 1
            alarms += not planted and (broken > 0 or bool(said))
            passed = sum(run.passes for run in coverage.runs)
            told = f"{passed} of {len(coverage.runs)} pass, {broken} cells broken"
            took = f"({time.process_time() - begun:.0f} cpu-s)"
            print(f"{name}: {told}, causes: {'; '.join(said) or 'none'} {took}", flush=True)
    print(f"planted: found in {found} of {args.seeds} seeds, as the only cause in {alone}; "
          f"none planted: a cell called broken, or a cause, in {alarms} of {args.seeds}")  # fmt: skip


if __name__ == "__main__":
    main()
