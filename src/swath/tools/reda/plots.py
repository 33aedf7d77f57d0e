"""Maps of `swath reda`: where each sensor detects the person, one figure per condition."""

from typing import Any

import numpy as np

from swath.report.plots import CROP, FAINT, INK, figure
from swath.tools.reda.reda import Found
from swath.tools.reda.scene import ASIDE, EDGE_M, INSIDE, Settings
from swath.tools.reda.scores import Cell

DARK = 0.55  # shares above this are written in white
ASIDE_STEP = ASIDE[1] - ASIDE[0]


def map_figure(found: Found, settings: Settings) -> Any:
    """A panel per sensor: shares of looks, the sensors at the bottom in the middle, crop above the line."""
    names = list(found.cells)
    fig = figure(0.8 + 3.1 * len(names), 5.6)
    panels = fig.subplots(1, len(names), sharey=True, squeeze=False)[0]
    image = None
    for ax, name in zip(panels, names, strict=True):
        image = _panel(ax, found.cells[name], is_first=ax is panels[0])
        scores = found.scores(name, settings.least)
        told = f"usable {scores.usability:.2f}  available {scores.availability:.2f}"
        ax.set_title(f"{name}\n{told}  reliable {scores.reliability:.2f}", loc="left", fontsize=9)
        ax.set_xlabel("aside [m]")
    panels[0].set_ylabel("ahead of the sensors [m]")
    fig.colorbar(image, ax=panels, shrink=0.75, label="share of looks that detect the person")
    fig.suptitle(f"{settings.crop} {found.condition.name}", x=0.01, ha="left", fontsize=11)
    return fig


def _panel(ax: Any, cells: list[Cell], *, is_first: bool) -> Any:
    net = np.array([cell.net for cell in cells]).reshape(len(INSIDE), len(ASIDE))
    ahead = EDGE_M + np.array(INSIDE)
    between = 0.5 * (ahead[1:] + ahead[:-1])
    rows = np.concatenate([[2.0 * ahead[0] - between[0]], between, [2.0 * ahead[-1] - between[-1]]])
    columns = np.append(np.array(ASIDE) - 0.5 * ASIDE_STEP, ASIDE[-1] + 0.5 * ASIDE_STEP)
    image = ax.pcolormesh(columns, rows, net[:, ::-1], cmap="viridis_r", vmin=0.0, vmax=1.0)
    for cell in cells:
        colour = "white" if cell.net > DARK else INK
        text = f"{100 * cell.net:.0f}"
        ax.text(-cell.aside, EDGE_M + cell.inside, text, ha="center", va="center", color=colour, fontsize=8.5)
    ax.axhline(EDGE_M, color=CROP, lw=3.0)
    if is_first:
        told = {"color": INK, "fontsize": 8, "va": "center", "ha": "right"}
        ax.annotate("crop begins", (columns[0], EDGE_M), (-26, 0), textcoords="offset points", **told)
    ax.plot(0.0, 0.6, marker="^", color=INK, ms=9, clip_on=False)
    ax.set_ylim(0.0, rows[-1])
    ax.grid(visible=False)
    ax.set_facecolor(FAINT)
    ax.set_xticks([-8, -4, 0, 4, 8], ["8 left", "4", "0", "4", "8 right"])
    return image
