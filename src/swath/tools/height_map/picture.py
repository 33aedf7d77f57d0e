"""What was measured, as a picture: coverage, heights, ground, and a cut across the way."""

from pathlib import Path
from typing import Any

import numpy as np

from swath.core.number_text import num
from swath.rays.height_grid import DEEP, NODES, NONE, SHARES, TILE, HeightGrid
from swath.report import plots
from swath.signals import F64

PIXELS = 1600  # along the longer side; larger grids are thinned
NEVER = "#d9d9d9"


def draw_height_map(grid: HeightGrid, path: Path, way: F64 | None = None) -> Path:
    """Write a PNG in the grid's own frame. way: driven places (n, 2) in the world."""
    import matplotlib
    from matplotlib.colors import LogNorm, Normalize

    y, x = np.nonzero(grid.table >= 0)
    tiles = np.s_[y.min() : y.max() + 1, x.min() : x.max() + 1]
    side = TILE * grid.cell
    extent = tuple(float(side * n) for n in (x.min(), x.max() + 1, y.min(), y.max() + 1))
    levels = DEEP + np.searchsorted(SHARES, (0.05, 0.95))
    count, low, high = _values(grid, tiles, levels)
    nodes = (slice(n.min() * NODES, (n.max() + 1) * NODES + 1) for n in (y, x))
    ground = grid.ground[tuple(nodes)]
    top = max(float(np.nanpercentile(high, 99.5)), 0.1) if np.isfinite(high).any() else 1.0
    counts = LogNorm(0.5, max(float(np.nanmax(count, initial=1.0)), 1.0))
    maps: list[tuple[Any, str, str, Any]] = [
        (np.maximum(count, 0.5), "echoes in a cell (grey: never measured)", "viridis", counts),
        (high, "height above ground that 95 % lie under [m]", "YlGn", Normalize(0.0, top)),
        (ground + grid.origin[2], "height of the ground [m]", "cividis", None),
    ]
    panel = float(np.clip(10.0 * (extent[3] - extent[2]) / (extent[1] - extent[0]), 1.6, 3.2))
    with plots.styled():
        fig = plots.figure(11.0, 3 * panel + 3.6)
        axes = fig.subplots(4, 1, height_ratios=(panel, panel, panel, 2.4))
        about = grid.about
        fig.suptitle(
            f"{about.get('source', '')}: {about.get('scans', 0)} scans, {about.get('echoes', 0)} echoes, "
            f"{int(grid.is_measured.sum())} cells of {num(grid.cell)} m"
        )
        for ax, (values, title, colours, norm) in zip(axes, maps, strict=False):
            shades = matplotlib.colormaps[colours].with_extremes(bad=NEVER)
            look: dict[str, Any] = {
                "cmap": shades,
                "norm": norm,
                "interpolation": "nearest",
                "aspect": "auto",
            }
            image = np.ma.masked_invalid(values)
            fig.colorbar(ax.imshow(image, origin="lower", extent=extent, **look), ax=ax, pad=0.01)
            if way is not None:
                ax.plot(*grid.to_local(way[:, 0], way[:, 1]), color="#c1272d", lw=1.2)
            ax.set(title=title, ylabel="left of it [m]", xlim=extent[:2], ylim=extent[2:])
        axes[2].set_xlabel("along the path of the machine (red) [m]")
        _across(axes[3], low, high, extent)
    return plots.write_picture(path, fig, 110)


def _values(grid: HeightGrid, tiles: Any, levels: Any) -> tuple[F64, F64, F64]:
    """Of the cells of some tiles, thinned where there are many: counts, and heights [m] at two quantiles."""
    table = grid.table[tiles]
    thin = max(1, -(-max(table.shape) * TILE // PIXELS))
    step = min(1 << (thin - 1).bit_length(), TILE)
    q = grid.quantiles[:, ::step, ::step].astype(float)
    known = q[..., 0] != NONE
    parts = (grid.count[:, ::step, ::step], q[..., levels[0]] * 1e-3, q[..., levels[1]] * 1e-3)
    found = []
    for part in parts:
        cells = np.where((table >= 0)[..., None, None], np.where(known, part, np.nan)[table], np.nan)
        found.append(cells.swapaxes(1, 2).reshape(cells.shape[0] * cells.shape[2], -1))
    return found[0], found[1], found[2]


def _across(ax: Any, low: F64, high: F64, extent: Any) -> None:
    """Heights over the place across the way, from the half of the columns in the middle."""
    columns = low.shape[1]
    middle = np.s_[:, columns // 4 : max(columns - columns // 4, columns // 4 + 1)]
    across = extent[2] + (np.arange(len(low)) + 0.5) * (extent[3] - extent[2]) / len(low)
    known = np.isfinite(high[middle]).any(axis=1)
    if known.any():
        lower, upper = np.nanmean(low[middle][known], axis=1), np.nanmean(high[middle][known], axis=1)
        ax.fill_between(across[known], lower, upper, step="mid", color="#7fb069", alpha=0.5, lw=0)
        ax.step(across[known], upper, where="mid", color="#33691e", lw=1.2)
    ax.set(xlabel="left of the way's frame [m]", ylabel="height [m]", xlim=extent[2:])
    ax.set_title("across the path, mean over its middle half: 5 to 95 % of the heights above ground")
