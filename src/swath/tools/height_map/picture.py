"""What was measured, as a picture: coverage, heights, ground, and a cut across the way."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.rays.height_grid import DEEP, NODES, NONE, SHARES, TILE, HeightGrid

Array = NDArray[np.float64]
PIXELS = 1600  # along the longer side; larger grids are thinned
NEVER = "#d9d9d9"


def draw_height_map(grid: HeightGrid, path: Path, way: Array | None = None) -> Path:
    """Write a PNG in the grid's own frame. way: driven places (n, 2) in the world."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    tiles = _window(grid)
    count, low, high, extent = _maps(grid, tiles)
    driven = None
    if way is not None:
        u, v = grid.to_local(way[:, 0], way[:, 1])
        driven = np.stack([u, v], axis=1)
    wide = extent[1] - extent[0]
    tall = extent[3] - extent[2]
    with matplotlib.rc_context({"font.size": 9, "axes.titlesize": 10, "axes.titlelocation": "left"}):
        panel = float(np.clip(10.0 * tall / wide, 1.6, 3.2))
        fig = Figure(figsize=(11.0, 3 * panel + 3.6), layout="constrained")
        FigureCanvasAgg(fig)
        axes = fig.subplots(4, 1, height_ratios=(panel, panel, panel, 2.4))
        fig.suptitle(_headline(grid), x=0.01, ha="left", fontsize=10)
        top = max(float(np.nanpercentile(high, 99.5)), 0.1) if np.isfinite(high).any() else 1.0
        _map(axes[0], count, extent, driven, "echoes in a cell (grey: never measured)", "viridis", log=True)
        _map(axes[1], high, extent, driven, "height above ground that 95 % lie under [m]", "YlGn", 0.0, top)
        ground, deep = _ground(grid, tiles), "height of the ground [m]"
        _map(axes[2], ground, extent, driven, deep, "cividis")
        axes[2].set_xlabel("along the way [m]")
        _across(axes[3], grid, tiles, low, high, extent)
        fig.savefig(path, dpi=110)
    return path


def _headline(grid: HeightGrid) -> str:
    about = grid.about
    return (
        f"{about.get('source', '')}: {about.get('scans', 0)} scans, {about.get('echoes', 0)} echoes, "
        f"{int(grid.is_measured.sum())} cells of {grid.cell:g} m"
    )


def _window(grid: HeightGrid) -> tuple[int, int, int, int]:
    """Rows and columns of tiles with echoes."""
    ty, tx = np.nonzero(grid.table >= 0)
    return int(ty.min()), int(ty.max()) + 1, int(tx.min()), int(tx.max()) + 1


def _maps(
    grid: HeightGrid, tiles: tuple[int, int, int, int]
) -> tuple[Array, Array, Array, tuple[float, float, float, float]]:
    """Counts, and heights at 5 and 95 % of the cells in the window, thinned where it is large; its extent."""
    y0, y1, x0, x1 = tiles
    thin = max(1, -(-max(y1 - y0, x1 - x0) * TILE // PIXELS))
    thin = 1 << (thin - 1).bit_length() if thin > 1 else 1
    side = max(TILE // thin, 1)
    shape = ((y1 - y0) * side, (x1 - x0) * side)
    count, low, high = (np.full(shape, np.nan) for _ in range(3))
    step = TILE // side
    quantile = DEEP + np.searchsorted(SHARES, (0.05, 0.95))
    for ty in range(y0, y1):
        for tx in range(x0, x1):
            slot = grid.table[ty, tx]
            if slot < 0:
                continue
            q = grid.quantiles[slot, ::step, ::step]
            known = q[..., 0] != NONE
            part = np.s_[(ty - y0) * side : (ty - y0 + 1) * side, (tx - x0) * side : (tx - x0 + 1) * side]
            count[part] = np.where(known, grid.count[slot, ::step, ::step], np.nan)
            low[part] = np.where(known, q[..., quantile[0]] * 1e-3, np.nan)
            high[part] = np.where(known, q[..., quantile[1]] * 1e-3, np.nan)
    edge = TILE * grid.cell
    return count, low, high, (x0 * edge, x1 * edge, y0 * edge, y1 * edge)


def _ground(grid: HeightGrid, tiles: tuple[int, int, int, int]) -> Array:
    y0, y1, x0, x1 = (n * NODES for n in tiles)
    return np.asarray(grid.ground[y0 : y1 + 1, x0 : x1 + 1] + grid.origin[2])


def _map(
    ax: Any,
    values: Array,
    extent: tuple[float, float, float, float],
    driven: Array | None,
    title: str,
    colours: str,
    low: float | None = None,
    high: float | None = None,
    *,
    log: bool = False,
) -> None:
    import matplotlib
    from matplotlib.colors import LogNorm

    shades = matplotlib.colormaps[colours].with_extremes(bad=NEVER)
    norm = None
    if log:
        values = np.where(np.isfinite(values), np.maximum(values, 0.5), np.nan)
        norm = LogNorm(0.5, max(float(np.nanmax(values, initial=1.0)), 1.0))
    limits = {} if norm is not None else {"vmin": low, "vmax": high}
    drawn = ax.imshow(
        np.ma.masked_invalid(values), origin="lower", extent=extent, cmap=shades, norm=norm,
        interpolation="nearest", aspect="auto", **limits,
    )  # fmt: skip
    ax.figure.colorbar(drawn, ax=ax, pad=0.01)
    if driven is not None:
        ax.plot(driven[:, 0], driven[:, 1], color="#c1272d", lw=1.2, label="way of the machine")
        ax.set(xlim=extent[:2], ylim=extent[2:])
        ax.legend(loc="upper right", fontsize=8)
    ax.set_title(title)
    ax.set_ylabel("left of it [m]")


def _across(
    ax: Any,
    grid: HeightGrid,
    tiles: tuple[int, int, int, int],
    low: Array,
    high: Array,
    extent: tuple[float, float, float, float],
) -> None:
    """Heights over the place across the way, from the half of the columns in the middle."""
    columns = low.shape[1]
    middle = np.s_[:, columns // 4 : max(columns - columns // 4, columns // 4 + 1)]
    across = np.linspace(extent[2], extent[3], low.shape[0], endpoint=False)
    across = across + 0.5 * (extent[3] - extent[2]) / low.shape[0]
    known = np.isfinite(high[middle]).any(axis=1)
    if known.any():
        lower, upper = np.nanmean(low[middle][known], axis=1), np.nanmean(high[middle][known], axis=1)
        ax.fill_between(across[known], lower, upper, step="mid", color="#7fb069", alpha=0.5, lw=0)
        ax.step(across[known], upper, where="mid", color="#33691e", lw=1.2)
    ax.axhline(0.0, color="#5d4037", lw=1.0)
    ax.set(xlabel="left of the way's frame [m]", ylabel="height [m]", xlim=extent[2:])
    ax.set_title("across the way, mean over its middle half: 5 to 95 % of the heights above ground")
    ax.grid(alpha=0.25)
