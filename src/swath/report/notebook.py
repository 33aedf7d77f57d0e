"""What a notebook shows of a run, a scan and a field: tables and pictures as HTML."""

import base64
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swath.core.number_text import num
from swath.report.html import Html, element, joined
from swath.terminal.outcome import limit_text, result_of

SHOWN = ("Edge", "Speed")  # charts, the first curve of each


def picture(png: bytes) -> Html:
    """A PNG as an element."""
    return _image(f"data:image/png;base64,{base64.b64encode(png).decode()}")


def _image(address: str) -> Html:
    return Html(f'<img style="max-width:100%" src="{address}"/>')


def run_html(title: str, summary: Mapping[str, Any], folder: Path) -> Html:
    """Limits and metrics of a run, and how it steered."""
    rows = [(e["name"], num(e["value"]), limit_text(e), result_of(e)) for e in summary.get("expect", [])]
    named = {row[0] for row in rows}
    plain = {k: v for k, v in summary.items() if isinstance(v, int | float) and not isinstance(v, bool)}
    rows += [(k, num(v), "", "") for k, v in plain.items() if k not in named]
    lines = [element("tr", joined([element("td", text) for text in row], "")) for row in rows]
    table = joined((element("summary", "metrics"), element("table", joined(lines, ""))), "")
    tracks = folder / "tracks.parquet"
    drawn = _steering(tracks) if os.path.isfile(tracks) else ""
    return joined((element("b", title), drawn, element("details", table)), "")


def _steering(tracks: Path) -> Html:
    """Lateral error and speed by distance, of the machines in a tracks.parquet."""
    from swath.record.charts import CHARTS
    from swath.record.tracks import read_tracks
    from swath.report.plots import as_image, curves_figure, styled

    columns = read_tracks(tracks)
    names = dict.fromkeys(columns["machine"].tolist())
    machines = {n: {k: v[columns["machine"] == n] for k, v in columns.items()} for n in names}
    charts = [{**vars(c), "curves": [vars(c.curves[0])]} for c in CHARTS if c.title in SHOWN]
    with styled():
        return _image(as_image(curves_figure(machines, charts)))
