"""Draws docs/figures/rays.png: one ray, with the plants and cells that the kernel really has."""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.patches import Circle, Rectangle

from swath.core.random import Stream
from swath.field.crop_sheet import load_crop
from swath.field.memory_layout import Organ, PlantLibrary
from swath.field.prototypes import make_library

INK, GRID, STRAW, EAR, LEAF, RAY = "#33373d", "#d9dbde", "#b08d3f", "#d2691e", "#7d9352", "#c0223b"
COLOURS = {Organ.STEM: STRAW, Organ.EAR: EAR, Organ.LEAF: LEAF}


def walk(
    origin: np.ndarray, direction: np.ndarray, side: float, columns: int, bins: int, bin_height: float
) -> list[tuple[int, int, float]]:
    """Cells (ix, iz) along a ray in the x-z plane."""
    t, cells = 0.0, []
    while True:
        x, z = origin + (t + 1e-6) * direction
        ix, iz = int(np.floor(x / side)), int(np.floor(z / bin_height))
        if not (0 <= ix < columns and 0 <= iz < bins):
            return cells
        bounds = np.array([(ix + (direction[0] > 0)) * side, (iz + (direction[1] > 0)) * bin_height])
        t = ((bounds - origin) / direction).min()
        cells.append((ix, iz, t))


def side_view(ax: Any, library: PlantLibrary) -> None:
    """One row of columns: what is listed there, what a ray visits."""
    side, columns = library.tile_size / library.columns, library.columns
    bins, step, iy = library.bins, library.bin_height, 11
    items = {}
    for ix in range(columns):
        for iz in range(bins):
            c = (iy * columns + ix) * bins + iz
            items[ix, iz] = library.cell_items[library.cell_start[c] : library.cell_start[c + 1]]
    listed = np.unique(np.concatenate(list(items.values())))
    angle = np.radians(20)
    origin, direction = np.array([0.0, 1.0]), np.array([np.cos(angle), -np.sin(angle)])
    visited = walk(origin, direction, side, columns, bins, step)
    y = (iy + 0.5) * side
    start = np.array([origin[0], y, origin[1]])
    ray = np.array([direction[0], 0.0, direction[1]])
    hit, done = nearest(library, listed, start, ray), []
    for cell in visited:
        done.append(cell)
        if hit <= cell[2]:
            break
    tested = np.unique(np.concatenate([items[c[:2]] for c in done]))
    ax.add_collection(
        PatchCollection(
            [Rectangle((ix * side, iz * step), side, step) for ix, iz, _ in done],
            facecolor="#f6dfe3",
            edgecolor="none",
        )
    )
    lines = [[(i * side, 0), (i * side, bins * step)] for i in range(columns + 1)]
    lines += [[(0, k * step), (library.tile_size, k * step)] for k in range(bins + 1)]
    ax.add_collection(LineCollection(lines, colors=GRID, linewidths=0.6, zorder=1))
    for i in listed:
        bright = i in tested
        ax.plot(
            [library.a[i, 0], library.b[i, 0]],
            [library.a[i, 2], library.b[i, 2]],
            color=COLOURS[Organ(int(library.organ[i]))],
            lw=max(1.2, 620 * library.radius[i]),
            alpha=1.0 if bright else 0.28,
            solid_capstyle="round",
            zorder=3,
        )
    end = origin + hit * direction
    ax.plot([origin[0], end[0]], [origin[1], end[1]], color=RAY, lw=1.6, zorder=4)
    ax.plot(*end, "o", color=RAY, ms=5, zorder=5)
    ax.set(xlim=(0, library.tile_size), ylim=(0, bins * step), aspect="equal")
    ax.set_xlabel("along the row [m]")
    ax.set_ylabel("height above the tile's plane [m]")
    ax.set_title(
        f"In a tile: {len(done)} cells visited, {len(tested)} primitives tested, 1 hit",
        loc="left",
        fontsize=10,
    )


def nearest(library: PlantLibrary, index: np.ndarray, o: np.ndarray, d: np.ndarray) -> float:
    """Distance to the first capsule hit, by sampling the ray (enough for a picture)."""
    t = np.linspace(0, 2.5, 50_001)
    p = o + t[:, None] * d
    best = 9.0
    for i in index:
        if library.radius[i] == 0:
            continue
        a, u = library.a[i].astype(float), (library.b[i] - library.a[i]).astype(float)
        s = np.clip(((p - a) @ u) / (u @ u), 0, 1)
        inside = np.linalg.norm(p - a - s[:, None] * u, axis=1) <= library.radius[i]
        if inside.any():
            best = min(best, float(t[inside.argmax()]))
    return best


def tile_view(ax: Any) -> None:
    """Tiles from above: prototypes, mirrored, and where a ray is looked at closely."""
    rng = np.random.default_rng(3)
    width, height = 8, 5
    for ix in range(width):
        for iy in range(height):
            ax.add_patch(Rectangle((ix, iy), 1, 1, fill=False, ec=GRID, lw=0.8))
            number, mirror = rng.integers(0, 16), ["", "↔", "↕", "↔↕"][rng.integers(0, 4)]
            ax.text(
                ix + 0.5, iy + 0.5, f"{number}{mirror}", ha="center", va="center", fontsize=8, color="#9aa0a6"
            )
    a, b = np.array([0.0, 0.6]), np.array([7.1, 4.2])
    inside, end = a + 0.64 * (b - a), a + 0.9 * (b - a)
    ax.plot([a[0], inside[0]], [a[1], inside[1]], color=RAY, lw=1.6, ls=(0, (4, 3)))
    ax.plot([inside[0], end[0]], [inside[1], end[1]], color=RAY, lw=2.2)
    ax.add_patch(Circle(end, 0.09, color=RAY))
    ax.annotate(
        "above all crop of the page:\ntiles not looked at",
        (1.7, 1.47),
        (0.15, 3.55),
        fontsize=8.5,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 2.0},
        color=INK,
        arrowprops={"arrowstyle": "-", "color": INK, "lw": 0.7},
    )
    ax.annotate(
        "below the top of the tile:\nwalk its cells",
        inside + 0.35 * (end - inside),
        (4.7, 0.45),
        fontsize=8.5,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 2.0},
        color=INK,
        arrowprops={"arrowstyle": "-", "color": INK, "lw": 0.7},
    )
    ax.set(
        xlim=(0, width), ylim=(0, height), aspect="equal", xlabel="east in the stand frame [m]", ylabel="[m]"
    )
    ax.set_title("From above: 1 m tiles, each one of 16 prototypes, mirrored", loc="left", fontsize=10)


def main() -> None:
    """Writes the picture beside this file."""
    plt.rcParams.update(
        {"font.size": 9, "axes.edgecolor": "#9aa0a6", "text.color": INK, "axes.labelcolor": INK}
    )
    library = make_library(
        load_crop("wheat"), density_max=350, row_spacing=0.125, seed=Stream(4, "picture"), tile_count=1
    )
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(11, 4.9), width_ratios=(1.25, 1), layout="constrained"
    )
    tile_view(left)
    side_view(right, library)
    for ax in (left, right):
        ax.tick_params(length=0)
        for spine in ax.spines.values():
            spine.set_visible(False)
    figure.savefig(Path(__file__).with_name("rays.png"), dpi=110)


if __name__ == "__main__":
    main()
