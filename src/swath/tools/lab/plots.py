"""Figures of `swath lab stand`."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from swath.field.field import Field
from swath.field.memory_layout import Organ
from swath.report.plots import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, figure
from swath.report.stand3d import COLOURS, GROUND, Camera, organs_near
from swath.signals import F64
from swath.tools.distributions import BIN
from swath.tools.lab.comparison import CaseComparison, bin_range, describe, histogram
from swath.tools.lab.lab import Lab, Settings, make_stand

LEVEL_COLOURS = {"plants": BLUE, "empirical": ORANGE, "replay": GREEN}
REAL = "#C9CDD3"
HALF = 0.5  # half the side of the square metre that is drawn [m]


def level_colours(levels: Sequence[str]) -> dict[str, str]:
    """A colour for every level, those of the user's own too."""
    spare = iter((PURPLE, SKY, GREY, INK) * len(levels))
    return {name: LEVEL_COLOURS.get(name) or next(spare) for name in levels}


def histograms_figure(lab: Lab, cases: Sequence[CaseComparison]) -> Any:
    """One depression: densities from left to right, scanners from top to bottom; band: the first level's."""
    densities, sensors = lab.settings.densities, lab.settings.sensors
    fig = figure(11.0, 0.6 + 2.5 * len(sensors))
    axes = fig.subplots(len(sensors), len(densities), sharex=True, squeeze=False)
    low, high = bin_range(cases)
    colours = level_colours(lab.levels)
    for case in cases:
        c = case.heights.case
        ax = axes[sensors.index(c.sensor), densities.index(c.density)]
        _plot_histograms(ax, case, low, high, colours)
        ax.set_title(
            f"{c.density:g} stems/m², {c.sensor}, spot {100 * c.spot:.1f} cm", loc="left", fontsize=9.5
        )
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
        if len(rows) > 1 and name == next(iter(case.heights.heights)):
            _band(ax, edges, rows, colour)
        ax.stairs(rows.mean(axis=0), edges, baseline=None, color=colour, lw=1.5, label=name)
    ax.set_ylim(bottom=0.0)


def _band(ax: Any, edges: Any, rows: F64, colour: str) -> None:
    """From the lowest to the highest seed, as steps."""
    x = np.repeat(edges, 2)[1:-1]
    bottom, top = np.repeat(rows.min(axis=0), 2), np.repeat(rows.max(axis=0), 2)
    ax.fill_between(x, bottom, top, color=colour, alpha=0.18, lw=0)


def trends_figure(lab: Lab, cases: Sequence[CaseComparison]) -> Any:
    """Mean, spread and ground share over the depression, of the first level."""
    fig = figure(11.0, 3.4)
    axes = fig.subplots(1, 3)
    shown = {
        "crop_mean_m": "mean height of crop returns [m]",
        "crop_std_m": "std of crop returns [m]",
        "ground_share": "share of ground returns",
    }
    dashes: list[Any] = ["-", (0, (5, 2)), (0, (1, 1.5)), "-."]
    shades = [BLUE, ORANGE, GREEN, PURPLE, SKY, INK]
    for i, density in enumerate(lab.settings.densities):
        for k, sensor in enumerate(lab.settings.sensors):
            mine = [c for c in cases if (c.heights.case.density, c.heights.case.sensor) == (density, sensor)]
            mine.sort(key=lambda c: c.heights.case.depression_deg)
            angle = [c.heights.case.depression_deg for c in mine]
            of_seeds = [[describe(h) for h in c.heights.heights[lab.levels[0]]] for c in mine]
            for ax, key in zip(axes, shown, strict=True):
                rows = np.array([[d[key] for d in row] for row in of_seeds])
                colour = shades[i % len(shades)]
                ax.fill_between(angle, rows.min(axis=1), rows.max(axis=1), color=colour, alpha=0.15, lw=0)
                label = f"{density:g} stems/m², {sensor}"
                look = {"marker": "o", "ls": dashes[k % len(dashes)], "ms": 4, "color": colour}
                ax.plot(angle, rows.mean(axis=1), **look, label=label)
    for ax, label in zip(axes, shown.values(), strict=True):
        ax.set_title(label, loc="left", fontsize=9.5)
        ax.set_xlabel("looking down [deg]")
        ax.set_xticks(sorted(lab.settings.depressions_deg))
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper left", ncol=min(len(labels), 4), handlelength=3.2)
    return fig


def stands_figure(settings: Settings, crop_height: float, seed: int) -> Any:
    """A square metre of the stand of every density, seen from the front and above."""
    shown = settings.densities[:4]
    fig = figure(11.0, 0.4 + 11.0 / max(len(shown), 2) * 0.85)
    axes = fig.subplots(1, len(shown), squeeze=False)[0]
    camera = Camera.looking(
        np.array([-2.6, -1.5, 1.5 + crop_height]), np.array([0.0, 0.0, 0.42 * crop_height])
    )
    for ax, density in zip(axes, shown, strict=True):
        stand = make_stand(settings, density, seed)
        stand.ensure(0.0, 0.0, 2.0)
        _plot_square(ax, stand, camera, crop_height)
        ax.set_title(f"{density:g} stems/m²", fontsize=11)
    low = [min(ax.get_xlim()[0] for ax in axes), min(ax.get_ylim()[0] for ax in axes)]
    high = [max(ax.get_xlim()[1] for ax in axes), max(ax.get_ylim()[1] for ax in axes)]
    for ax in axes:
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        ax.set_axis_off()
    return fig


def _plot_square(ax: Any, stand: Field, camera: Camera, crop_height: float) -> None:
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb

    found = organs_near(stand, 0.0, 0.0, HALF * 1.6)
    found = found.take(np.asarray(np.abs(found.a[:, :2]).max(axis=1) < HALF))
    a, b = found.a, found.b
    image, _ = camera.project(found.quads(camera.eye))
    table = np.full((len(Organ), 3), 0.6)
    for organ, colour in COLOURS.items():
        table[organ] = to_rgb(colour)
    lit = 0.5 + 0.5 * np.clip(0.5 * (a[:, 2] + b[:, 2]) / (0.9 * crop_height), 0.0, 1.0)
    colours = table[found.organ] * lit[:, None]
    order = np.argsort(-np.linalg.norm(camera.eye - 0.5 * (a + b), axis=1))
    corner = HALF * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    ground, _ = camera.project(corner)
    ax.fill(*ground.T, color=GROUND, lw=0)
    ax.add_collection(PolyCollection(list(image[order]), facecolors=colours[order], edgecolors="none"))
    every = np.concatenate([image.reshape(-1, 2), ground])
    ax.set(xlim=(every[:, 0].min(), every[:, 0].max()), ylim=(every[:, 1].min(), every[:, 1].max()))
