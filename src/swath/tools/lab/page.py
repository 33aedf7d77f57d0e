"""report.html of `swath lab stand`: the stands, the histograms beside each other, and how alike they are."""

from collections.abc import Sequence
from math import exp
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.random import Stream
from swath.report import plots
from swath.report.page import Figure
from swath.tools.html_page import signed, write_page
from swath.tools.lab import plots as lab_plots
from swath.tools.lab.comparison import RATED, RATINGS, CaseComparison, LevelComparison, describe, summary
from swath.tools.lab.lab import REFERENCE, Lab
from swath.tools.lab.table import samples

LABELS = {
    "wasserstein_m": ("Wasserstein-1", "cm", 100.0, 1),
    "ks": ("KS", "", 1.0, 3),
    "intersection": ("intersection", "", 1.0, 2),
    "p95_bias_m": ("P95 bias", "cm", 100.0, 1),
    "std_ratio": ("std ratio", "", 1.0, 2),
    "ground_bias": ("ground share", "", 1.0, 3),
}
"""Number of agreement -> label, unit, factor from SI, digits."""
WORDS = {
    "repeatable": "within the model's own repeatability",
    "good": "within the limits",
    "fair": "within twice the limits",
    "off": "outside",
}
STATISTICS = {
    "mean_m": "mean [m]",
    "std_m": "std [m]",
    "p50_m": "median [m]",
    "p95_m": "P95 [m]",
    "ground_share": "ground share",
    "silent_share": "no return",
}
PRINTED = ("stems/m2", "scanner", "deg", "level", "against",
           *(" ".join(LABELS[n][:2]).strip() for n in RATED), "rating")  # fmt: skip


def write_lab_report(path: Path, lab: Lab, cases: Sequence[CaseComparison], real: str | None) -> Path:
    """Write the page; returns its path. real: name of the file of real heights, if one was given."""
    import matplotlib

    with matplotlib.rc_context(plots.STYLE):
        figures = _figures(lab, cases)
    made = [comparison for case in cases for comparison in case.comparisons]
    return write_page(
        path,
        "lab",
        real=real,
        levels=lab.levels,
        notes=lab.notes,
        good=sum(c.rating in ("repeatable", "good") for c in made),
        count=len(made),
        facts=_facts(lab, real),
        figures=figures,
        ratings={rating: WORDS[rating] for rating in RATINGS},
        summary={
            name: ", ".join(f"{n} {WORDS[rating]}" for rating, n in counts.items() if n)
            for name, counts in summary(cases).items()
        },
        numbers=[f"{label} [{unit}]" if unit else label for label, unit, _, _ in LABELS.values()],
        comparisons=_comparisons(cases),
        statistics_head=["stems/m²", "scanner", "looking down", "sample", "spot [cm]", *STATISTICS.values()],
        statistics=_statistics(cases),
    )


def rows_for_print(cases: Sequence[CaseComparison]) -> list[list[Any]]:
    """What the command prints: one row per comparison, numbers in the units of LABELS."""
    rows = []
    for case in cases:
        c = case.heights.case
        for made in case.comparisons:
            numbers = [_number(n, made.value[n]) for n in RATED]
            place = [f"{c.density:g}", c.sensor, f"{c.depression_deg:g}"]
            rows.append([*place, made.level, made.against, *numbers, made.rating])
    return rows


def _figures(lab: Lab, cases: Sequence[CaseComparison]) -> list[Figure]:
    seed = Stream(lab.settings.seed, "lab").seed
    fig = lab_plots.stands_figure(lab.settings, lab.crop_height, seed)
    caption = f"One square metre of each stand, seed {seed}: every stem, ear and leaf that rays can meet."
    made = [Figure("The stands", plots.as_image(fig, kind="webp", dpi=190), caption)]
    for degrees in lab.settings.depressions_deg:
        mine = [c for c in cases if c.heights.case.depression_deg == degrees]
        caption = (
            "Normalised histograms in bins of 2 cm, means of the seeds; the band is the repeatability of "
            f"{lab.levels[0]}, from the lowest to the highest seed. {degrees:g}° is how far the middle beam "
            "looks down."
        )
        image = plots.as_image(lab_plots.histograms_figure(lab, mine))
        made.append(Figure(f"Measured height at {degrees:g}°", image, caption))
    if len(lab.settings.depressions_deg) > 1:
        caption = (
            "Returns from the crop alone (5 cm above the ground and more) and the share that comes from "
            f"the ground, by the level {lab.levels[0]}: means of the seeds, the band from lowest to highest."
        )
        image = plots.as_image(lab_plots.trends_figure(lab, cases))
        made.append(Figure("Effect of density, spot and view", image, caption))
    return made


def _facts(lab: Lab, real: str | None) -> dict[str, str]:
    s = lab.settings
    beams = next((len(h[0]) for c in lab.cases for h in c.heights.values()), 0)
    return {
        "crop": f"{s.crop}, {lab.crop_height:.2f} m",
        "stems per m²": ", ".join(f"{n:g}" for n in s.densities),
        "scanners": ", ".join(s.sensors),
        "looking down": ", ".join(f"{b:g}°" for b in s.depressions_deg),
        "crop away along the beam": f"{s.distance_m:g} m",
        "beams per case and seed": str(beams),
        "seeds": f"{s.seed} to {s.seed + s.seeds - 1}",
        "real heights": real or "none given",
        **{f"set {k}": str(v) for k, v in s.sets.items()},
    }


def _comparisons(cases: Sequence[CaseComparison]) -> dict[str, list[dict[str, Any]]]:
    """Rows of the comparisons against real heights, and against the reference level."""
    found: dict[str, list[dict[str, Any]]] = {}
    for against in ("real", REFERENCE):
        rows = [_row(case, made) for case in cases for made in case.comparisons if made.against == against]
        if rows:
            found[against] = rows
    return found


def _row(case: CaseComparison, made: LevelComparison) -> dict[str, Any]:
    c = case.heights.case
    numbers = [
        {"value": _number(n, made.value[n]), "rating": made.ratings[n], "band": _band(n, made.band[n])}
        for n in RATED
    ]
    return {"case": [made.level, f"{c.density:g}", c.sensor, f"{c.depression_deg:g}°"], "numbers": numbers}


def _band(number: str, band: float) -> str:
    """What repeatability allows, in words."""
    _, _, factor, digits = LABELS[number]
    if number == "intersection":
        return f"{1.0 - band:.{digits}f}"
    if number == "std_ratio":
        return f"a factor of {exp(band):.{digits}f}"
    return f"{band * factor:.{digits}f}"


def _statistics(cases: Sequence[CaseComparison]) -> list[list[str]]:
    rows = []
    for case in cases:
        c = case.heights.case
        for name, heights in samples(case).items():
            found = describe(np.concatenate(heights))
            place = [f"{c.density:g}", c.sensor, f"{c.depression_deg:g}°", name, f"{100 * c.spot:.1f}"]
            rows.append([*place, *(signed(found[key], 3) for key in STATISTICS)])
    return rows


def _number(number: str, value: float) -> str:
    _, _, factor, digits = LABELS[number]
    return signed(value * factor, digits)
