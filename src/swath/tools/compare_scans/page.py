"""The files of a comparison of scans: pictures, page, results."""

from pathlib import Path
from typing import Any

import numpy as np

from swath.core.number_text import num, percent_of, signed
from swath.documents.json_file import write_json
from swath.report.html import Facts, Figure, Items, Section, Table, write_page
from swath.report.plots import BLUE, FAINT, GREY, INK, ORANGE, as_image, figure, styled, write_picture
from swath.signals import F64
from swath.tools.compare_scans.compare import (
    BIN_M,
    DISTANCES,
    DRAWS,
    FEWEST,
    FEWEST_BLOCKS,
    TOP,
    Comparison,
    Number,
)
from swath.tools.distributions import GROUND_BELOW

HEAD = ("mean over the cells", "A", "B", "B - A", "95 % interval", "")
WORDS = {
    "w1_m": "W1 of heights [m]",
    "ks": "KS of heights",
    "intensity_w1": "W1 of intensity",
    "mean_m": "height [m]",
    "top_m": f"height that {num(TOP)} % lie under [m]",
    "ground_share": "share from the ground",
    "penetration_m": "depth in the crop [m]",
    "returns_per_m2": "returns per m2",
    "intensity": "intensity",
}


def number_rows(made: Comparison) -> list[list[str]]:
    """A row for each number: what, A, B, difference or distance, its interval, what it means."""
    return [_row(n) for n in made.numbers]


def _row(n: Number) -> list[str]:
    label, difference = WORDS[n.name], signed(n.difference, of=(n.a, n.b))
    if n.name in DISTANCES:
        noise = f"noise up to {num(n.spread[0])}" if n.spread else ""
        return [label, "", "", num(n.difference), "", f"{noise}{_beyond(n)}"]
    ends = " to ".join(signed(v, of=(n.a, n.b)) for v in n.spread)
    said = "" if not n.spread or n.spread[0] <= 0.0 <= n.spread[1] else "differs"
    return [label, num(n.a), num(n.b), difference, ends, said]


def _beyond(n: Number) -> str:
    if not n.spread:
        return ""
    return "; beyond it" if n.difference > n.spread[0] else "; within it"


def write_comparison(made: Comparison, out: Path) -> None:
    """Write results.json, profiles.png, map.png, report.html."""
    write_json(out / "results.json", made.to_dict())
    pictures = {"profiles.png": draw_profiles(made), "map.png": draw_map(made)}
    for name, fig in pictures.items():
        write_picture(out / name, fig)
    w1 = made.number("w1_m")
    noise = f"noise up to {num(w1.spread[0], 'm')}" if w1.spread else "too short for its noise"
    is_beyond = not w1.spread or w1.difference > w1.spread[0]
    facts = {
        "cells": f"{len(made.cells)} of {num(made.grid.cell_m)} m across",
        "blocks": f"{len(made.blocks)} of {num(made.grid.block_m)} m along",
        "aligned by": made.align,
    }
    read = [[what, *(_fact(v) for v in pair)] for what, pair in made.facts.items()]
    sections = [
        Section("What was taken for granted", [Items(made.notes)]),
        Table("How far apart", HEAD, number_rows(made), (1, 2, 3), ABOUT_NUMBERS),
        Figure("Across the path", as_image(pictures["profiles.png"]), ABOUT_PROFILES),
        Figure("From above", as_image(pictures["map.png"]), ABOUT_MAP),
        Table("What was read", ("", "A", "B"), read, (1, 2), ABOUT_READ),
    ]
    write_page(
        out / "report.html",
        sections,
        heading="Two sets of scans",
        title="{1} against {0}, compare scans".format(*made.names),
        lead="A: {}; B: {}".format(*made.names),
        verdict=("none" if is_beyond else "pass", f"W1 {num(w1.difference, 'm')}", noise),
        top=[Facts(facts)],
    )


ABOUT_NUMBERS = (
    "W1, the Wasserstein distance, is by how much the heights of a cell would have to be moved on average "
    "to become those of the other; KS is the largest difference of the shares that lie below any height. "
    "Noise: what they come to when in each block A and B are exchanged by the toss of a coin, so that "
    f"both are alike; 95 % of {DRAWS} tosses stay below. The interval of a difference comes from drawing "
    f"blocks with replacement. Both need {FEWEST_BLOCKS} blocks."
)
ABOUT_READ = (
    f"A cell counts with {FEWEST} echoes of both. Echoes lower than {num(GROUND_BELOW, 'm')} come from "
    "the ground, the others from crop or stubble. Depth: of the echoes from crop below the height that 95 "
    "% of the cell's lie under."
)
ABOUT_PROFILES = (
    "Each cell over its whole length. Bands: 5 to 95 % of the heights, thick lines: their medians. Grey: "
    "what the W1 of a cell comes to by chance."
)
ABOUT_MAP = "Cells and blocks with echoes enough of both. Blue: B lower than A, red: higher."


def _fact(value: Any) -> str:
    if value is None:
        return "not known"
    if isinstance(value, float):
        return percent_of(value)
    return num(value)


def _column(made: Comparison, name: str) -> tuple[F64, F64]:
    """Left of the path and values of the cells, nan between cells that are apart."""
    left = np.array([row["left_m"] for row in made.cells])
    values = np.array([row.get(name, np.nan) for row in made.cells], dtype=float)
    gaps = np.flatnonzero(np.diff(left) > 1.5 * made.grid.cell_m) + 1
    return np.insert(left, gaps, np.nan), np.insert(values, gaps, np.nan)


def draw_profiles(made: Comparison) -> Any:
    """Over the place across the path: heights of both, their W1, ground, depth, returns; and histograms."""
    with styled():
        fig = figure(12.0, 10.5)
        grid = fig.add_gridspec(4, 2, height_ratios=(2.4, 1.2, 1.2, 1.6))
        heights = fig.add_subplot(grid[0, :])
        for letter, colour, name in zip("ab", (INK, ORANGE), made.names, strict=True):
            left, low = _column(made, f"p5_m_{letter}")
            top = _column(made, f"top_m_{letter}")[1]
            heights.fill_between(left, low, top, color=colour, alpha=0.15, lw=0)
            label = f"{letter.upper()}: {name}"
            heights.plot(left, _column(made, f"p50_m_{letter}")[1], color=colour, lw=1.5, label=label)
            heights.plot(left, top, color=colour, lw=0.8)
        heights.set(ylabel="height [m]", title="heights over the ground")
        heights.legend(loc="upper left")
        distance = fig.add_subplot(grid[1, :], sharex=heights)
        left, noise = _column(made, "w1_noise_m")
        distance.fill_between(left, 0.0, 100 * noise, color=FAINT, lw=0, label="noise, 95 %")
        distance.plot(left, 100 * _column(made, "w1_m")[1], color=BLUE, lw=1.5, label="W1")
        distance.set(ylabel="W1 of heights [cm]")
        distance.set_ylim(bottom=0.0)
        distance.legend(loc="upper right", ncol=2)
        for k, (key, label) in enumerate(_SMALL.items()):
            _pair(fig.add_subplot(grid[2, k], sharex=heights), made, key, 100.0, label)
        _pair(fig.add_subplot(grid[3, 0], sharex=heights), made, "returns_per_m2", 1.0, "returns per m²")
        fig.axes[-1].set(xlabel="left of the path [m]")
        _histograms(fig.add_subplot(grid[3, 1]), made)
        heights.invert_xaxis()  # as one sees it from behind: left is left
    return fig


_SMALL = {"ground_share": "from the ground [%]", "penetration_m": "depth in crop [cm]"}


def _pair(ax: Any, made: Comparison, key: str, scale: float, label: str) -> None:
    for letter, colour in zip("ab", (INK, ORANGE), strict=True):
        left, values = _column(made, f"{key}_{letter}")
        ax.plot(left, scale * values, color=colour, lw=1.3)
    ax.set(ylabel=label)
    ax.set_ylim(bottom=0.0)


def _histograms(ax: Any, made: Comparison) -> None:
    low = min(float(np.percentile(h, 0.1)) for h in made.heights)
    high = max(float(np.percentile(h, 99.9)) for h in made.heights)
    edges = np.arange(low, high + 4 * BIN_M, 2 * BIN_M)
    for height, colour in zip(made.heights, (INK, ORANGE), strict=True):
        ax.hist(height, edges, density=True, histtype="step", color=colour, lw=1.2)
    ax.set(xlabel="height [m]", ylabel="density [1/m]", title="all compared cells")


def draw_map(made: Comparison) -> Any:
    """W1 and the difference of the mean heights, along and across."""
    import matplotlib as mpl

    known = np.isfinite(made.map_w1)
    rows = np.flatnonzero(known.any(axis=1))
    part = slice(int(rows[0]), int(rows[-1]) + 1)
    first = round(made.cells[0]["left_m"] / made.grid.cell_m - 0.5)
    ends = (
        float(made.blocks[0]), float(made.blocks[-1] + made.grid.block_m),
        made.grid.cell_m * first, made.grid.cell_m * (first + part.stop - part.start),
    )  # fmt: skip
    with styled(**{"axes.grid": False}):
        fig = figure(12.0, 6.4)
        axes = fig.subplots(2, 1, sharex=True)
        w1, mean = 100 * made.map_w1[part], 100 * made.map_mean[part]
        top = max(1.0, float(np.nanpercentile(w1, 98.0)))
        size = max(1.0, float(np.nanpercentile(np.abs(mean), 98.0)))
        looks = [
            (w1, "W1 of heights [cm]", "viridis", 0.0, top),
            (mean, "mean, B - A [cm]", "RdBu_r", -size, size),
        ]
        for ax, (values, label, colours, low, high) in zip(axes, looks, strict=True):
            shades = mpl.colormaps[colours].with_extremes(bad=FAINT)
            image = ax.imshow(
                np.ma.masked_invalid(values), origin="lower", extent=ends, aspect="auto", cmap=shades,
                vmin=low, vmax=high, interpolation="nearest",
            )  # fmt: skip
            fig.colorbar(image, ax=ax, label=label, pad=0.01)
            ax.axhline(0.0, color=GREY, lw=0.8, ls=(0, (4, 3)))
            ax.set(ylabel="left of the path [m]")
        axes[-1].set(xlabel="along the path [m]")
    return fig
