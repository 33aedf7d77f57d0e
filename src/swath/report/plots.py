"""Figures of a run, drawn with matplotlib's Agg: no display, no global state.

Colours are those of Okabe and Ito (2008), distinguished by colour-blind readers; crop and soil are light
fills that also differ in grey.
"""

import base64
import re
from collections.abc import Mapping, Sequence
from io import BytesIO
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np

from swath.core.files.whole_file import new_file
from swath.core.number_text import num
from swath.core.process.collector import give_back
from swath.judge.evaluator import SETTLING_M
from swath.judge.evaluators.edge_detection import EdgeSeries
from swath.judge.evaluators.lateral_error import PathSeries
from swath.judge.evaluators.unloading import HeapRows, UnloadingSeries
from swath.record.charts import Columns
from swath.report.scan_sampler import KeptScan
from swath.signals import F64, Mask
from swath.signals.setup import MachineGeometry

BLUE, ORANGE, GREEN, SKY, PURPLE, GREY = "#0072B2", "#D55E00", "#009E73", "#56B4E9", "#CC79A7", "#6B6F76"
CROP, SOIL, STUBBLE, STRAW, INK, FAINT = "#E9C46A", "#F4F1EA", "#DCD5C4", "#A8813B", "#22262B", "#D9DCE1"
GRAIN = "YlOrBr"  # colours of its height
ON_LIGHT, ON_DARK = "#111417", "#FDFDFD"  # text on a coloured area, alike in both looks
DARK = {
    "#ffffff": "#1d2024",
    "#000000": "#e4e6e9",
    INK: "#e4e6e9",
    GREY: "#a9aeb5",
    FAINT: "#4a5058",
    "#9AA0A8": "#7d838b",
    "#E8EAED": "#30353b",
    "#F1F2F4": "#282c31",
    "#E6E9ED": "#343a41",
    SOIL: "#2e2b25",
    STUBBLE: "#5a543f",
    CROP: "#8c763f",
    STRAW: "#75592c",
    BLUE: "#3f9bd8",
}  # neutral colours and light fills -> what they are in the dark look
DIM = "dim"  # how the name (gid) of a picture of the field begins, which is dimmed in the dark look
FAR = 50.0  # times the errors: a limit further off is not drawn, they would be a line beside it
POINTS = 2500  # of a curve: more than a page has pixels
STYLE = {
    "font.size": 9.5,
    "text.color": INK,
    "axes.edgecolor": "#9AA0A8",
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E8EAED",
    "grid.linewidth": 0.8,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "svg.hashsalt": "swath",
}


def styled(**more: Any) -> Any:
    """The context in which figures are drawn. more: on top of `STYLE`."""
    import matplotlib

    return matplotlib.rc_context({**STYLE, **more})


def figure(width: float, height: float, *, layout: Literal["constrained"] | None = "constrained") -> Any:
    """An empty figure [inch] with the Agg canvas. layout: None = its axes lie where they were put."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    made = Figure(figsize=(width, height), layout=layout)
    FigureCanvasAgg(made)
    return made


def panels(
    height: float, rows: int = 1, columns: int = 1, *, top: float = 0.1, gap: float = 0.15, **more: Any
) -> tuple[Any, Any]:
    """A figure 11 inches wide with its axes, (rows, columns), `top` and `gap` [inch] free above and between.

    The room for labels is fixed: to measure it first, as `constrained` does, costs as much as the drawing.
    """
    fig = figure(11.0, height, layout=None)
    left, right, bottom, aside = 0.85, 0.12, 0.5, 0.15
    wide = (11.0 - left - right - (columns - 1) * aside) / columns
    high = (height - top - bottom - (rows - 1) * gap) / rows
    place = {
        "left": left / 11.0,
        "right": 1.0 - right / 11.0,
        "bottom": bottom / height,
        "top": 1.0 - top / height,
        "hspace": gap / high,
        "wspace": aside / wide,
    }
    axes = fig.subplots(rows, columns, squeeze=False, gridspec_kw=place, **more)
    for ax in axes[:, 0]:
        ax.yaxis.set_label_coords(-0.53 / wide, 0.5)
    return fig, axes


def as_image(fig: Any, *, kind: str = "svg", dpi: int = 150) -> str:
    """The figure as a data address for an <img>; it is empty afterwards.

    kind: `svg` for what is drawn, which has a light and a dark look; `webp` for pictures of a camera
    """
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    out = BytesIO()
    fig.set_dpi(dpi)  # and printed by its canvas: `savefig` draws everything twice
    if kind == "svg":
        with matplotlib.rc_context({"svg.hashsalt": "swath"}):  # the same names each time
            FigureCanvasSVG(fig).print_svg(out, metadata={"Date": None})
    else:
        from PIL import WebPImagePlugin  # noqa: F401 or Pillow loads all formats that it knows

        fig.canvas.print_webp(out, pil_kwargs={"quality": 88, "method": 2})
    fig.clear()  # its parts refer to each other: what they hold would stay
    give_back()
    made = _themed(out.getvalue().decode()).encode() if kind == "svg" else out.getvalue()
    media = "image/svg+xml" if kind == "svg" else f"image/{kind}"
    return f"data:{media};base64,{base64.b64encode(made).decode()}"


def write_picture(path: Path, fig: Any, dpi: int = 130) -> Path:
    """Write a figure as a PNG file; returns its path."""
    fig.set_dpi(dpi)
    with new_file(path) as file:
        fig.canvas.print_png(file, metadata={"Software": None})  # `savefig` draws everything twice
    return path


def _themed(svg: str) -> str:
    """The drawing with a dark look, too, for readers who ask for it."""
    numbers = {colour.lower(): f"c{i}" for i, colour in enumerate(DARK)}

    def named(found: re.Match[str]) -> str:
        name = numbers.get(found[2].lower())
        return f"{found[1]}: var(--{name})" if name else found[0]

    light, dark = ("".join(f"--c{i}:{pair[side]};" for i, pair in enumerate(DARK.items())) for side in (0, 1))
    style = (
        f"svg{{{light}}}@media screen and (prefers-color-scheme:dark){{svg{{{dark}}}"
        f'[id^="{DIM}"]{{filter:brightness(.6)}}}}'
    )
    svg = re.sub(r"\b(fill|stroke): (#[0-9a-fA-F]{6})\b", named, svg)
    return svg.replace("<defs>", f"<style>{style}</style><defs>", 1)


def evenly(values: Any) -> slice:
    """Every n-th of values, of which POINTS to twice as many are left where there are more."""
    return slice(None, None, max(1, len(values) // POINTS))


def errors_figure(path: PathSeries | None, edges: EdgeSeries | None, bands: Mapping[str, float]) -> Any:
    """Lateral and edge error over the travelled distance; times without a detection are shaded.

    bands: limits to draw, in m, under `lateral` and `edge`; a part that is None is left out
    """
    rows = (path is not None) + (edges is not None)
    fig, grid = panels(0.6 + 2.0 * rows, rows, top=0.3, gap=0.3, sharex=True)
    axes = list(grid[:, 0])
    end = 1.0
    if path is not None:
        _plot_lateral(axes[0], path, bands.get("lateral"))
        end = max([end, *path.distance[-1:].tolist()])
    if edges is not None:
        _plot_edge(axes[-1], edges, bands.get("edge"))
        end = max([end, *edges.distance[-1:].tolist()])
    axes[-1].set_xlabel("travelled distance [m]")
    axes[-1].set_xlim(0.0, end)
    return fig


def _plot_lateral(ax: Any, series: PathSeries, band: float | None) -> None:
    thin = evenly(series.t)
    ax.plot(series.distance[thin], 100 * series.lateral[thin], color=BLUE, lw=1.3)
    _limits(ax, 100 * series.lateral[series.distance >= SETTLING_M], None if band is None else 100 * band)
    ax.axvspan(0, SETTLING_M, color="#F1F2F4", lw=0)
    shown = min([SETTLING_M, *series.distance[-1:].tolist()])
    ax.text(shown, 0.97, "settling ", transform=ax.get_xaxis_transform(), ha="right", va="top",
            color=GREY, fontsize=9).set_in_layout(False)  # fmt: skip
    ax.set_ylabel("header end\nlateral error [cm]")
    ax.set_title("> 0: towards the standing crop", loc="right", fontsize=9, color=GREY, y=1.0)


def _plot_edge(ax: Any, series: EdgeSeries, band: float | None) -> None:
    ax.axvspan(0, SETTLING_M, color="#F1F2F4", lw=0)
    _shade(ax, series.distance, series.exists & ~series.found, ORANGE, "true edge not detected", "////")
    _shade(ax, series.distance, series.is_none, PURPLE, "detected where none is", "\\\\")
    _shade(ax, series.distance, ~series.exists, GREY, "no true edge near", "")
    thin = evenly(series.t)
    ax.plot(series.distance[thin], 100 * series.error[thin], "o", color=GREEN, ms=2.0, mec="none")
    _limits(ax, 100 * series.settled(SETTLING_M).error, None if band is None else 100 * band)
    ax.set_ylabel("detected edge\nerror [cm]")
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1, ncol=3)


def _limits(ax: Any, values: F64, band: float | None) -> None:
    ax.axhline(0, color="#9AA0A8", lw=0.8)
    values = values[np.isfinite(values)]
    reach = max(float(np.percentile(np.abs(values), 99.5)) if len(values) else 0.0, 1.0)
    if band is not None and band < FAR * reach:
        for sign in (-1, 1):
            ax.axhline(sign * band, color=INK, lw=0.8, ls=(0, (4, 3)))
        reach = max(reach, band)
    reach *= 1.25
    ax.set_ylim(-reach, reach)


def _shade(ax: Any, at: F64, where: Mask, colour: str, label: str, hatch: str) -> None:
    """Shade the stretches of `at` on which `where` holds."""
    change = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(int), [0]])))
    shown = False
    for first, after in zip(change[::2], change[1::2], strict=True):
        end = at[min(after, len(at) - 1)]
        if end > at[first]:
            ax.axvspan(at[first], end, fc=colour, alpha=0.22, lw=0, hatch=hatch, ec=colour,
                       label=None if shown else label)  # fmt: skip
            shown = True


def curves_figure(runs: Mapping[str, Columns], charts: Sequence[Mapping[str, Any]]) -> Any:
    """Charts of tracks over the distance driven, one below the other.

    Parameters
    ----------
    runs : columns of a machine by run; of several runs each curve has a panel of its own.
    charts : from `record.charts.shown_charts`.
    """
    named = len(runs) > 1
    rows = [
        (c, curves) for c in charts for curves in ([[x] for x in c["curves"]] if named else [c["curves"]])
    ]
    fig, grid = panels(1.35 * len(rows) + 0.6, len(rows), top=0.3, gap=0.32, sharex=True)
    for ax, (chart, curves) in zip(grid[:, 0], rows, strict=True):
        draw_chart(ax, "distance_m", runs, {**chart, "curves": curves}, legend=named and ax is grid[0, 0])
    grid[-1, 0].set_xlabel("distance driven [m]")
    return fig


def draw_chart(
    ax: Any, over: str, runs: Mapping[str, Columns], chart: Mapping[str, Any], *, legend: bool = False
) -> None:
    """A chart of tracks into axes. over: the column that is drawn to the right; runs: by name, "" of one."""
    curves, looks = chart["curves"], zip((BLUE, ORANGE, GREEN), (1.5, 1.1, 1.1), strict=True)
    for (run, own), curve in product(runs.items(), curves):
        values, (colour, thick) = own.get(curve["column"]), next(looks)
        if values is not None:
            thin = evenly(values)
            x, y = own[over][thin], curve["factor"] * values[thin]
            ax.plot(x, y, color=colour, lw=thick, label=run or curve["label"])
    title = chart["title"] if len(curves) > 1 else f"{chart['title']}: {curves[0]['label']}"
    ax.set_title(title, loc="left", fontsize=9.5)
    ax.set_ylabel(f"[{chart['unit']}]")
    if len(curves) > 1 or legend:
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1, ncol=3)


def scans_figure(scans: Sequence[KeptScan], geometry: MachineGeometry, side: str) -> Any:
    """Scans in the lateral/height plane of the machine, with the true and the detected edge."""
    rows = (len(scans) + 1) // 2
    fig, grid = panels(2.4 * rows + 0.5, rows, 2, top=0.55, gap=0.35, sharex=True, sharey=True)
    axes = grid.ravel()
    for ax, scan in zip(axes, scans, strict=False):
        plot_scan(ax, scan, geometry, side)
    for ax in axes[len(scans) :]:
        ax.set_axis_off()
    handles, labels = axes[0].get_legend_handles_labels()
    if handles:
        fig.legend(handles, labels, loc="upper left", ncol=4, borderaxespad=0.2)
    return fig


def plot_scan(ax: Any, scan: KeptScan, geometry: MachineGeometry, side: str) -> None:
    """One scan seen from behind the machine: echoes, true and detected edge, header end."""
    centre = geometry.header_end(side)[1]
    y, z = scan.points[:, 1], scan.points[:, 2]
    near = np.abs(y - centre) < 6.0
    ax.axhline(0, color="#9AA0A8", lw=0.8)
    ax.plot(y[near], z[near], "o", color=BLUE, ms=2.4, mec="none", alpha=0.8, label="echoes")
    if np.isfinite(scan.edge_true):
        ax.axvline(scan.edge_true, color=INK, lw=1.2, ls=(0, (5, 3)), label="true edge")
    if scan.edge is not None and scan.edge.is_found:
        ax.axvline(scan.edge.offset, color=ORANGE, lw=1.4, label="detected edge")
    ax.axvline(centre, color=GREY, lw=1.0, ls=":", label="header end")
    ax.set_title(f"{num(scan.distance)} m, {_difference(scan)}", loc="left", fontsize=9.5, color=INK, y=1.0)
    top = max(1.6, float(np.percentile(z[near], 98.0)) + 0.2) if near.any() else 1.6
    if not ax.get_autoscaley_on():  # shared with a scan drawn before
        top = max(top, ax.get_ylim()[1])
    ax.set(xlim=(centre + 5.5, centre - 5.5), ylim=(-0.3, top))
    if ax.get_subplotspec().is_first_col():
        ax.set_ylabel("height [m]")
    if ax.get_subplotspec().is_last_row():
        ax.set_xlabel("left of the machine's axis [m]")


def _difference(scan: KeptScan) -> str:
    if scan.edge is None:
        return "no edge detection"
    if not scan.edge.is_found:
        return "no edge detected"
    if not np.isfinite(scan.edge_true):
        return "there is no true edge"
    return f"detected {num(abs(scan.edge.offset - scan.edge_true), 'm')} from the true edge"


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
        heap.t, place, heap.profile.T, cmap=GRAIN, vmin=0.0, vmax=top, shading="nearest", rasterized=True
    )
    if np.nanmax(heap.profile) > heap.depth:
        ax.contour(heap.t, place, heap.profile.T, levels=[heap.depth], colors=INK, linewidths=0.9)
    inset = ax.inset_axes((0.78, 1.05, 0.22, 0.07))
    bar = fig.colorbar(mesh, cax=inset, orientation="horizontal")
    bar.ax.xaxis.set_ticks_position("top")
    bar.ax.tick_params(labelsize=9, pad=1, length=2)
    said = f"grain above the floor [m]; black line: the rim, {num(heap.depth)} m"
    ax.set_title(said, loc="left", fontsize=9, color=GREY, y=1.0)
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
    """Level of the box; shaded where grain flows. missed: the box in all [kg]."""
    ax.fill_between(
        heap.t, 0.0, 1.0, where=heap.flow > 0.0, transform=ax.get_xaxis_transform(), color="#E6E9ED", lw=0,
        step="post", label="grain flows",
    )  # fmt: skip
    ax.plot(heap.t, 100.0 * heap.level, color=GREEN, lw=1.4, label="fill, of the largest heap")
    ax.set_ylabel("fill [%]")
    ax.set_ylim(0.0, 105.0)
    ax.set_title(f"missed the box in all: {num(missed)} kg", loc="right", fontsize=9, color=GREY, y=1.0)
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=2, borderaxespad=0.1)
