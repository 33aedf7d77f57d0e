"""Stand level `uniform`: the same density, height and lean everywhere."""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from swath.core.registry import Level
from swath.core.units import DEG
from swath.field.crop_sheet import Weeds
from swath.field.field_setup import FieldSetup, drilled, from_azimuth
from swath.field.moisture import Moisture
from swath.field.plants.drawing import Detail
from swath.field.wind import Wind

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Params(Moisture):
    """The same stand everywhere.

    crop: a bundled crop sheet or your own file, whose plants may be meshes (docs/explanation/crops.md)
    stems_per_m2: density of the stems, of plants with one stem that of the plants; none = the crop's own
    row_spacing_m: distance between rows; 0 = no rows, none = the crop's own
    row_azimuth_deg: direction of the rows, clockwise from north
    height_factor: plant length relative to the crop's own [1]
    lean_deg: mean lean of all stems, on top of the lean of each
    lean_azimuth_deg: direction in which they lean, clockwise from north
    weeds: weeds under the crop
    wind: wind that sways the crop
    detail: `full`, or `reduced` = the same plants of fewer primitives (docs/explanation/crops.md)
    """

    crop: str = "wheat"
    stems_per_m2: Annotated[float, Gt(0.0), Le(3000.0)] | None = None
    row_spacing_m: Annotated[float, Ge(0.0), Le(1.0)] | None = None
    row_azimuth_deg: Annotated[float, Ge(-360.0), Le(360.0)] = 0.0
    height_factor: Annotated[float, Gt(0.0), Le(4.0)] = 1.0
    lean_deg: Annotated[float, Ge(0.0), Le(80.0)] = 0.0
    lean_azimuth_deg: Annotated[float, Ge(-360.0), Le(360.0)] = 0.0
    weeds: Weeds | None = None
    wind: Wind | None = None
    detail: Detail = "full"


class Uniform:
    """A stand that is alike everywhere."""

    def __init__(self, params: Params, setup: FieldSetup) -> None:
        self.crop = params.crop
        self.density_max, self.row_spacing = drilled(
            params.crop, params.stems_per_m2, params.row_spacing_m, setup.folder
        )
        self.weeds, self.wind, self.detail = params.weeds, params.wind, params.detail
        self.row_heading = from_azimuth(params.row_azimuth_deg)
        self.moisture: Moisture = params
        self._factor = params.height_factor
        self._lean = params.lean_deg * DEG, from_azimuth(params.lean_azimuth_deg)

    def density(self, x: Any, y: Any) -> Array:
        """Stems per m2."""
        return _constant(self.density_max, x, y)

    def height_factor(self, x: Any, y: Any) -> Array:
        """Plant length relative to the crop's own."""
        return _constant(self._factor, x, y)

    def lean(self, x: Any, y: Any) -> tuple[Array, Array]:
        """Lean from the vertical and its direction [rad]."""
        return _constant(self._lean[0], x, y), _constant(self._lean[1], x, y)

    def bare(self, x: Any, y: Any) -> NDArray[np.bool_]:
        """Nowhere."""
        return _constant(0.0, x, y) > 0.0

    def may_be_bare(self, x: Any, y: Any, radius: float) -> NDArray[np.bool_]:
        """Nowhere."""
        return _constant(0.0, x, y) > 0.0


def _constant(value: float, x: Any, y: Any) -> Array:
    return np.full(np.broadcast_shapes(np.shape(x), np.shape(y)), value)


LEVEL = Level(Uniform, Params, "alike everywhere", cost="none", tolerance="exact")
