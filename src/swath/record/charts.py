"""What pages show of a machine's tracks: curves, and the way of a point of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.units import DEG, MM, RPM

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
    of_flow: bool = False  # below the ways of the crop, where a page shows these, and only where it changes
    least: int = 1  # curves, below which it says no more than another chart


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
    Chart("Grain lost", "kg/s", (
        Curve("threshing_loss_kg_s", "unthreshed"),
        Curve("separation_loss_kg_s", "lost in the straw"),
        Curve("cleaning_loss_kg_s", "lost in the chaff"),
    ), of_flow=True, least=2),
    Chart("Drum and fan as set", "rpm", (
        Curve("settings_drum_rad_s", "drum or rotor", 1.0 / RPM),
        Curve("settings_fan_rad_s", "fan", 1.0 / RPM),
    ), of_flow=True),
    Chart("Openings as set", "mm", (
        Curve("settings_concave_m", "concave", 1.0 / MM),
        Curve("settings_upper_m", "upper sieve", 1.0 / MM),
        Curve("settings_lower_m", "lower sieve", 1.0 / MM),
    ), of_flow=True),
    Chart("Vanes as set", "°", (Curve("settings_vane_rad", "rotor vanes", 1.0 / DEG),), of_flow=True),
    Chart("Header", "cm", (Curve("knife_height_m", "knife above ground", 100.0),), of_header=True),
    Chart("Header use", "%", (Curve("header_fill", "share of the width", 100.0),), of_header=True),
    Chart("Steering", "°", (Curve("steer_rad", "wheel angle", 1.0 / DEG),)),
    Chart("Clearance", "m", (Curve("clearance_m", "to the nearest obstacle or machine"),)),
)  # fmt: skip


def path_of(columns: Columns, x: float, y: float) -> NDArray[np.float64]:
    """World way (n, 2) [m] of a point of a machine, roll and pitch left out."""
    c, s = np.cos(columns["yaw_rad"]), np.sin(columns["yaw_rad"])
    return np.stack([columns["x_m"] + c * x - s * y, columns["y_m"] + s * x + c * y], axis=1)


def shown_charts(
    columns: Columns, *, cuts: bool, is_live: bool = False, of_flow: bool | None = None
) -> list[dict[str, Any]]:
    """Charts of a machine whose columns hold numbers that are not all 0. cuts: False without a header.

    is_live: the numbers are still to come, so every column counts
    of_flow: only those below the ways of the crop, or only the others; None = all
    """
    found = []
    for chart in CHARTS:
        if (chart.of_header and not cuts) or of_flow not in (None, chart.of_flow):
            continue
        there = [c for c in chart.curves if c.column in columns]
        curves = [vars(c) for c in there if is_live or _says_something(columns[c.column])]
        changes = is_live or not chart.of_flow or any(np.ptp(_known(columns[c["column"]])) for c in curves)
        if len(curves) >= chart.least and changes:
            found.append({"title": chart.title, "unit": chart.unit, "curves": curves})
    return found


def columns_of(charts: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names of the columns that charts need."""
    return [curve["column"] for chart in charts for curve in chart["curves"]]


def _known(values: np.ndarray) -> np.ndarray:
    known: np.ndarray = values[np.isfinite(values)]
    return known


def _says_something(values: np.ndarray) -> bool:
    return bool(_known(values).any())
