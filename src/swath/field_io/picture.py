"""The overview of a field folder: terrain and passes, crop, yield and what was removed."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swath.field.raster import Raster

if TYPE_CHECKING:
    from swath.field_io.folder import FieldFolder

MACHINE_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Okabe and Ito 2008: told apart with every kind of colour vision."""
INK, FAINT = "#222222", "#777777"
SUN_AZIMUTH, SUN_HEIGHT = np.radians(315.0), np.radians(40.0)


def draw(field: "FieldFolder", file: Path) -> None:
    """Draw the overview as a PNG file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    west, south, east, north = field.terrain.bounds
    map_width = float(np.clip(9.0 * (east - west) / (north - south), 3.6, 8.0))
    map_height = float(np.clip(map_width * (north - south) / (east - west), 5.5, 9.0))
    figure = Figure(
        figsize=(2 * map_width + 7.6, map_height + 1.2), dpi=110, facecolor="white", layout="constrained"
    )
    FigureCanvasAgg(figure)
    widths = [map_width, map_width, 0.22, 5.4]
    grid = figure.add_gridspec(3, 4, width_ratios=widths, height_ratios=[1.0, 1.0, 1.15])
    name = field.info.get("source", {}).get("file", field.path.name)
    figure.suptitle(
        _short(f"{field.path.name}: {name}", 90), x=0.01, ha="left", fontsize=14, color=INK, weight="bold"
    )
    _draw_terrain(figure.add_subplot(grid[:, 0]), field)
    _draw_crop(figure.add_subplot(grid[:, 1]), figure.add_subplot(grid[1, 2]), field)
    _draw_histogram(figure.add_subplot(grid[0, 3]), field)
    _draw_removed(figure.add_subplot(grid[1, 3]), field)
    _draw_facts(figure.add_subplot(grid[2, 3]), field)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")  # in names of files and machines
        figure.savefig(file, format="png", metadata={"Software": None})


def _draw_terrain(axes: Any, field: "FieldFolder") -> None:
    from matplotlib.lines import Line2D

    terrain = field.terrain
    west, south, east, north = terrain.bounds
    axes.imshow(
        _shade(terrain), cmap="gray", vmin=0, vmax=1.05, extent=(west, east, south, north), origin="lower"
    )
    x, y = terrain.centres()
    low, high = float(np.nanmin(terrain.values)), float(np.nanmax(terrain.values))
    step = _round_step((high - low) / 8.0)
    levels = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step
    if len(levels) and min(terrain.values.shape) > 1 and high > low:
        lines = axes.contour(x, y, terrain.values, levels=levels, colors="#555555", linewidths=0.6, alpha=0.8)
        axes.clabel(lines, fontsize=7, fmt=lambda v: f"{v:g}")
    machines = sorted({t.machine for t in field.tracks})
    colours = {m: MACHINE_COLOURS[i % len(MACHINE_COLOURS)] for i, m in enumerate(machines)}
    for track in field.tracks:
        axes.plot(*track.line.T, color=colours[track.machine], lw=0.9, solid_capstyle="round")
    handles = [Line2D([], [], color=colours[m], lw=2, label=f"machine {_short(m)}") for m in machines]
    handles.append(Line2D([], [], color="#555555", lw=0.8, label=f"height, every {step:g} m"))
    _finish(axes, field, "terrain and driven passes")
    axes.legend(handles=handles, loc="upper left", fontsize=8, framealpha=0.9)
    _scale_bar(axes, east - west)


def _draw_crop(axes: Any, bar_axes: Any, field: "FieldFolder") -> None:
    stems = field.stems
    west, south, east, north = stems.bounds
    low, high = np.nanpercentile(stems.values, [2, 98])
    image = axes.imshow(
        stems.values, cmap="cividis", vmin=float(low), vmax=float(high), extent=(west, east, south, north),
        origin="lower", interpolation="nearest",
    )  # fmt: skip
    bar = axes.figure.colorbar(image, cax=bar_axes, extend="both")
    bar.set_label("stems per m2", color=INK)
    grams = float(field.info.get("crop", {}).get("grain_g_per_stem") or 0.0)
    _finish(axes, field, "standing crop" + (f": yield / {grams:g} g of grain per stem" if grams else ""))
    _scale_bar(axes, east - west)


def _draw_histogram(axes: Any, field: "FieldFolder") -> None:
    counts = field.info.get("yield_histogram") or {}
    kept, removed = np.array(counts.get("kept", [])), np.array(counts.get("removed", []))
    axes.set_title("yield of the records", loc="left", fontsize=11, color=INK)
    if not len(kept) or len(kept) != len(removed):
        axes.text(0.5, 0.5, "not in field.yaml", ha="center", transform=axes.transAxes, color=FAINT)
        return
    edges = np.linspace(0.0, float(counts["top_t_ha"]), len(kept) + 1)
    axes.stairs(kept, edges, fill=True, color="#0072B2", label=f"used {kept.sum():,}")
    axes.stairs(
        kept + removed, edges, baseline=kept, fill=True, color="#E69F00", label=f"not used {removed.sum():,}"
    )
    axes.set_xlabel("yield as harvested [t/ha]", fontsize=9)
    axes.set_ylabel("records", fontsize=9)
    axes.legend(fontsize=9, frameon=False)
    _light(axes)


def _draw_removed(axes: Any, field: "FieldFolder") -> None:
    reasons = {**(field.info.get("rows", {}).get("broken") or {}), **(field.info.get("removed") or {})}
    shown = sorted(((n, k.replace("_", " ")) for k, n in reasons.items() if n), reverse=True)[:10][::-1]
    axes.set_title("records not used, by reason", loc="left", fontsize=11, color=INK)
    if shown:
        bars = axes.barh([k for _, k in shown], [n for n, _ in shown], color="#E69F00", height=0.7)
        axes.bar_label(bars, [f" {n:,}" for n, _ in shown], fontsize=8, color=INK)
        axes.margins(x=0.15)
    axes.tick_params(labelsize=8)
    _light(axes)


def _draw_facts(axes: Any, field: "FieldFolder") -> None:
    info = field.info
    lines = []
    area, crop, terrain = info.get("field", {}), info.get("crop", {}), info.get("terrain", {})
    if area:
        spacing = area.get("pass_spacing_m")
        lines += [f"{area['area_ha']:.2f} ha, {area['passes']} passes, {area['pass_length_m'] / 1000:.1f} km"]
        lines += [f"passes {spacing:.2f} m apart" if spacing else "no parallel passes"]
        lines += [f"rows {area['row_azimuth_deg']:.1f} deg from north"]
    if crop:
        low, high = crop["yield_p10_t_ha"], crop["yield_p90_t_ha"]
        lines += [f"yield {crop['yield_t_ha']:.2f} t/ha, {low:.2f}-{high:.2f} (10-90 %)"]
        lines += [f"{crop['stems_per_m2']:.0f} stems/m2 on the mean"]
    if terrain:
        lines += [f"relief {terrain['relief_m']:.1f} m", "  " + _short(terrain["source"], 60)]
    for machine in info.get("machines", [])[:6]:
        delay = f"flow delay {machine['flow_delay_s']:+.1f} s"
        lines += [f"machine {_short(machine['name'])}: {delay}, {machine['kept']:,} used"]
    lines += [f"EPSG:{field.origin.epsg}, origin {field.origin.easting:.0f} E {field.origin.northing:.0f} N"]
    axes.axis("off")
    axes.text(
        0.0,
        0.98,
        "\n".join(lines),
        va="top",
        ha="left",
        fontsize=9.5,
        color=INK,
        linespacing=1.55,
        transform=axes.transAxes,
    )


def _shade(terrain: Raster) -> Any:
    """Brightness of a slope under a low sun, exaggerated so that the relief of a field shows."""
    values = np.nan_to_num(terrain.values.astype(float), nan=float(np.nanmedian(terrain.values)))
    if min(values.shape) < 2:
        return np.full(values.shape, 0.8)
    gy, gx = np.gradient(values, terrain.cell)
    steep = float(np.percentile(np.hypot(gx, gy), 95))
    gain = 0.6 / max(steep, 1e-3)
    nx, ny, nz = -gain * gx, -gain * gy, 1.0
    sun = np.array(
        [
            np.sin(SUN_AZIMUTH) * np.cos(SUN_HEIGHT),
            np.cos(SUN_AZIMUTH) * np.cos(SUN_HEIGHT),
            np.sin(SUN_HEIGHT),
        ]
    )
    light = (nx * sun[0] + ny * sun[1] + nz * sun[2]) / np.sqrt(nx**2 + ny**2 + nz**2)
    return 0.35 + 0.65 * np.clip(light, 0.0, 1.0)


def _finish(axes: Any, field: "FieldFolder", title: str) -> None:
    for ring in (field.boundary, *field.holes):
        axes.plot(*np.vstack([ring, ring[:1]]).T, color=INK, lw=1.2)
    west, south, east, north = field.terrain.bounds
    axes.set(xlim=(west, east), ylim=(south, north), aspect="equal", anchor="NW")
    axes.set_title(title, loc="left", fontsize=11, color=INK)
    axes.set_xlabel("east of the origin [m]", fontsize=9)
    axes.set_ylabel("north of the origin [m]", fontsize=9)
    _light(axes)


def _scale_bar(axes: Any, width: float) -> None:
    length = _round_step(width / 5.0)
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    x, y = x1 - 0.06 * (x1 - x0) - length, y0 + 0.03 * (y1 - y0)
    box = {"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 2}
    axes.text(
        x + length / 2,
        y + 0.008 * (y1 - y0),
        f"{length:g} m",
        ha="center",
        va="bottom",
        fontsize=9,
        color=INK,
        bbox=box,
    )
    axes.plot([x, x + length], [y, y], color=INK, lw=3, solid_capstyle="butt")


def _light(axes: Any) -> None:
    axes.tick_params(labelsize=8, colors=INK, length=3)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _round_step(value: float) -> float:
    """The nearest of 1, 2, 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(max(value, 1e-6)))
    return float(
        min((power, 2 * power, 5 * power, 10 * power), key=lambda v: abs(np.log(v / max(value, 1e-6))))
    )


def _short(name: str, length: int = 14) -> str:
    """The end of a name, with nothing in it that starts a formula."""
    return (name if len(name) <= length else "..." + name[3 - length :]).replace("$", r"\$")
