"""The picture of grain handed over: how the box fills over time, how the station is kept, what is spilled."""

from typing import Any

import numpy as np

from swath.judge.evaluators.unloading import HeapRows, UnloadingSeries
from swath.report.plots import BLUE, GREEN, GREY, INK, ORANGE, evenly, panels

SHADES = "YlOrBr"


def unloading_figure(series: UnloadingSeries, machine: str) -> Any:
    """Three rows over time: the grain along the box, the deviations from the station, fill and spill.

    machine: whose box, one of `series.heaps`
    """
    heap = series.heaps[machine]
    fig, grid = panels(6.2, 3, top=0.45, gap=0.3, sharex=True)
    axes = grid[:, 0]
    _grain(fig, axes[0], heap)
    _station(axes[1], series)
    _fill(axes[2], heap, series.missed)
    axes[2].set_xlabel("time [s]")
    axes[2].set_xlim(float(heap.t[0]), float(heap.t[-1]))
    return fig


def _grain(fig: Any, ax: Any, heap: HeapRows) -> None:
    """Height of the grain along the middle of the box, by colour; a line where it stands above the rim."""
    count = heap.profile.shape[1]
    place = ((np.arange(count) + 0.5) / count - 0.5) * heap.length
    top = max(float(np.nanmax(heap.profile)), 1.2 * heap.depth)
    mesh = ax.pcolormesh(
        heap.t, place, heap.profile.T, cmap=SHADES, vmin=0.0, vmax=top, shading="nearest", rasterized=True
    )
    if np.nanmax(heap.profile) > heap.depth:
        ax.contour(heap.t, place, heap.profile.T, levels=[heap.depth], colors=INK, linewidths=0.9)
    inset = ax.inset_axes((0.78, 1.05, 0.22, 0.07))
    bar = fig.colorbar(mesh, cax=inset, orientation="horizontal")
    bar.ax.xaxis.set_ticks_position("top")
    bar.ax.tick_params(labelsize=7.5, pad=1, length=2)
    said = f"grain above the floor [m]; black line: the rim, {heap.depth:.2f} m"
    ax.set_title(said, loc="left", fontsize=8.5, color=GREY, y=1.0)
    ax.set_ylabel("ahead of the\nbox's middle [m]")
    ax.grid(visible=False)


def _station(ax: Any, series: UnloadingSeries) -> None:
    """Where the stream comes down, from where it was wanted."""
    thin = evenly(series.t)
    t = series.t[thin]
    for values, colour, label in ((series.along, BLUE, "along"), (series.across, ORANGE, "across")):
        ax.plot(t, 100.0 * values[thin], ".", color=colour, ms=1.8, mec="none", label=label)
    ax.set_ylabel("station error\n[cm]")
    ax.set_ylim(bottom=0.0)
    if len(t):
        ax.legend(loc="upper right", ncol=2, markerscale=5.0, handletextpad=0.1)


def _fill(ax: Any, heap: HeapRows, missed: float) -> None:
    """Level of the box; shaded where grain flows. missed: the box in all [kg]"""
    ax.fill_between(
        heap.t, 0.0, 1.0, where=heap.flow > 0.0, transform=ax.get_xaxis_transform(), color="#E6E9ED", lw=0,
        step="post", label="grain flows",
    )  # fmt: skip
    ax.plot(heap.t, 100.0 * heap.level, color=GREEN, lw=1.4, label="fill, of the largest heap")
    ax.set_ylabel("fill [%]")
    ax.set_ylim(0.0, 105.0)
    ax.set_title(f"missed the box in all: {missed:.1f} kg", loc="right", fontsize=8.5, color=GREY, y=1.0)
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=2, borderaxespad=0.1)
