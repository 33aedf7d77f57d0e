"""Field map level `file`: a GeoTIFF, such as the yield map of an earlier year, at the measured place."""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.errors import InputError
from swath.core.registry import Level
from swath.field.maps.band import GRAIN
from swath.field.maps.raster import Raster
from swath.field.site_setup import SiteSetup
from swath.sensing.field_map.places import Answer, LocatedMap, PlaceParams
from swath.signals import F64


@dataclass(frozen=True, kw_only=True)
class Params(PlaceParams):
    """A map from a file.

    file: a GeoTIFF in the field's system, one band
    per_m2: kg/m2 per unit of its numbers: 0.1 for t/ha; none = as the unit of the band says, 1 without one
    sd_kg_m2: standard deviation of its error, as its maker says; none = not known
    age_d: time since the map was made; none = not known
    """

    file: str
    per_m2: Annotated[float, Gt(0), Le(1e4)] | None = None
    sd_kg_m2: Annotated[float, Ge(0), Le(10)] | None = None
    age_d: Annotated[float, Ge(0), Le(10000)] | None = None


class FileMap(LocatedMap):
    """Bilinear between the cells of a map; nan where it has no value."""

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        super().__init__(params, setup)
        origin = setup.origin
        east_north = None if origin is None else (origin.easting, origin.northing)
        self._raster = Raster.from_geotiff(
            setup.base / params.file, east_north, quantity=replace(GRAIN, stated=params.per_m2)
        )
        self.notes = self._raster.notes
        if origin is not None and self._raster.epsg != origin.epsg:
            found = f"EPSG:{self._raster.epsg}"
            raise InputError("file", found, f"expected EPSG:{origin.epsg} as the field", file=params.file)
        self._f = params

    def look_up(self, t: int, x: F64, y: F64, heading: float) -> Answer:
        """The map at points."""
        grain = self._raster.sample(x, y)
        sd = np.nan if self._f.sd_kg_m2 is None else self._f.sd_kg_m2
        age = np.nan if self._f.age_d is None else 86400.0 * self._f.age_d
        return Answer(grain, np.full(len(x), sd), np.full(len(x), age))


LEVEL = Level(
    FileMap,
    Params,
    "a GeoTIFF at the measured place",
    cost="0.2 ms",
    tolerance="bit for bit the map's values",
)
