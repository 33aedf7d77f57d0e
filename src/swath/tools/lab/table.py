"""lab.csv and lab.json: what the lab came to, as a table and with the histograms."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swath import __version__
from swath.judge.summary import json_safe
from swath.signals import F64
from swath.tools.distributions import BIN
from swath.tools.lab.agreement import (
    FAIR,
    GOOD,
    SHOWN,
    Judged,
    JudgedCase,
    bin_range,
    describe,
    histogram,
    summary,
)
from swath.tools.lab.lab import Lab


def write_tables(folder: Path, lab: Lab, cases: Sequence[JudgedCase], real: str | None) -> list[Path]:
    """Write lab.json and lab.csv; returns their paths."""
    whole = folder / "lab.json"
    text = json.dumps(json_safe(document(lab, cases, real)), indent=1, ensure_ascii=False)
    whole.write_text(text + "\n", encoding="utf-8")
    table = folder / "lab.csv"
    rows = list_rows(lab, cases)
    with table.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()})
    return [whole, table]


def list_rows(lab: Lab, cases: Sequence[JudgedCase]) -> list[dict[str, Any]]:
    """One row per case and sample: what was measured; and for each level, per sample it is held against,
    the numbers of agreement, what repeatability allows, and the verdicts."""
    rows = []
    for case in cases:
        for name, heights in samples(case).items():
            alone = _place(case) | {"level": name, "seeds": len(heights)} | describe(np.concatenate(heights))
            mine: list[Judged | None] = [j for j in case.judged if j.level == name]
            rows += [alone | _agreement(judged) for judged in mine or [None]]
    return rows


def samples(case: JudgedCase) -> dict[str, tuple[F64, ...]]:
    """Heights by the name of what measured them, `real` first where there are any."""
    return ({"real": (case.real,)} if len(case.real) else {}) | case.heights.heights


def _place(case: JudgedCase) -> dict[str, Any]:
    c = case.heights.case
    return {
        "stems_per_m2": c.density,
        "sensor": c.sensor,
        "spot_mm": round(1e3 * c.spot, 1),
        "depression_deg": c.depression_deg,
    }


def _agreement(judged: Judged | None) -> dict[str, Any]:
    row: dict[str, Any] = {"against": "" if judged is None else judged.against}
    for number in (*SHOWN, "mean_bias_m"):
        row[number] = "" if judged is None else judged.value[number]
        row[f"{number}_band"] = "" if judged is None else judged.band[number]
    for number in SHOWN:
        row[f"{number}_verdict"] = "" if judged is None else judged.verdict[number]
    row["verdict"] = "" if judged is None else judged.overall
    return row


def document(lab: Lab, cases: Sequence[JudgedCase], real: str | None) -> dict[str, Any]:
    """The content of lab.json. Bands are sizes of deviations: 1 - intersection, |log std_ratio|."""
    s = lab.settings
    low, high = bin_range(cases)
    return {
        "name": "lab stand",
        "swath": __version__,
        "settings": {
            "crop": s.crop,
            "crop_height_m": lab.crop_height,
            "stems_per_m2": list(s.densities),
            "sensors": list(s.sensors),
            "depression_deg": list(s.depressions_deg),
            "levels": list(lab.levels),
            "seed": s.seed,
            "seeds": s.seeds,
            "distance_m": s.distance_m,
            "half_sector_deg": s.half_sector_deg,
            "passes": s.passes,
            "stops": s.stops,
            "set": s.sets,
            "real": real,
        },
        "notes": list(lab.notes),
        "limits": {"good": {n: GOOD[n] for n in SHOWN}, "fair": {n: FAIR[n] for n in SHOWN}},
        "verdicts": summary(cases),
        "bins": {"first_m": low * BIN, "width_m": BIN, "count": high - low},
        "cases": [_case(case, low, high) for case in cases],
    }


def _case(case: JudgedCase, low: int, high: int) -> dict[str, Any]:
    return _place(case) | {
        "samples": {
            name: {
                **describe(np.concatenate(heights)),
                "of_seeds": [describe(h) for h in heights],
                "histogram_of_seeds": [histogram(h, low, high).round(6).tolist() for h in heights],
                "band": case.bands.get(name, {}),
            }
            for name, heights in samples(case).items()
        },
        "judged": [
            {
                "level": j.level,
                "against": j.against,
                "value": j.value,
                "worst": j.worst,
                "band": j.band,
                "verdict": j.verdict,
                "overall": j.overall,
            }
            for j in case.judged
        ],
    }
