"""What a notebook shows of a run, a scan and a field: tables and pictures as HTML."""

import base64
import html
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swath.terminal.outcome import result_of
from swath.terminal.tables import number


def picture(png: bytes) -> str:
    """A PNG as an element."""
    return f'<img style="max-width:100%" src="data:image/png;base64,{base64.b64encode(png).decode()}"/>'


def run_html(title: str, summary: Mapping[str, Any], folder: Path) -> str:
    """Limits and metrics of a run, and how it steered."""
    rows = [(e["name"], number(e["value"]), result_of(e)) for e in summary.get("expect", [])]
    named = {name for name, _, _ in rows}
    plain = {k: v for k, v in summary.items() if isinstance(v, int | float) and not isinstance(v, bool)}
    rows += [(k, number(v), "") for k, v in plain.items() if k not in named]
    cells = "".join(
        "<tr>" + "".join(f"<td>{html.escape(str(c))}</td>" for c in row) + "</tr>" for row in rows
    )
    tracks = folder / "tracks.parquet"
    drawn = picture(_steering(tracks)) if tracks.is_file() else ""
    table = f"<details><summary>metrics</summary><table>{cells}</table></details>"
    return f"<b>{html.escape(title)}</b>{drawn}{table}"


def _steering(tracks: Path) -> bytes:
    """Lateral error and speed by distance, of the machines in a tracks.parquet."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from swath.record.tracks import read_tracks

    columns = read_tracks(tracks)
    figure = Figure(figsize=(8, 3), dpi=90, layout="constrained")
    FigureCanvasAgg(figure)
    upper, lower = figure.subplots(2, 1, sharex=True)
    for name in dict.fromkeys(columns["machine"].tolist()):
        own = columns["machine"] == name
        at = columns["distance_m"][own]
        upper.plot(at, 100.0 * columns["lateral_error_m"][own], label=name)
        lower.plot(at, 3.6 * columns["speed_m_s"][own])
    upper.set(ylabel="lateral error [cm]")
    upper.legend(frameon=False, fontsize=8)
    lower.set(xlabel="driven [m]", ylabel="speed [km/h]")
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return file.getvalue()
