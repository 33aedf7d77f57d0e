"""Figures of `swath lab stand`: histograms of the measured height."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from swath.report.plots import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, figure
from swath.signals import F64
from swath.tools.distributions import BIN
from swath.tools.lab.comparison import CaseComparison, bin_range, histogram
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
        title = f"{c.density:g} stems/m², {c.sensor}, spot {100 * c.spot:.1f} cm"
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
