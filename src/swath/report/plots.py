"""Figures of a run, drawn with matplotlib's Agg: no display, no global state.

Colours are those of Okabe and Ito (2008), told apart by colour-blind readers; crop and soil are light fills
that also differ in grey.
"""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.judge.evaluators.edge_detection import EdgeSeries
from swath.judge.evaluators.lateral_error import PathSeries
from swath.report.scan_sampler import FieldMap, KeptScan
from swath.signals import F64
from swath.signals.setup import MachineGeometry

BLUE, ORANGE, GREEN, SKY, PURPLE, GREY = "#0072B2", "#D55E00", "#009E73", "#56B4E9", "#CC79A7", "#6B6F76"
CROP, SOIL, STUBBLE, STRAW, INK, FAINT = "#E9C46A", "#F4F1EA", "#DCD5C4", "#A8813B", "#22262B", "#D9DCE1"
STYLE = {
    "font.size": 9.5,
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


def figure(width: float, height: float) -> Any:
    """An empty figure [inch] with the Agg canvas."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    made = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(made)
    return made


def as_image(fig: Any, *, kind: str = "svg", dpi: int = 150) -> str:
    """The figure as a data address for an <img>.

    kind: `svg` for lines, `png` for areas, `webp` for pictures of many small parts
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    out = BytesIO()
    fig.set_dpi(dpi)  # and printed by its canvas: `savefig` draws everything twice
    if kind == "svg":
        FigureCanvasSVG(fig).print_svg(out, metadata={"Date": None})
    elif kind == "png":
        fig.canvas.print_png(out, metadata={"Software": None}, pil_kwargs={"compress_level": 3})
    else:
        fig.canvas.print_webp(out, pil_kwargs={"quality": 88, "method": 2})
    media = "image/svg+xml" if kind == "svg" else f"image/{kind}"
    return f"data:{media};base64,{base64.b64encode(out.getvalue()).decode()}"


@dataclass(frozen=True)
class MapTrack:
    """A machine's way on the map; world points [m], shape (n, 2).

    header_ends: left and right path; axle: of the fixed axle's centre; outline: of the machine at the end
    side: `left` or `right`, the header end that follows the edge; has_header: it cuts
    """

    name: str
    header_ends: tuple[F64, F64]
    axle: F64
    outline: F64 | None = None
    side: str = "left"
    has_header: bool = True


def map_figure(
    picture: FieldMap,
    tracks: Sequence[MapTrack],
    *,
    edges: Sequence[F64] = (),
    obstacles: Sequence[tuple[float, float, float]] = (),
    driven: F64 | None = None,
    places: Sequence[tuple[float, float, str]] = (),
) -> Any:
    """Field map with the tracks of all machines.

    edges: initial edges, (k, 2); obstacles: x, y, radius; driven: a track driven in reality, (m, 2)
    places: x, y and kind of what happened; all world [m]
    """
    left, right, bottom, top = picture.extent
    height = float(np.clip(11.0 * (top - bottom) / (right - left), 2.0, 9.0))
    fig = figure(11.0, height + 0.75)
    ax = fig.add_subplot()
    ax.grid(False)
    ax.set_facecolor(SOIL)
    ax.imshow(_layer(picture.standing, CROP, 0.92), extent=picture.extent, origin="lower", zorder=2)
    if picture.straw is not None and (picture.straw > 0.01).any():
        depth = np.clip(picture.straw / max(float(picture.straw.max()), 1e-6), 0, 1)
        ax.imshow(_layer(depth, STRAW, 0.75), extent=picture.extent, origin="lower", zorder=3)
    ax.set_autoscale_on(False)
    for index, edge in enumerate(edges):
        label = None if index else "initial edge"
        ax.plot(*picture.place(edge).T, color=INK, ls=(0, (5, 3)), label=label, lw=1.4, zorder=5)
    for index, track in enumerate(tracks):
        _draw_track(ax, picture, track, index, named=len(tracks) > 1)
    if driven is not None:
        ax.plot(*picture.place(driven).T, color=PURPLE, ls=":", lw=2.0, zorder=6, label="driven in reality")
    for x, y, radius in obstacles:
        u, v = picture.place([x, y])
        ax.add_patch(_circle(u, v, max(radius, 0.35)))
    for kind in dict.fromkeys(kind for _, _, kind in places):
        at = picture.place([(x, y) for x, y, own in places if own == kind])
        ax.plot(*at.T, "X", ms=9, mfc="white", mec=INK, zorder=9, label=kind)
    ax.set(xlim=(left, right), ylim=(bottom, top), xlabel="along the run [m]", aspect="equal")
    ax.set_ylabel("across [m]")
    _north(ax, picture.turn)
    _map_legend(ax, picture, has_obstacles=len(obstacles) > 0)
    return fig


def _draw_track(ax: Any, picture: FieldMap, track: MapTrack, index: int, *, named: bool) -> None:
    """What a machine cut, the header end that follows the edge, the axle, and the machine at the end."""
    line = {"lw": 1.4, "zorder": 5}
    axle = (BLUE, GREEN, PURPLE, SKY)[index % 4]
    if track.has_header:
        left, right = (picture.place(end) for end in track.header_ends)
        swath = np.concatenate([left, right[::-1]])
        ax.fill(swath[:, 0], swath[:, 1], color=STUBBLE, lw=0, label=None if index else "cut in this run")
        follows = f"header end ({track.side})" if not named else None if index else "header end"
        ax.plot(*(left if track.side == "left" else right).T, color=ORANGE, label=follows, **line)
    label = track.name if named else "machine (fixed axle)"
    ax.plot(*picture.place(track.axle).T, color=axle, label=label, **line)
    if track.outline is not None:
        outline = picture.place(track.outline)
        ax.fill(*outline.T, fc="white", ec=INK, lw=0.9, alpha=0.9, zorder=7)
        if named:
            ax.text(*outline.mean(axis=0), track.name, ha="center", va="center", fontsize=8, zorder=8)


def _layer(share: NDArray[Any], colour: str, alpha: float) -> NDArray[np.uint8]:
    """An image of one colour that covers as much as the share [0, 1] says, (h, w, 4)."""
    from matplotlib.colors import to_rgb

    rgba = np.empty((*share.shape, 4), np.uint8)
    rgba[..., :3] = np.rint(255.0 * np.array(to_rgb(colour)))
    rgba[..., 3] = np.rint(255.0 * alpha * share)
    return rgba


def _circle(x: float, y: float, radius: float) -> Any:
    from matplotlib.patches import Circle

    return Circle((x, y), radius, fc=GREY, ec=INK, lw=0.8, zorder=8)


def _north(ax: Any, turn: float) -> None:
    """An arrow to the north in the upper right corner."""
    up = np.array([np.sin(turn), np.cos(turn)])
    ax.annotate(
        "N",
        xy=(0.975, 0.90),
        xycoords="axes fraction",
        xytext=tuple(-26 * up),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=9,
        color=INK,
        zorder=9,
        arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.2, "shrinkA": 5, "shrinkB": 0},
        bbox={"boxstyle": "circle,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.85},
    )


def _map_legend(ax: Any, picture: FieldMap, *, has_obstacles: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles, _ = ax.get_legend_handles_labels()
    handles.insert(0, Patch(fc=CROP, label="standing crop"))
    if picture.straw is not None and (picture.straw > 0.01).any():
        handles.insert(1, Patch(fc=STRAW, alpha=0.75, label="straw"))
    if has_obstacles:
        handles.append(Line2D([], [], marker="o", ls="", mfc=GREY, mec=INK, label="obstacle"))
    ax.legend(handles=handles, ncol=len(handles), loc="lower left", bbox_to_anchor=(0.0, 1.0),
              handlelength=1.6, columnspacing=1.3, borderaxespad=0.2)  # fmt: skip


def errors_figure(
    path: PathSeries | None,
    edges: EdgeSeries | None,
    *,
    settling: float,
    bands: dict[str, float] | None = None,
) -> Any:
    """Lateral and edge error over the travelled distance; times without a detection are shaded.

    bands: limits to draw, in m, under `lateral` and `edge`; a part that is None is left out
    """
    rows = (path is not None) + (edges is not None)
    fig = figure(11.0, 0.6 + 2.0 * rows)
    axes = list(fig.subplots(rows, 1, sharex=True, squeeze=False)[:, 0])
    end = 1.0
    if path is not None:
        _plot_lateral(axes[0], path, settling, (bands or {}).get("lateral"))
        end = max([end, *path.distance[-1:].tolist()])
    if edges is not None:
        _plot_edge(axes[-1], edges, (bands or {}).get("edge"))
        end = max([end, *edges.distance[-1:].tolist()])
    axes[-1].set_xlabel("travelled distance [m]")
    axes[-1].set_xlim(0.0, end)
    return fig


def _plot_lateral(ax: Any, series: PathSeries, settling: float, band: float | None) -> None:
    thin = slice(None, None, max(1, len(series.t) // 2500))
    ax.plot(series.distance[thin], 100 * series.lateral[thin], color=BLUE, lw=1.3)
    _limits(ax, 100 * series.lateral[series.distance >= settling], None if band is None else 100 * band)
    ax.axvspan(0, settling, color="#F1F2F4", lw=0)
    shown = min(settling, float(series.distance[-1])) if len(series.distance) else settling
    ax.text(shown, 0.97, "settling ", transform=ax.get_xaxis_transform(), ha="right", va="top",
            color=GREY, fontsize=8.5).set_in_layout(False)  # fmt: skip
    ax.set_ylabel("header end\nlateral error [cm]")
    ax.set_title("> 0: towards the standing crop", loc="right", fontsize=8.5, color=GREY)


def _plot_edge(ax: Any, series: EdgeSeries, band: float | None) -> None:
    is_false = series.found & ~np.isfinite(series.error)
    _shade(ax, series.distance, series.exists & ~series.found, ORANGE, "true edge not detected", "////")
    _shade(ax, series.distance, is_false, PURPLE, "detected where none is", "\\\\")
    _shade(ax, series.distance, ~series.exists, GREY, "no true edge near", "")
    ax.plot(series.distance, 100 * series.error, "o", color=GREEN, ms=2.0, mec="none")
    _limits(ax, 100 * series.error, None if band is None else 100 * band)
    ax.set_ylabel("detected edge\nerror [cm]")
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="upper right", ncol=3)


def _limits(ax: Any, values: F64, band: float | None) -> None:
    ax.axhline(0, color="#9AA0A8", lw=0.8)
    values = values[np.isfinite(values)]
    reach = float(np.percentile(np.abs(values), 99.5)) if len(values) else 0.0
    if band is not None:
        for sign in (-1, 1):
            ax.axhline(sign * band, color=INK, lw=0.8, ls=(0, (4, 3)))
    reach = 1.25 * max(reach, band or 0.0, 1.0)
    ax.set_ylim(-reach, reach)


def _shade(ax: Any, at: F64, where: NDArray[np.bool_], colour: str, label: str, hatch: str) -> None:
    """Shade the stretches of `at` on which `where` holds."""
    change = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(int), [0]])))
    shown = False
    for first, after in zip(change[::2], change[1::2], strict=True):
        end = at[min(after, len(at) - 1)]
        if end > at[first]:
            ax.axvspan(at[first], end, fc=colour, alpha=0.22, lw=0, hatch=hatch, ec=colour,
                       label=None if shown else label)  # fmt: skip
            shown = True


def drive_figure(tracks: dict[str, Any]) -> Any:
    """Speed, steering and header use over the travelled distance, from the columns of the tracks."""
    fig = figure(11.0, 3.6)
    axes = fig.subplots(3, 1, sharex=True)
    at = tracks["distance_m"]
    axes[0].plot(at, 3.6 * tracks["speed_m_s"], color=BLUE, lw=1.3, label="true")
    axes[0].plot(at, 3.6 * tracks["odometry_speed_m_s"], color=SKY, lw=0.8, label="measured")
    axes[0].set_ylabel("speed\n[km/h]")
    axes[0].set_ylim(bottom=0)
    axes[0].legend(loc="lower right", ncol=2)
    axes[1].plot(at, np.degrees(tracks["steer_rad"]), color=ORANGE, lw=1.2)
    axes[1].set_ylabel("steered axle\n[deg], > 0 left")
    axes[2].plot(at, 100 * _over_a_metre(at, tracks["header_fill"]), color=GREEN, lw=1.2)
    axes[2].set_ylabel("header use\n[%]")
    axes[2].set_ylim(0, 108)
    axes[2].set_xlabel("travelled distance [m]")
    axes[2].set_xlim(0, max(float(np.nanmax(at)) if len(at) else 1.0, 1.0))
    fig.align_ylabels(axes)
    return fig


def process_figure(tracks: dict[str, Any]) -> Any:
    """Feed, losses, engine load and speed over the travelled distance, from the columns of the tracks."""
    fig = figure(11.0, 5.4)
    axes = fig.subplots(4, 1, sharex=True)
    at = tracks["distance_m"]
    shown = (
        (tracks["feeder_flow_kg_s"], GREEN, "into the feeder\n[kg/s]"),
        (100 * tracks["loss_share"], ORANGE, "grain lost\n[%]"),
        (100 * tracks["engine_load"], BLUE, "engine load\n[%]"),
        (30 / np.pi * tracks["engine_speed_rad_s"], PURPLE, "engine speed\n[1/min]"),
    )
    for ax, (values, colour, label) in zip(axes, shown, strict=True):
        ax.plot(at, values, color=colour, lw=1.2)
        ax.set_ylabel(label)
    for ax in axes[:3]:
        ax.set_ylim(bottom=0)
    axes[2].axhline(100, color=INK, lw=0.8, ls=(0, (4, 3)))
    axes[3].set_xlabel("travelled distance [m]")
    axes[3].set_xlim(0, max(float(np.nanmax(at)) if len(at) else 1.0, 1.0))
    fig.align_ylabels(axes)
    return fig


def _over_a_metre(at: F64, values: F64) -> F64:
    """Mean over the last metre: what the header takes in one step scatters with the cut cells."""
    known = np.nan_to_num(values)
    sums = np.concatenate([[0.0], np.cumsum(known)])
    first = np.searchsorted(at, at - 1.0)
    last = np.arange(1, len(at) + 1)
    return np.asarray((sums[last] - sums[first]) / (last - first))


def scans_figure(scans: Sequence[KeptScan], geometry: MachineGeometry, side: str) -> Any:
    """Scans in the lateral/height plane of the machine, with the true and the detected edge."""
    rows = (len(scans) + 1) // 2
    fig = figure(11.0, 2.5 * rows + 0.3)
    axes = fig.subplots(rows, 2, sharex=True, sharey=True, squeeze=False).ravel()
    for ax, scan in zip(axes, scans, strict=False):
        plot_scan(ax, scan, geometry, side)
    for ax in axes[len(scans) :]:
        ax.set_axis_off()
    handles, labels = axes[0].get_legend_handles_labels()
    if handles:
        fig.legend(handles, labels, loc="outside upper left", ncol=4)
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
    ax.set_title(f"{scan.distance:.1f} m, {_difference(scan)}", loc="left", fontsize=9.5, color=INK)
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
    return f"detected {100 * abs(scan.edge.offset - scan.edge_true):.1f} cm from the true edge"
