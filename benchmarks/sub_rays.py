"""How many sub-rays a beam needs: height statistics of the same sweeps with more and more of them.

    python -m benchmarks.sub_rays straight --out out/sub_rays.csv

The fixed patterns are nested (sensing/beam.py): every pattern looks at the same plants through the same spots
and only adds places. The remaining change is compared with that of another seed, that is, of other plants of
the same stand. The same goes for plants of fewer primitives (`field.stand.detail`).
"""

import argparse
import csv
import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.number_text import num
from swath.core.random import Stream
from swath.field.field import Field
from swath.scenario.scenario import Scenario, load_scenario
from swath.sensing.lidar.plants import PlantsLidar
from swath.signals import F64, MachineState, ScanTruth
from swath.terminal.tables import table as print_table
from swath.tools.distributions import wasserstein1
from swath.tools.scan.scan import drive_to_scan

COUNTS = (1, 7, 19, 37, 61)
ADVANCE_M = 0.25  # between sweeps: more than the stems of one sweep
INSIDE_M = 0.3  # echoes nearer to the crop's edge than this are left out
GROUND_M = 0.05  # an echo below this height above the soil counts as ground
QUANTITIES = ("mean_m", "sd_m", "p50_m", "p95_m", "ground_share")

# (sub_rays, number of the sweep, origins, rotations) -> true echo points in the world (beams, echoes, 3)
Look = Callable[[int, int, F64, F64], F64]


@dataclass(frozen=True)
class Convergence:
    """Heights over the crop with growing numbers of sub-rays, one seed.

    heights: of the first echo of every beam above the soil [m], (count, beams), nan = none or not in the crop
    detail: of the plants, as in the stand
    """

    seed: int
    counts: tuple[int, ...]
    heights: F64
    detail: str = "full"

    def statistics(self) -> dict[str, F64]:
        """QUANTITIES for each number of sub-rays."""
        rows = [_describe(h[np.isfinite(h)]) for h in self.heights]
        return {name: np.array([row[name] for row in rows]) for name in QUANTITIES}

    def change(self) -> F64:
        """Root mean square difference of the beams to those with the most sub-rays [m], (count,)."""
        return np.asarray(np.sqrt(np.nanmean((self.heights - self.heights[-1]) ** 2, axis=1)))

    def away(self, other: "Convergence") -> F64:
        """Wasserstein distance of each histogram of heights from the other's with the most sub-rays [m]."""
        return np.array([wasserstein1(h, other.heights[-1]) for h in self.heights])


@dataclass(frozen=True)
class SubRayResult:
    """What more sub-rays change against what other plants change.

    band: difference between two seeds at the most sub-rays, by quantity
    enough: fewest sub-rays that differ from the most by no more than the band, or by no more than 1 cm and
    0.005 of ground share, in every quantity and in both seeds; None = only the most do
    seeds_m: Wasserstein distance of the histograms of two seeds at the most sub-rays [m]
    """

    band: dict[str, float]
    enough: int | None
    seeds_m: float = float("nan")


def converge(
    look: Look, field: Field, pose: Pose, *, seed: int, beams: int, sweeps: int = 8, detail: str = "full"
) -> Convergence:
    """Scan `sweeps` times ahead of the pose of a sensor with every number of sub-rays.

    look: see Look; pose: pose_world_sensor; beams: of a sweep. In between the sensor moves along its heading.
    """
    yaw = pose.euler()[2]
    ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    rotations = np.repeat(pose.rotation[None], beams, axis=0)
    heights = np.full((len(COUNTS), sweeps, beams), np.nan)
    for k in range(sweeps):
        origins = np.repeat((pose.position + k * ADVANCE_M * ahead)[None], beams, axis=0)
        for row, count in enumerate(COUNTS):
            heights[row, k] = _heights(field, look(count, k, origins, rotations)[:, 0])
    flat = heights.reshape(len(COUNTS), -1)
    flat[:, np.isnan(flat).any(axis=0)] = np.nan  # the same beams for every pattern
    return Convergence(seed, COUNTS, flat, detail)


def compare(one: Convergence, other: Convergence) -> SubRayResult:
    """How much the plants matter, and from how many sub-rays on more of them matter less."""
    a, b = one.statistics(), other.statistics()
    band = {name: abs(float(a[name][-1] - b[name][-1])) for name in QUANTITIES}
    floor = {"ground_share": 0.005}
    apart = float(one.away(other)[-1])
    for row, count in enumerate(one.counts[:-1]):
        moved = {q: max(abs(float(s[q][row] - s[q][-1])) for s in (a, b)) for q in QUANTITIES}
        if all(moved[q] <= max(band[q], floor.get(q, 0.01)) for q in QUANTITIES):
            return SubRayResult(band, count, apart)
    return SubRayResult(band, None, apart)


def table(runs: Sequence[Convergence]) -> list[dict[str, Any]]:
    """One row per run and number of sub-rays: QUANTITIES, the change of single beams, beams used.

    w1_mm: Wasserstein distance of the heights from those of the first run with the most sub-rays [mm]
    """
    rows = []
    for run in runs:
        statistics, change, away = run.statistics(), run.change(), run.away(runs[0])
        for k, count in enumerate(run.counts):
            row: dict[str, Any] = {"seed": run.seed, "detail": run.detail, "sub_rays": count}
            row |= {name: float(statistics[name][k]) for name in QUANTITIES}
            row |= {"change_rms_m": float(change[k]), "w1_mm": 1e3 * float(away[k])}
            row["beams"] = int(np.isfinite(run.heights[k]).sum())
            rows.append(row)
    return rows


def _heights(field: Field, points: F64) -> F64:
    """Heights above the soil [m] of points in the world that lie in the crop, nan elsewhere."""
    height = np.full(len(points), np.nan)
    seen = np.isfinite(points[:, 0])
    x, y, z = points[seen].T
    inside = field.first_edge.signed_distance(x, y) > INSIDE_M
    height[seen] = np.where(inside, z - field.ground_height(x, y), np.nan)
    return height


def _describe(heights: F64) -> dict[str, float]:
    if len(heights) == 0:
        return dict.fromkeys(QUANTITIES, float("nan"))
    p50, p95 = np.percentile(heights, (50, 95))
    share = float(np.mean(heights < GROUND_M))
    values = (float(heights.mean()), float(heights.std()), float(p50), float(p95), share)
    return dict(zip(QUANTITIES, values, strict=True))


def other_detail(scenario: Scenario) -> Scenario | None:
    """The scenario with `reduced` plants, or with full ones when it has those; None where a stand has no
    such choice.
    """
    stand = scenario.field.stand
    detail = None if stand is None else getattr(stand.params, "detail", None)
    if stand is None or detail is None:
        return None
    params = dataclasses.replace(stand.params, detail="full" if detail == "reduced" else "reduced")
    changed = dataclasses.replace(scenario.field, stand=dataclasses.replace(stand, params=params))
    return dataclasses.replace(scenario, field=changed)


def measure(scenario: Scenario, at_s: float) -> Convergence:
    """The scans of one seed: the field as it is after `at_s`, with ever more sub-rays, without noise."""
    driven = drive_to_scan(scenario, at_s)
    world, machine = driven.world, driven.machine
    lidar = machine.parts[driven.lidar]
    if not isinstance(lidar, PlantsLidar):
        raise InputError(f"{machine.name}.{driven.lidar}.level", type(lidar).__name__, "expected plants")
    stream = Stream(scenario.seed, f"{machine.name}.lidar.converge")

    def look(count: int, sweep: int, origins: F64, rotations: F64) -> F64:
        if count not in copies:
            quiet = dataclasses.replace(lidar.params, sub_rays=count, noise="none")
            copies[count] = PlantsLidar(quiet, lidar.setup)
            copies[count].reset(stream)
        truth = copies[count].scan_from(sweep, origins, rotations)["truth"]
        assert isinstance(truth, ScanTruth)
        return truth.points

    copies: dict[int, PlantsLidar] = {}
    state = world.graph.latest(f"{machine.name}.motion", "state")
    assert isinstance(state, MachineState)
    pose = state.pose @ lidar.mounting
    detail = getattr(world.field.stand, "detail", "full")
    return converge(look, world.field, pose, seed=scenario.seed, beams=len(lidar.azimuth), detail=detail)


def sentence(result: SubRayResult, runs: Sequence[Convergence]) -> str:
    """The result in words."""
    most = runs[0].counts[-1]
    if result.enough is None:
        found = f"No fewer than {most} sub-rays give what {most} give to within the difference of two seeds"
    else:
        found = (
            f"From {result.enough} sub-rays on the heights differ from those with {most} by less than 1 cm, "
            "or by less than two seeds differ"
        )
    other = next((run for run in runs if run.detail != runs[0].detail), None)
    if other is None:
        return found
    moved = 1e3 * float(other.away(runs[0])[-1])
    return (
        f"{found}. Plants of detail `{other.detail}` move the heights by W1 {moved:.1f} mm, "
        f"another seed by {1e3 * result.seeds_m:.1f} mm"
    )


def study(scenario: Scenario, *, at_s: float = 0.0) -> tuple[list[dict[str, Any]], str]:
    """The rows of the table and a sentence: this seed, the next one, and plants of the other detail."""
    runs = [measure(dataclasses.replace(scenario, seed=scenario.seed + k), at_s) for k in range(2)]
    result = compare(*runs)
    other = other_detail(scenario)
    if other is not None:
        runs.append(measure(other, at_s))
    return table(runs), sentence(result, runs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenario", help="a bundled scenario or a YAML file, with a lidar of level plants")
    parser.add_argument("--set", action="append", default=[], dest="sets", metavar="KEY=VALUE")
    parser.add_argument("--at", type=float, default=0.0, metavar="S", help="after S seconds of driving")
    parser.add_argument("--out", type=Path, metavar="FILE.csv", help="the table as a file too")
    args = parser.parse_args()
    rows, result = study(load_scenario(args.scenario, sets=args.sets, flags={}), at_s=args.at)
    print_table("", list(rows[0]), [[num(v) for v in row.values()] for row in rows])
    print(result)
    if args.out is not None:
        args.out.parent.mkdir(parents=True, exist_ok=True)
        with args.out.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
