"""report.html of `swath lab stand`: the histograms beside each other, and how alike they are."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.number_text import num
from swath.report import plots
from swath.report.html import Banner, Facts, Figure, Section, Table, element, joined, write_page
from swath.report.plots import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, figure
from swath.signals import F64
from swath.tools.distributions import BIN
from swath.tools.lab.comparison import RATED, CaseComparison, bin_range, describe, histogram, samples
from swath.tools.lab.lab import Lab

LEVEL_COLOURS = {"plants": BLUE, "empirical": ORANGE, "replay": GREEN}
REAL = "#C9CDD3"


def histograms_figure(lab: Lab, cases: Sequence[CaseComparison]) -> Any:
    """One depression: densities from left to right, scanners from top to bottom; band: the first level's."""
    densities, sensors = lab.settings.densities, lab.settings.sensors
    fig = figure(11.0, 0.6 + 2.5 * len(sensors))
    axes = fig.subplots(len(sensors), len(densities), sharex=True, squeeze=False)
    low, high = bin_range(cases)
    spare = iter((PURPLE, SKY, GREY, INK) * len(lab.levels))  # for levels of the user's own
    colours = {name: LEVEL_COLOURS.get(name) or next(spare) for name in lab.levels}
    for case in cases:
        c = case.heights.case
        ax = axes[sensors.index(c.sensor), densities.index(c.density)]
        _plot_histograms(ax, case, low, high, colours)
        title = f"{num(c.density)} stems/m², {c.sensor}, spot {num(c.spot, 'm')}"
        ax.set_title(title, loc="left", fontsize=9.5)
    for ax in axes[-1]:
        ax.set_xlabel("measured height [m]")
    for ax in axes[:, 0]:
        ax.set_ylabel("share per 2 cm")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper left", ncol=len(labels))
    return fig


def _plot_histograms(ax: Any, case: CaseComparison, low: int, high: int, colours: dict[str, str]) -> None:
    edges = BIN * np.arange(low, high + 1)
    if len(case.real):
        ax.stairs(histogram(case.real, low, high), edges, fill=True, color=REAL, label="real")
    for name, heights in case.heights.heights.items():
        rows: F64 = np.array([histogram(h, low, high) for h in heights], np.float64)
        colour = colours[name]
        if len(rows) > 1 and name == next(iter(case.heights.heights)):  # from the lowest to the highest seed
            band = {"baseline": rows.min(axis=0), "fill": True, "color": colour, "alpha": 0.18, "lw": 0}
            ax.stairs(rows.max(axis=0), edges, **band)
        ax.stairs(rows.mean(axis=0), edges, baseline=None, color=colour, lw=1.5, label=name)
    ax.set_ylim(bottom=0.0)


LABELS = {
    "wasserstein_m": "Wasserstein-1 [m]",
    "ks": "KS",
    "intersection": "intersection",
    "p95_bias_m": "P95 bias [m]",
    "std_ratio": "std ratio",
    "ground_bias": "ground share",
}
"""Number of agreement -> label."""
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
ABOUT_ROWS = (
    "A row has the colour of the worst of its numbers; `lab.csv` has the rating and the repeatability of "
    "each."
)
ABOUT_HEIGHTS = (
    "A height is that of a reported echo, placed as the scanner itself would place it: range noise and "
    "the constant range error of the instance are included. Each seed is another stand of the same kind "
    "under another scanner of the same make; all levels see the same stands from the same places.",
    "Repeatability: the heights of one seed against those of another, for every pair of seeds, the worst "
    "of each number. A smaller difference cannot be distinguished from chance.",
)
ABOUT_REAL = (
    "No real heights were given. The comparisons show how far the levels agree with each other, not with "
    "a real stand. `--real FILE` adds heights measured in the field."
)
HEAD = ("stems/m2", "scanner", "deg", "level", "against", *(LABELS[n] for n in RATED), "rating")


def write_lab_report(path: Path, lab: Lab, cases: Sequence[CaseComparison], real: str | None) -> Path:
    """Write the page; returns its path. real: name of the file of real heights, if one was given."""
    rows = comparison_rows(cases)
    good = sum(row[-1] in ("repeatable", "good") for row in rows)
    keys = [element("span", text, class_=rating) for rating, text in WORDS.items()]
    agreement = Table("", HEAD, rows, range(5, len(HEAD)), ABOUT_ROWS, [row[-1] for row in rows])
    statistics = [*HEAD[:3], "sample", "spot [m]", *STATISTICS.values()]
    sections = [
        *_figures(lab, cases),
        Section("Agreement", [element("p", joined(keys, ""), class_="key"), agreement] if rows else []),
        Table("Measured heights", statistics, _statistics(cases), range(4, 11)),
        Section("How to read this", [*ABOUT_HEIGHTS, "" if real else ABOUT_REAL]),
    ]
    levels = f"{f'{real} and the' if real else 'The'} levels {', '.join(lab.levels)}"
    verdict = ("none", "Nothing to compare", "one level, no real heights")
    if rows:
        said = f"{good} of {len(rows)} comparisons good"
        kind = "pass" if good == len(rows) else "fail"
        verdict = (kind, said, "in all six numbers, or repeatable")
    return write_page(
        path,
        sections,
        heading="Lab stand",
        lead=f"{levels} of the LiDAR over the same stands.",
        verdict=verdict,
        top=[*map(Banner, lab.notes), Facts(_settings(lab, real))],
    )


def comparison_rows(cases: Sequence[CaseComparison]) -> list[list[str]]:
    """One row of HEAD per comparison, as text in the units of LABELS."""
    rows = []
    for case in cases:
        c = case.heights.case
        for made in case.comparisons:
            numbers = [num(made.value[n]) for n in RATED]
            place = [num(c.density), c.sensor, num(c.depression_deg), made.level, made.against]
            rows.append([*place, *numbers, made.rating])
    return rows


def _figures(lab: Lab, cases: Sequence[CaseComparison]) -> list[Figure]:
    made = []
    with plots.styled():
        for degrees in lab.settings.depressions_deg:
            mine = [c for c in cases if c.heights.case.depression_deg == degrees]
            caption = (
                "Normalised histograms in bins of 2 cm, means of the seeds; the band is the repeatability of "
                f"{lab.levels[0]}, from the lowest to the highest seed. {num(degrees)}° is how far the "
                "middle beam looks down."
            )
            image = plots.as_image(histograms_figure(lab, mine))
            made.append(Figure(f"Measured height at {num(degrees)}°", image, caption))
    return made


def _settings(lab: Lab, real: str | None) -> dict[str, str]:
    s = lab.settings
    beams = next((len(h[0]) for c in lab.cases for h in c.heights.values()), 0)
    return {
        "crop": f"{s.crop}, {num(lab.crop_height)} m",
        "crop away along the beam": f"{num(s.distance_m)} m",
        "beams per case and seed": str(beams),
        "seeds": f"{s.seed} to {s.seed + s.seeds - 1}",
        "real heights": real or "none given",
        **{f"set {k}": str(v) for k, v in s.sets.items()},
    }


def _statistics(cases: Sequence[CaseComparison]) -> list[list[str]]:
    rows = []
    for case in cases:
        c = case.heights.case
        for name, heights in samples(case).items():
            found = describe(np.concatenate(heights))
            place = [num(c.density), c.sensor, num(c.depression_deg), name, num(c.spot)]
            rows.append([*place, *(num(found[key]) for key in STATISTICS)])
    return rows
