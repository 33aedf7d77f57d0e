"""Stand level `bands`: bands of different density one after the other along a direction."""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.registry import Level
from swath.field.field_setup import FieldSetup, from_azimuth
from swath.field.stand.uniform import Params as UniformParams
from swath.field.stand.uniform import Uniform

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Band:
    """One band.

    from_m: where the band begins along that direction, from the world's origin
    stems_per_m2: density of the stems in the band
    height_factor: plant length in the band relative to the crop's own [1]
    """

    from_m: Annotated[float, Ge(-1e5), Le(1e5)]
    stems_per_m2: Annotated[float, Gt(0.0), Le(3000.0)]
    height_factor: Annotated[float, Gt(0.0), Le(4.0)] = 1.0


@dataclass(frozen=True)
class Params(UniformParams):
    """Bands across the field; before the first one the stand is that of level `uniform`.

    bands: the bands, in rising order of from_m
    bands_azimuth_deg: direction along which the bands follow each other, clockwise from north
    """

    bands: Annotated[tuple[Band, ...], MinLen(1)] = (Band(50.0, 500.0),)
    bands_azimuth_deg: Annotated[float, Ge(-360.0), Le(360.0)] = 0.0


class Bands(Uniform):
    """A stand whose density jumps. Constant over a tile (about 1 m), as in every stand."""

    def __init__(self, params: Params, setup: FieldSetup) -> None:
        super().__init__(params, setup)
        starts = [b.from_m for b in params.bands]
        if starts != sorted(set(starts)):
            raise InputError("field.stand.bands", starts, "expected rising from_m")
        heading = from_azimuth(params.bands_azimuth_deg)
        self._along = float(np.cos(heading)), float(np.sin(heading))
        self._starts = np.array(starts)
        self._densities = np.array([self.density_max, *(b.stems_per_m2 for b in params.bands)])
        self._factors = np.array([params.height_factor, *(b.height_factor for b in params.bands)])
        self.density_max = float(self._densities.max())

    def density(self, x: Any, y: Any) -> Array:
        """Stems per m2."""
        return np.asarray(self._densities[self._band(x, y)], dtype=np.float64)

    def height_factor(self, x: Any, y: Any) -> Array:
        """Plant length relative to the crop's own."""
        return np.asarray(self._factors[self._band(x, y)], dtype=np.float64)

    def _band(self, x: Any, y: Any) -> NDArray[np.int64]:
        s = np.asarray(x, dtype=float) * self._along[0] + np.asarray(y, dtype=float) * self._along[1]
        return np.searchsorted(self._starts, s, side="right").astype(np.int64)


LEVEL = Level(
    Bands, Params, "bands of different density", cost="none", tolerance="constant over a tile of 1 m"
)
