"""Terrain level `plane`: one tilted plane through the world's origin."""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from swath.core.registry import Level
from swath.core.units import PERCENT
from swath.field.field_setup import FieldSetup, from_azimuth

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Params:
    """A plane.

    slope_percent: rise per run
    slope_azimuth_deg: direction in which the ground rises, clockwise from north
    height_m: height of the ground at the world's origin
    """

    slope_percent: Annotated[float, Ge(-100.0), Le(100.0)] = 0.0
    slope_azimuth_deg: Annotated[float, Ge(-360.0), Le(360.0)] = 90.0
    height_m: Annotated[float, Ge(-1000.0), Le(1000.0)] = 0.0


class Plane:
    """A plane."""

    def __init__(self, params: Params, setup: FieldSetup) -> None:
        self.base = params.height_m
        slope, direction = params.slope_percent * PERCENT, from_azimuth(params.slope_azimuth_deg)
        self.slope_x, self.slope_y = slope * np.cos(direction), slope * np.sin(direction)

    def height(self, x: Any, y: Any) -> Array:
        """Height [m] at world points."""
        x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        return np.asarray(self.base + self.slope_x * x + self.slope_y * y)

    def lattice(self, u: Array, v: Array, yaw: float) -> Array:
        """Height [m] at the crossings of u and v in a frame turned by yaw, shape (len(v), len(u))."""
        c, s = np.cos(yaw), np.sin(yaw)
        slope_u, slope_v = c * self.slope_x + s * self.slope_y, -s * self.slope_x + c * self.slope_y
        return np.asarray(self.base + slope_u * u[None, :] + slope_v * v[:, None])


LEVEL = Level(Plane, Params, "a tilted plane", cost="none", tolerance="exact")
