"""Is a detector wrong and sure? The Stanford diagram of satellite navigation, for the crop edge.

Over all samples: the error that there is (x) and three standard deviations as they are reported (y). Below
the diagonal the error is more than reported (misleading); where it is beyond the alert limit, too, the
detector is sure and wrong (hazardously misleading; Tossaint et al. 2007, the Stanford-ESA integrity diagram).
One that says that it is not sure is unavailable: its samples stand in the top row. One without a standard
deviation tells 0. What sure, wrong and an episode are: `judge/evaluators/edge_detection.py`.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from swath.judge.evaluators.edge_detection import DEVIATIONS, MATCH_M, EdgeDetection, EdgeSeries

SUMMARY = "integrity"
BIN_M, BIN_COUNT = 0.03, 20  # of error and of three standard deviations; the last bin takes what is beyond


def integrity_in(judges: Sequence[EdgeDetection]) -> dict[str, Any]:
    """`integrity`: error against reported error of all machines with an edge detector together."""
    found = [integrity_of(j.series(), j.setup.settling_m) for j in judges]
    return {SUMMARY: pooled(one for one in found if one["samples"])}


def integrity_of(series: EdgeSeries, settling: float) -> dict[str, Any]:
    """Counts of one run: bins (error, reported, samples), samples, hazardous, episodes, longest_m, km."""
    s = series.settled(settling)
    beyond = BIN_M * BIN_COUNT
    error = np.where(np.isfinite(s.error), np.abs(s.error), MATCH_M)[s.found]
    reported = np.where(np.isfinite(s.offset_sd), DEVIATIONS * s.offset_sd, 0.0)
    reported = np.where(s.is_sure, reported, beyond)[s.found]
    pairs = np.minimum(np.stack([error, reported]) // BIN_M, BIN_COUNT - 1).astype(int)
    cells, counts = np.unique(pairs, axis=1, return_counts=True)
    bins = [[int(a), int(b), int(n)] for (a, b), n in zip(cells.T, counts, strict=True)]
    episodes = s.episodes()
    return {
        "bins": bins,
        "samples": len(error),
        "hazardous": int(s.is_hazardous.sum()),
        "episodes": len(episodes),
        "longest_m": max((end - begin for begin, end in episodes), default=0.0),
        "km": float(np.ptp(s.distance)) / 1000.0 if len(s.distance) else 0.0,
    }


def pooled(runs: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """The counts of several runs together."""
    total = {"samples": 0, "hazardous": 0, "episodes": 0, "longest_m": 0.0, "km": 0.0}
    bins: dict[tuple[int, int], int] = {}
    for run in runs:
        for error, reported, count in run["bins"]:
            bins[error, reported] = bins.get((error, reported), 0) + count
        longest = max(total["longest_m"], run["longest_m"])
        total = {key: total[key] + run[key] for key in total} | {"longest_m": longest}
    return {**total, "bins": [[a, b, n] for (a, b), n in sorted(bins.items())]}


def episodes_per_km(episodes: int, km: float, confidence: float = 0.95) -> float:
    """Upper limit of the rate of episodes (Poisson, Garwood 1936, doi:10.2307/2333958)."""
    from scipy import stats

    return float(stats.chi2.ppf(confidence, 2 * (episodes + 1))) / 2.0 / km if km > 0.0 else float("inf")
