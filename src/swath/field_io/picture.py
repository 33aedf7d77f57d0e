"""The overview of a field folder: terrain and passes, crop, yield and what was removed."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swath.core.files.whole_file import new_file
from swath.core.number_text import num

if TYPE_CHECKING:
    from swath.field_io.folder import FieldFolder

MACHINE_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Okabe and Ito 2008: distinguished with every kind of colour vision."""
INK, LINES = "#222222", "#555555"
STYLE = {
    "axes.titlelocation": "left", "axes.titlesize": 11, "axes.labelsize": 9, "axes.spines.right": False,
    "axes.spines.top": False, "xtick.labelsize": 8, "ytick.labelsize": 8, "legend.fontsize": 8,
}  # fmt: skip


def draw(field: "FieldFolder", file: Path) -> None:
    """Draw the overview as a PNG file."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    west, south, east, north = field.terrain.bounds
    width = float(np.clip(9.0 * (east - west) / (north - south), 3.6, 8.0))
    height = float(np.clip(width * (north - south) / (east - west), 5.5, 9.0))
    name = (field.info.get("source") or {}).get("file", field.path.name)
    with matplotlib.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")  # in names of files and machines
        beside = (field.info.get("yield_histogram"), field.info.get("rows"), field.info.get("removed"))
        columns = [width, width + 0.6, *([5.4] if any(beside) else [])]  # an outline has no records
        figure = Figure(figsize=(sum(columns) + 1.6, height + 1.2), dpi=110, layout="constrained")
        canvas = FigureCanvasAgg(figure)
        grid = figure.add_gridspec(2, len(columns), width_ratios=columns)
        figure.suptitle(_short(f"{field.path.name}: {name}", 90), x=0.01, ha="left", fontsize=14)
        _draw_terrain(figure.add_subplot(grid[:, 0]), field)
        _draw_crop(figure.add_subplot(grid[:, 1]), field)
        if any(beside):
            _draw_histogram(figure.add_subplot(grid[0, 2]), field)
            _draw_removed(figure.add_subplot(grid[1, 2]), field)
        with new_file(file) as made:
            canvas.print_png(made, metadata={"Software": None})  # `savefig` draws everything twice


def _draw_terrain(axes: Any, field: "FieldFolder") -> None:
    """Relief under a low sun, exaggerated so that that of a field shows; contour lines; passes."""
    from matplotlib.colors import LightSource
    from matplotlib.lines import Line2D
    from matplotlib.ticker import MaxNLocator

    terrain = field.terrain
    west, south, east, north = terrain.bounds
    values = np.nan_to_num(terrain.values.astype(float), nan=float(np.nanmedian(terrain.values)))
    has_relief = min(values.shape) > 1 and np.ptp(values) > 0.0
    if has_relief:
        steep = np.percentile(np.hypot(*np.gradient(values, terrain.cell)), 95)
        exaggeration = 0.6 / max(float(steep), 1e-3)
        shade = LightSource(315.0, 40.0).hillshade(values, exaggeration, terrain.cell, terrain.cell)
        extent = (west, east, south, north)
        axes.imshow(shade, cmap="gray", vmin=-0.5, vmax=1.05, extent=extent, origin="lower")
        levels = MaxNLocator(8).tick_values(values.min(), values.max())
        lines = axes.contour(*terrain.centres(), values, levels=levels, colors=LINES, linewidths=0.6)
        axes.clabel(lines, fontsize=7, fmt=num)
    machines = sorted({t.machine for t in field.tracks})
    colours = {m: MACHINE_COLOURS[i % len(MACHINE_COLOURS)] for i, m in enumerate(machines)}
    for track in field.tracks:
        axes.plot(*track.line.T, color=colours[track.machine], lw=0.9, solid_capstyle="round")
    handles = [Line2D([], [], color=colours[m], lw=2, label=f"machine {_short(m)}") for m in machines]
    if has_relief:
        handles.append(Line2D([], [], color=LINES, lw=0.8, label="height above the origin [m]"))
    if handles:
        axes.legend(handles=handles, loc="upper left", framealpha=0.9)
    what = "terrain" if has_relief else "level ground"
    _finish(axes, field, f"{what} and driven passes" if field.tracks else what)


def _draw_crop(axes: Any, field: "FieldFolder") -> None:
    stems = field.stems
    west, south, east, north = stems.bounds
    low, high = np.nanpercentile(stems.values, [2, 98])
    is_even = low == high
    image = axes.imshow(
        stems.values, cmap="cividis", vmin=float(low), vmax=float(high), extent=(west, east, south, north),
        origin="lower", interpolation="nearest",
    )  # fmt: skip
    if not is_even:
        axes.figure.colorbar(image, ax=axes, extend="both", shrink=0.4, label="stems per m2")
    grams = float((field.info.get("crop") or {}).get("grain_g_per_stem") or 0.0)
    how = (
        f": {num(low)} stems per m2"
        if is_even
        else f": yield / {num(grams)} g of grain per stem"
        if grams
        else ""
    )
    _finish(axes, field, f"standing crop{how}")


def _draw_histogram(axes: Any, field: "FieldFolder") -> None:
    counts = field.info.get("yield_histogram") or {}
    kept, removed = np.array(counts.get("kept", [])), np.array(counts.get("removed", []))
    axes.set(title="yield of the records", xlabel="yield as harvested [t/ha]", ylabel="records")
    if not len(kept) or len(kept) != len(removed):
        axes.text(0.5, 0.5, "not in field.yaml", ha="center", transform=axes.transAxes)
        return
    edges = np.linspace(0.0, float(counts["top_t_ha"]), len(kept) + 1)
    axes.stairs(kept, edges, fill=True, color="#0072B2", label=f"used {num(kept.sum())}")
    more = {"fill": True, "color": "#E69F00", "label": f"not used {num(removed.sum())}"}
    axes.stairs(kept + removed, edges, baseline=kept, **more)
    axes.legend(frameon=False)


def _draw_removed(axes: Any, field: "FieldFolder") -> None:
    rows = field.info.get("rows") or {}
    reasons = {**(rows.get("broken") or {}), **(field.info.get("removed") or {})}
    shown = sorted(((n, k.replace("_", " ")) for k, n in reasons.items() if n), reverse=True)[:10][::-1]
    axes.set_title("records not used, by reason")
    if shown:
        bars = axes.barh([k for _, k in shown], [n for n, _ in shown], color="#E69F00", height=0.7)
        axes.bar_label(bars, [f" {num(n)}" for n, _ in shown], fontsize=8)
        axes.margins(x=0.15)


def _finish(axes: Any, field: "FieldFolder", title: str) -> None:
    for ring in (field.boundary, *field.holes):
        axes.plot(*np.vstack([ring, ring[:1]]).T, color=INK, lw=1.2)
    west, south, east, north = field.terrain.bounds
    axes.set(xlim=(west, east), ylim=(south, north), aspect="equal", anchor="NW", title=title)
    axes.set(xlabel="east of the origin [m]", ylabel="north of the origin [m]")


def _short(name: str, length: int = 14) -> str:
    """The end of a name, with nothing in it that starts a formula."""
    return (name if len(name) <= length else "..." + name[3 - length :]).replace("$", r"\$")
