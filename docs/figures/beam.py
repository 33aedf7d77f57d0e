"""Draws docs/figures/beam.png: patterns, spots, echo rules at a depth edge, dust. Run from anywhere."""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Circle

from swath.core.random import Stream
from swath.rays.hits import Spots
from swath.report import plots
from swath.sensing.beam import offsets_of, spot_pattern
from swath.sensing.echo import Bundle, Receiver, Weather, disturb, least_energy, merging_gap, receive
from swath.sensing.lidar_sheet import load_lidar

SCANNERS = {
    "sick-lms111": plots.ORANGE,
    "sick-lms511-sr": plots.PURPLE,
    "hokuyo-utm-30lx": plots.GREEN,
    "sick-lms511-hr": plots.BLUE,
    "ouster-os1-64": plots.SKY,
    "velodyne-vlp16": plots.GREY,
}


def draw_pattern(ax: Any, count: int) -> None:
    """Sub-rays of a gaussian spot; area of a dot = its energy; orange: not in the next smaller pattern."""
    pattern = spot_pattern(count, "gaussian")
    smaller = {7: 1, 19: 7, 37: 19, 61: 37}[count]
    old = spot_pattern(smaller, "gaussian").position
    is_new = np.linalg.norm(pattern.position[:, None] - old[None], axis=2).min(axis=1) > 1e-9
    ax.add_patch(Circle((0, 0), 1.0, facecolor=plots.SOIL, edgecolor=plots.INK, lw=1))
    ax.add_patch(Circle((0, 0), pattern.outermost, fill=False, ls=":", edgecolor=plots.GREY))
    colours = np.where(is_new, plots.ORANGE, plots.BLUE)
    ax.scatter(*pattern.position.T, s=1400 * pattern.weight, c=colours, lw=0, zorder=3)
    ax.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), aspect="equal")
    ax.set_title(f"{count} sub-rays, outermost at {pattern.outermost:.2f}", fontsize=9.5)
    ax.set_axis_off()


def draw_spots(ax: Any) -> None:
    """Spot diameters of bundled scanners against range."""
    distance = np.linspace(0, 15, 50)
    for name, colour in SCANNERS.items():
        across = load_lidar(name).beam.diameter(distance)[:, 0] * 1e3
        ax.plot(distance, across, color=colour)
        ax.annotate(name, (15, across[-1]), xytext=(4, 0), textcoords="offset points", color=colour,
                    va="center", fontsize=8)  # fmt: skip
    ax.set(xlim=(0, 15), ylim=(0, None), xlabel="range [m]")
    ax.set_title("spot across, 1/e2 contour [mm]", loc="left", fontsize=9.5)


def draw_edge(ax: Any, *, far: float) -> None:
    """What a LMS1xx reports when it sweeps over the edge of a wall at 3 m."""
    sheet, near = load_lidar("sick-lms111"), 3.0
    azimuth = np.radians(np.arange(-1.0, 1.001, 0.04))
    zero = np.zeros_like(azimuth)
    axes = np.stack(
        [
            np.stack([np.cos(azimuth), np.sin(azimuth), zero], axis=1),
            np.stack([-np.sin(azimuth), np.cos(azimuth), zero], axis=1),
            np.stack([zero, zero, zero + 1.0], axis=1),
        ],
        axis=2,
    )
    pattern = spot_pattern(61, sheet.beam.profile)
    offsets = offsets_of(sheet.beam, pattern.position[None])
    start, aim = Spots(np.zeros((len(azimuth), 3)), axes, offsets).rays()
    to_near, to_far = ((wall - start[..., 0]) / aim[..., 0] for wall in (near, far))
    distance = np.where(start[..., 1] + to_near * aim[..., 1] > 0.0, to_near, to_far)
    bundle = Bundle(distance, pattern.weight, np.full_like(distance, 0.5))
    shared = {"gap": merging_gap(sheet.pulse), "least_energy": least_energy(sheet.range_10), "count": 2}
    for rule, more, style in (
        ("nearest", {}, {"color": plots.BLUE, "lw": 4, "alpha": 0.35}),
        ("percentile", {}, {"color": plots.INK, "lw": 1.2}),
        ("mean", {}, {"color": plots.ORANGE, "lw": 1.5}),
        ("leading_edge", {"threshold": 0.25}, {"color": plots.GREEN, "lw": 1.2, "ls": "--"}),
        ("all", {"within": "mean"}, {"color": plots.PURPLE, "marker": ".", "ms": 4, "lw": 0}),
    ):
        found = receive(bundle, Receiver(rule, **(shared | more))).distance
        label = {
            "percentile": "percentile 50",
            "all": "all, within mean",
            "leading_edge": "leading_edge 25 %",
        }
        ax.plot(np.degrees(azimuth), found[:, 0], label=label.get(rule, rule), **style)
        if found.shape[1] > 1:
            ax.plot(np.degrees(azimuth), found[:, 1], **style)
    ax.set(xlabel="azimuth [deg]", ylim=(2.8, 4.4))
    ax.set_title(f"range [m], walls at {near:g} and {far:g} m", loc="left", fontsize=9.5)


def draw_dust(ax: Any) -> None:
    """Share of beams that still see a target of crop, and that report a puff instead."""
    sheet = load_lidar("sick-lms511-hr")
    distance = np.repeat(np.arange(1.0, 45.1, 1.0), 400)[:, None] * np.ones((1, 19))
    receiver = Receiver(least_energy=least_energy(sheet.range_10))
    for extinction, colour in ((0.0, plots.INK), (0.05, plots.BLUE), (0.1, plots.GREEN), (0.2, plots.ORANGE)):
        weather = Weather(extinction_per_m=extinction, near_returns=0.2 if extinction else 0.0)
        air = Stream(1, "air").at(0)
        moved, albedo = disturb(weather, distance, np.full_like(distance, 0.3), sheet.range_min, air)
        found = receive(Bundle(moved, np.full(19, 1 / 19), albedo), receiver).distance[:, 0]
        good = (np.abs(found - distance[:, 0]) < 0.1).reshape(-1, 400).mean(axis=1)
        ax.plot(distance[::400, 0], good, color=colour, label=f"{extinction:g} /m")
    ax.set(xlabel="range of the target [m]", ylim=(-0.03, 1.05), xlim=(0, 45))
    ax.legend(title="extinction", loc="center right")
    ax.set_title("beams that see 30 % grey, 0.2 puffs each", loc="left", fontsize=9.5)


def main() -> None:
    """Write the picture beside this file."""
    with plt.rc_context(plots.STYLE):
        fig = plt.figure(figsize=(14.5, 8.2), layout="constrained")
        top, bottom = fig.subfigures(2, 1, height_ratios=(1.0, 1.1))
        for ax, count in zip(top.subplots(1, 4), (7, 19, 37, 61), strict=True):
            draw_pattern(ax, count)
        spots, apart, close, dust = bottom.subplots(1, 4, width_ratios=(1.3, 1, 1, 1.05))
        draw_spots(spots)
        draw_edge(apart, far=4.2)
        draw_edge(close, far=3.5)
        close.legend(loc="upper right", fontsize=8)
        draw_dust(dust)
        fig.savefig(Path(__file__).with_name("beam.png"), dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
