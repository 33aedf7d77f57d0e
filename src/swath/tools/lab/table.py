"""lab.csv: the results of the lab as a table."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swath.signals import F64
from swath.tools.lab.comparison import (
    RATED,
    CaseComparison,
    LevelComparison,
    describe,
)


def write_table(path: Path, cases: Sequence[CaseComparison]) -> Path:
    """Write lab.csv; returns its path."""
    rows = list_rows(cases)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()})
    return path


def list_rows(cases: Sequence[CaseComparison]) -> list[dict[str, Any]]:
    """One row per case and sample: what was measured; and for each level, per sample it is held against,
    the numbers of agreement, what repeatability allows, and the ratings."""
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
