"""What pages show of a machine's tracks: curves, and the way of a point of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Curve:
    """A column of the tracks, what a chart calls it, and the factor to the unit of the chart."""

    column: str
    label: str
    factor: float = 1.0


@dataclass(frozen=True)
class Chart:
    """Curves of one unit."""

    title: str
    unit: str
    curves: tuple[Curve, ...]
    of_header: bool = False
    least: int = 1  # curves, below which it says no more than another chart


LOSSES = "Grain lost"
CHARTS = (
    Chart("Edge", "cm", (
        Curve("lateral_error_m", "header end off its line", 100.0),
        Curve("edge_error_m", "detected edge off the true one", 100.0),
    ), of_header=True),
    Chart("Speed", "km/h", (
        Curve("speed_m_s", "driven", 3.6),
        Curve("command_speed_m_s", "wanted", 3.6),
    )),
    Chart("Crop", "kg/s", (
        Curve("feeder_flow_kg_s", "into the feeder house"),
        Curve("grain_flow_kg_s", "grain into the tank"),
    )),
    Chart("Load and loss", "%", (
        Curve("engine_load", "engine load", 100.0),
        Curve("loss_share", "grain lost", 100.0),
        Curve("tank_level", "tank", 100.0),
    )),
    Chart(LOSSES, "kg/s", (
        Curve("threshing_loss_kg_s", "unthreshed"),
        Curve("separation_loss_kg_s", "lost in the straw"),
        Curve("cleaning_loss_kg_s", "lost in the chaff"),
    ), least=2),
    Chart("Header", "cm", (Curve("knife_height_m", "knife above ground", 100.0),), of_header=True),
    Chart("Header use", "%", (Curve("header_fill", "share of the width", 100.0),), of_header=True),
    Chart("Steering", "°", (Curve("steer_rad", "wheel angle", 57.29578),)),
    Chart("Clearance", "m", (Curve("clearance_m", "to the nearest obstacle or machine"),)),
)  # fmt: skip


def path_of(columns: Columns, x: float, y: float) -> NDArray[np.float64]:
    """World way (n, 2) [m] of a point of a machine, roll and pitch left out."""
    c, s = np.cos(columns["yaw_rad"]), np.sin(columns["yaw_rad"])
    return np.stack([columns["x_m"] + c * x - s * y, columns["y_m"] + s * x + c * y], axis=1)


def shown_charts(columns: Columns, *, cuts: bool, is_live: bool = False) -> list[dict[str, Any]]:
    """Charts of a machine whose columns hold numbers that are not all 0. cuts: False without a header.

    is_live: the numbers are still to come, so every column counts
    """
    found = []
    for chart in CHARTS:
        if chart.of_header and not cuts:
            continue
        there = [c for c in chart.curves if c.column in columns]
        curves = [vars(c) for c in there if is_live or _says_something(columns[c.column])]
        if len(curves) >= chart.least:
            found.append({"title": chart.title, "unit": chart.unit, "curves": curves})
    return found


def columns_of(charts: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names of the columns that charts need."""
    return [curve["column"] for chart in charts for curve in chart["curves"]]


def _says_something(values: np.ndarray) -> bool:
    return bool(np.any(np.isfinite(values) & (values != 0.0)))
