"""Compares the heights of a level with a reference, and rates the differences.

The repeatability band of a level: its heights in one stand against those in another of the same kind, under
another scanner of the same make, for every pair of seeds; the worst of every number. A difference within the
band cannot be distinguished from chance. Beyond it the limits GOOD and FAIR apply.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.files.whole_file import write_csv
from swath.signals import F64
from swath.tools.distributions import BIN, GROUND_BELOW, Agreement, compare
from swath.tools.lab.lab import REFERENCE, CaseHeights, Lab
from swath.tools.lab.measured_heights import MeasuredHeights

NUMBERS = tuple(f.name for f in fields(Agreement))
RATED = ("wasserstein_m", "ks", "intersection", "p95_bias_m", "std_ratio", "ground_bias")
GOOD = {"wasserstein_m": 0.02, "ks": 0.10, "intersection": 0.85, "p95_bias_m": 0.02, "mean_bias_m": 0.04,
        "std_ratio": 1.25, "ground_bias": 0.05}  # fmt: skip
FAIR = GOOD | {"wasserstein_m": 0.04, "ks": 0.20, "intersection": 0.75}
RATINGS = ("repeatable", "good", "fair", "off")  # from best to worst
FEW = 30  # with fewer returns nothing is compared


@dataclass(frozen=True)
class LevelComparison:
    """One level of a case against something trusted more.

    against: `real`, or the reference level
    value: mean over the seeds
    band: what repeatability allows, as the size of the deviation
    ratings: of each number in RATED
    """

    level: str
    against: str
    value: dict[str, float]
    band: dict[str, float]
    ratings: dict[str, str]

    @property
    def rating(self) -> str:
        """The worst rating."""
        return max(self.ratings.values(), key=RATINGS.index)


@dataclass(frozen=True)
class CaseComparison:
    """real: heights of the file for this case [m], maybe none."""

    heights: CaseHeights
    real: F64
    comparisons: tuple[LevelComparison, ...]


def compare_levels(lab: Lab, real: MeasuredHeights | None) -> tuple[CaseComparison, ...]:
    """All cases of a lab, against real heights where there are some and against the reference level."""
    return tuple(
        _compare_case(case, np.zeros(0) if real is None else real.of(case.case)) for case in lab.cases
    )


def _compare_case(case: CaseHeights, real: F64) -> CaseComparison:
    usable = {k: v for k, v in case.heights.items() if all(_count(h) >= FEW for h in v)}
    bands = {name: repeatability(heights) for name, heights in usable.items()}
    made = []
    for name, heights in usable.items():
        if _count(real) >= FEW:
            made.append(_compare(name, "real", [compare(h, real) for h in heights], bands[name]))
        if name != REFERENCE and REFERENCE in usable:
            pairs = zip(heights, usable[REFERENCE], strict=True)
            made.append(_compare(name, REFERENCE, [compare(h, r) for h, r in pairs], bands[REFERENCE]))
    return CaseComparison(case, real, tuple(made))


def repeatability(heights: Sequence[F64]) -> dict[str, float]:
    """Largest deviation of every number over all pairs of seeds; nan with one seed."""
    found = [compare(a, b) for a, b in combinations(heights, 2)]
    if not found:
        return dict.fromkeys(NUMBERS, float("nan"))
    return {n: max(deviation(n, getattr(a, n)) for a in found) for n in NUMBERS}


def deviation(number: str, value: float) -> float:
    """How far a number of `Agreement` is from agreement: 0 is perfect, ratios as logarithms."""
    if number == "intersection":
        return 1.0 - value
    if number == "std_ratio":
        return abs(float(np.log(value))) if value > 0.0 else float("inf")
    return abs(value)


def _compare(level: str, against: str, found: Sequence[Agreement], band: dict[str, float]) -> LevelComparison:
    table = {n: [float(getattr(a, n)) for a in found] for n in NUMBERS}
    value = {n: float(np.mean(v)) for n, v in table.items()}
    ratings = {n: rating_of(n, value[n], band[n]) for n in RATED}
    return LevelComparison(level, against, value, band, ratings)


def rating_of(number: str, value: float, band: float) -> str:
    """Rating, one of RATINGS."""
    size = deviation(number, value)
    for rating, limit in (
        ("repeatable", band),
        ("good", deviation(number, GOOD[number])),
        ("fair", deviation(number, FAIR[number])),
    ):
        if size <= limit + 1e-12:
            return rating
    return "off"


def describe(heights: F64) -> dict[str, float]:
    """mean_m, std_m, p50_m, p95_m of all returns; crop_mean_m, crop_std_m of those above the ground;
    ground_share of the returns; silent_share of the beams; beams.
    """
    seen = heights[np.isfinite(heights)]
    crop = seen[seen >= GROUND_BELOW]
    nothing = float("nan")
    p50, p95 = np.percentile(seen, (50, 95)) if len(seen) else (nothing, nothing)
    return {
        "mean_m": float(seen.mean()) if len(seen) else nothing,
        "std_m": float(seen.std()) if len(seen) else nothing,
        "p50_m": float(p50),
        "p95_m": float(p95),
        "crop_mean_m": float(crop.mean()) if len(crop) else nothing,
        "crop_std_m": float(crop.std()) if len(crop) else nothing,
        "ground_share": 1.0 - len(crop) / len(seen) if len(seen) else nothing,
        "silent_share": 1.0 - len(seen) / len(heights) if len(heights) else nothing,
        "beams": len(heights),
    }


def histogram(heights: F64, low: int, high: int) -> F64:
    """Normalised histogram in bins of BIN from low * BIN to high * BIN [m], (high - low,); what lies
    outside counts in the first and last bin.
    """
    seen = heights[np.isfinite(heights)]
    at = np.clip(np.floor(seen / BIN).astype(np.int64), low, high - 1) - low
    return np.asarray(np.bincount(at, minlength=high - low) / max(len(seen), 1), dtype=np.float64)


def bin_range(cases: Sequence[CaseComparison]) -> tuple[int, int]:
    """First and last bin edge, in bins, that hold all heights of all cases."""
    every = [h for c in cases for rows in c.heights.heights.values() for h in rows] + [c.real for c in cases]
    seen = np.concatenate([h[np.isfinite(h)] for h in every])
    if len(seen) == 0:
        return 0, 1
    return int(np.floor(seen.min() / BIN)), int(np.floor(seen.max() / BIN)) + 1


def write_table(path: Path, cases: Sequence[CaseComparison]) -> Path:
    """Write lab.csv; returns its path."""
    rows = [
        {k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()} for row in list_rows(cases)
    ]
    return write_csv(path, rows)


def list_rows(cases: Sequence[CaseComparison]) -> list[dict[str, Any]]:
    """One row per case and sample: what was measured; and for each level, per sample it is held against,
    the numbers of agreement, what repeatability allows, and the ratings.
    """
    rows = []
    for case in cases:
        for name, heights in samples(case).items():
            alone = _place(case) | {"level": name, "seeds": len(heights)} | describe(np.concatenate(heights))
            mine: list[LevelComparison | None] = [j for j in case.comparisons if j.level == name]
            rows += [alone | _agreement(made) for made in mine or [None]]
    return rows


def samples(case: CaseComparison) -> dict[str, tuple[F64, ...]]:
    """Heights by the name of what measured them, `real` first where there are any."""
    return ({"real": (case.real,)} if len(case.real) else {}) | case.heights.heights


def _place(case: CaseComparison) -> dict[str, Any]:
    c = case.heights.case
    return {
        "stems_per_m2": c.density,
        "sensor": c.sensor,
        "spot_mm": round(1e3 * c.spot, 1),
        "depression_deg": c.depression_deg,
    }


def _agreement(made: LevelComparison | None) -> dict[str, Any]:
    row: dict[str, Any] = {"against": "" if made is None else made.against}
    for number in (*RATED, "mean_bias_m"):
        row[number] = "" if made is None else made.value[number]
        row[f"{number}_band"] = "" if made is None else made.band[number]
    for number in RATED:
        row[f"{number}_rating"] = "" if made is None else made.ratings[number]
    row["rating"] = "" if made is None else made.rating
    return row


def _count(heights: Any) -> int:
    return int(np.isfinite(heights).sum())
