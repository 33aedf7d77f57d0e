"""How many sub-rays a beam needs: height statistics of the same sweeps with more and more of them.

The fixed patterns are nested (sensing/beam.py), so every pattern looks at the same plants through the same
spots and only adds places. How much an answer still moves is to be judged against what other plants of the
same stand would have changed: another seed. The same goes for plants of fewer primitives (`detail`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swath.core.frames import Pose
from swath.field.field import Field
from swath.signals import F64

COUNTS = (1, 7, 19, 37, 61)
ADVANCE_M = 0.25  # between sweeps: more than the stems of one sweep
INSIDE_M = 0.3  # echoes nearer to the crop's edge than this are left out
GROUND_M = 0.05  # an echo below this height above the soil counts as ground
QUANTITIES = ("mean_m", "sd_m", "p50_m", "p95_m", "ground_share")

# (sub_rays, number of the sweep, origins, rotations) -> true echo points in the world (beams, echoes, 3)
Look = Callable[[int, int, F64, F64], F64]


@dataclass(frozen=True)
class Settling:
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

    def away(self, other: "Settling") -> F64:
        """Wasserstein distance of each histogram of heights from the other's with the most sub-rays [m]."""
        return np.array([wasserstein(h, other.heights[-1]) for h in self.heights])


@dataclass(frozen=True)
class Verdict:
    """What more sub-rays change against what other plants change.

    band: difference between two seeds at the most sub-rays, by quantity
    enough: fewest sub-rays that differ from the most by no more than the band, or by no more than 1 cm and
    0.005 of ground share, in every quantity and in both seeds; None = only the most do
    seeds_m: Wasserstein distance of the histograms of two seeds at the most sub-rays [m]
    """

    band: dict[str, float]
    enough: int | None
    seeds_m: float = float("nan")


def settle(
    look: Look, field: Field, pose: Pose, *, seed: int, beams: int, sweeps: int = 8, detail: str = "full"
) -> Settling:
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
    return Settling(seed, COUNTS, flat, detail)


def judge(one: Settling, other: Settling) -> Verdict:
    """How much the plants matter, and from how many sub-rays on more of them matter less."""
    a, b = one.statistics(), other.statistics()
    band = {name: abs(float(a[name][-1] - b[name][-1])) for name in QUANTITIES}
    floor = {"ground_share": 0.005}
    apart = float(one.away(other)[-1])
    for row, count in enumerate(one.counts[:-1]):
        moved = {q: max(abs(float(s[q][row] - s[q][-1])) for s in (a, b)) for q in QUANTITIES}
        if all(moved[q] <= max(band[q], floor.get(q, 0.01)) for q in QUANTITIES):
            return Verdict(band, count, apart)
    return Verdict(band, None, apart)


def wasserstein(one: F64, other: F64) -> float:
    """First Wasserstein distance of two sets of numbers, nan left out: the area between their distributions.

    nan when one is empty. Equal to scipy.stats.wasserstein_distance.
    """
    a, b = (np.sort(v[np.isfinite(v)]) for v in (one, other))
    if len(a) == 0 or len(b) == 0:
        return float("nan")
    every = np.sort(np.concatenate([a, b]))
    below = [np.searchsorted(v, every[:-1], side="right") / len(v) for v in (a, b)]
    return float((np.abs(below[0] - below[1]) * np.diff(every)).sum())


def table(runs: Sequence[Settling]) -> list[dict[str, Any]]:
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
