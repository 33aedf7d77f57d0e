"""The page of a comparison of two runs: tracks over the way driven, and the tables."""

from pathlib import Path
from typing import Any

import numpy as np

from swath.replay.charts import shown_charts
from swath.replay.machines import Columns
from swath.report.html import Figure, Table, write_tables
from swath.report.plots import BLUE, ORANGE, STYLE, as_image, figure
from swath.tools.diff.compare import Comparison

STYLES = ({"color": BLUE, "lw": 1.6}, {"color": ORANGE, "lw": 1.1})


def write_diff(found: Comparison, path: Path) -> Path:
    """Write the page; returns its path."""
    machines = [name for name in found.first.tracks if name in found.second.tracks]
    figures = [figure for name in machines for figure in _figures(found, name)]
    names = [found.first.label, found.second.label]
    folders = f"{found.first.folder} · {found.second.folder}"
    verdict = ("pass", "same digest", folders) if found.is_same else ("none", "different", folders)
    differ = ["output", "from [s]", "field", *names]
    tables = [
        Table("Scenario", ["key", *names], found.settings),
        Table("Where each output first differs", differ, found.difference_rows(), (1, 3, 4)),
        Table("Metrics that differ", ["metric", *names, "difference"], found.metrics, (1, 2, 3)),
        Table("Events", ["run", "event"], found.events),
    ]
    heading = " and ".join(names)
    return write_tables(path, heading, found.headline, tables, verdict=verdict, figures=figures)


def _figures(found: Comparison, machine: str) -> list[Figure]:
    import matplotlib as mpl

    tracks = (found.first.tracks[machine], found.second.tracks[machine])
    names = (found.first.label, found.second.label)
    with mpl.rc_context(STYLE):
        way = Figure(
            f"Way of {machine}", as_image(_way(tracks, names)), "Middle of the fixed axle, seen from above."
        )
        curves = Figure(
            f"Tracks of {machine}",
            as_image(_curves(tracks, names)),
            "Over the distance driven, so that speeds may differ.",
        )
    return [way, curves]


def _way(tracks: tuple[Columns, Columns], names: tuple[str, str]) -> Any:
    fig = figure(11.0, 3.4)
    left, right = fig.subplots(1, 2)
    for own, name, style in zip(tracks, names, STYLES, strict=True):
        left.plot(own["x_m"], own["y_m"], label=name, **style)
    left.set(xlabel="east [m]", ylabel="north [m]", aspect="equal", adjustable="datalim")
    left.legend()
    way, apart = _apart(*tracks)
    right.plot(way, 100.0 * apart, color="#6B6F76")
    right.set(xlabel="driven [m]", ylabel="apart after the same distance [cm]")
    return fig


def _apart(a: Columns, b: Columns) -> tuple[np.ndarray, np.ndarray]:
    """How far apart the two are after the same way driven; way [m], distance [m]."""
    way = np.linspace(0.0, min(float(a["distance_m"].max()), float(b["distance_m"].max())), 400)
    places = [np.stack([np.interp(way, own["distance_m"], own[k]) for k in ("x_m", "y_m")]) for own in (a, b)]
    return way, np.hypot(*(places[0] - places[1]))


def _curves(tracks: tuple[Columns, Columns], names: tuple[str, str]) -> Any:
    shown = {c["title"]: c for own in tracks for c in shown_charts(own, cuts="header_end_x_m" in own)}
    rows = [(c["title"], c["unit"], curve) for c in shown.values() for curve in c["curves"]]
    rows = [row for row in rows if any(row[2]["column"] in own for own in tracks)]
    fig = figure(11.0, 1.5 * max(len(rows), 1))
    axes = fig.subplots(max(len(rows), 1), 1, sharex=True, squeeze=False)[:, 0]
    for ax, (title, unit, curve) in zip(axes, rows, strict=False):
        for own, name, style in zip(tracks, names, STYLES, strict=True):
            if (values := own.get(curve["column"])) is not None:
                ax.plot(own["distance_m"], curve["factor"] * values, label=name, **style)
        ax.set_title(f"{title}: {curve['label']}", loc="left", fontsize=9)
        ax.set_ylabel(f"[{unit}]")
    axes[0].legend(ncol=2, loc="upper right")
    axes[-1].set_xlabel("driven [m]")
    return fig
