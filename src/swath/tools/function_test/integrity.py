"""Is a detector wrong and sure? The Stanford diagram of satellite navigation, for the crop edge.

Over all samples: the error that there is (x) and three standard deviations as they are told (y), both against
an alert limit. Below the diagonal the error is more than told (misleading); above the limit the detector says
itself that it is not sure (unavailable); an error beyond the limit while it says that it is sure is
hazardously misleading (Tossaint et al. 2007, the Stanford-ESA integrity diagram). An episode is an unbroken
stretch of such samples. A detector without a standard deviation is sure from a confidence of 0.5 on.

Beside a gap of the initial edge the line across it counts as the edge, not the far wall: gaps are to be
bridged, and a detector that is sure of the wall leads the machine into the crop.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from swath.judge.evaluators.edge_detection import SURE, EdgeDetection, EdgeSeries
from swath.judge.evaluators.edge_detection import WRONG_M as ALERT_M
from swath.runtime.hooks import ActiveRun, RunHook

SUMMARY = "integrity"
BIN_M, BIN_COUNT = 0.03, 20  # of error and of three standard deviations; the last bin takes what is beyond


class IntegrityHook(RunHook):
    """Notes error against told error of the machines of a run."""

    READS_TRACKS = False

    def begin(self, run: ActiveRun) -> None:
        """Know the judges of the edge."""
        found = [run.evaluation.find(name, EdgeDetection) for name in run.world.machines]
        self._judges = [judge for judge in found if judge is not None]

    def summarize(self, t: int) -> dict[str, Any]:
        """`integrity`: of all machines with an edge detector together."""
        told = [integrity_of(j.series(), j.setup.settling_m) for j in self._judges]
        return {SUMMARY: pooled(one for one in told if one["samples"])}


def integrity_of(series: EdgeSeries, settling: float) -> dict[str, Any]:
    """Counts of one run: bins (error bin, told bin, samples), samples, hazardous, episodes, longest_m, km."""
    off = np.where(np.isfinite(series.across), series.across, series.error)
    is_judged = (series.distance >= settling) & np.isfinite(off) & series.found
    error, at = np.abs(off[is_judged]), series.distance[is_judged]
    sd, confidence = series.offset_sd[is_judged], series.confidence[is_judged]
    unknown = np.where(confidence >= SURE, 0.0, BIN_M * BIN_COUNT)
    told = np.where(np.isfinite(sd), 3.0 * sd, unknown)
    pairs = np.minimum(np.stack([error, told]) // BIN_M, BIN_COUNT - 1).astype(int)
    cells, counts = np.unique(pairs, axis=1, return_counts=True)
    bins = [[int(a), int(b), int(n)] for (a, b), n in zip(cells.T, counts, strict=True)]
    is_hazard = (error > ALERT_M) & (told <= ALERT_M)
    begins = np.flatnonzero(np.diff(np.r_[0, is_hazard.astype(int)]) == 1)
    ends = np.flatnonzero(np.diff(np.r_[is_hazard.astype(int), 0]) == -1)
    driven = series.distance[series.distance >= settling]
    return {
        "bins": bins,
        "samples": len(error),
        "hazardous": int(is_hazard.sum()),
        "episodes": len(begins),
        "longest_m": float(np.max(at[ends] - at[begins], initial=0.0)),
        "km": float(np.ptp(driven)) / 1000.0 if len(driven) else 0.0,
    }


def pooled(runs: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """The counts of several runs together."""
    total = {"samples": 0, "hazardous": 0, "episodes": 0, "longest_m": 0.0, "km": 0.0}
    bins: dict[tuple[int, int], int] = {}
    for run in runs:
        for error, told, count in run["bins"]:
            bins[error, told] = bins.get((error, told), 0) + count
        longest = max(total["longest_m"], run["longest_m"])
        total = {key: total[key] + run[key] for key in total} | {"longest_m": longest}
    return {**total, "bins": [[a, b, n] for (a, b), n in sorted(bins.items())]}


def episodes_per_km(episodes: int, km: float, confidence: float = 0.95) -> float:
    """Upper limit of the rate of episodes (Poisson, Garwood 1936, doi:10.2307/2333958)."""
    from scipy import stats

    return float(stats.chi2.ppf(confidence, 2 * (episodes + 1))) / 2.0 / km if km > 0.0 else float("inf")
