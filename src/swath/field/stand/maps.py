"""Stand level `maps`: density, height and lean that change over the field, lodged patches and tramlines.

Density, height and lean are taken at the middle of each tile (about 1 m); tramlines are exact to a cut cell.
"""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from swath.core import portable
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.units import DEG, PERCENT
from swath.field.crop_sheet import load_crop
from swath.field.field_setup import FieldSetup, from_azimuth
from swath.field.ground.waves import Waves, make_random_field
from swath.field.hashing import hash_uniform
from swath.field.maps.band import CROP_HEIGHT, STEMS
from swath.field.maps.raster import Raster
from swath.field.stand.uniform import Params as UniformParams
from swath.field.stand.uniform import Uniform

Array = NDArray[np.float64]
Metres = Annotated[float, Ge(-1e5), Le(1e5)]
Azimuth = Annotated[float, Ge(-360.0), Le(360.0)]
DENSITY_LIMIT = 3000.0  # stems/m2


@dataclass(frozen=True, kw_only=True)
class Patch:
    """A round lodged patch.

    x_m: east coordinate of its middle
    y_m: north coordinate of its middle
    radius_m: radius of the patch
    lean_deg: mean lean of its stems
    azimuth_deg: direction in which they lean, clockwise from north
    """

    x_m: Metres
    y_m: Metres
    radius_m: Annotated[float, Gt(0.0), Le(1000.0)]
    lean_deg: Annotated[float, Ge(0.0), Le(80.0)] = 60.0
    azimuth_deg: Azimuth = 90.0


@dataclass(frozen=True, kw_only=True)
class Lodging:
    """Random lodged patches.

    share_percent: share of the area that is lodged
    diameter_min_m: diameter of the smallest patch
    diameter_max_m: diameter of the largest patch; all diameters between are as likely
    lean_deg: mean lean of the stems in a patch
    azimuth_deg: mean direction in which they lean, clockwise from north; one direction within a patch
    azimuth_sd_deg: standard deviation of the direction from patch to patch
    """

    share_percent: Annotated[float, Ge(0.0), Le(30.0)] = 5.0
    diameter_min_m: Annotated[float, Gt(0.0), Le(200.0)] = 2.0
    diameter_max_m: Annotated[float, Gt(0.0), Le(200.0)] = 20.0
    lean_deg: Annotated[float, Ge(0.0), Le(80.0)] = 60.0
    azimuth_deg: Azimuth = 90.0
    azimuth_sd_deg: Annotated[float, Ge(0.0), Le(180.0)] = 20.0

    def __post_init__(self) -> None:
        if self.diameter_max_m < self.diameter_min_m:
            expected = f"expected >= diameter_min_m = {self.diameter_min_m:g}"
            raise InputError("diameter_max_m", self.diameter_max_m, expected)


@dataclass(frozen=True, kw_only=True)
class Variation:
    """Smooth random change.

    sd_percent: standard deviation
    length_m: correlation length
    """

    sd_percent: Annotated[float, Ge(0.0), Le(30.0)] = 6.0
    length_m: Annotated[float, Ge(2.0), Le(1e4)] = 20.0


@dataclass(frozen=True, kw_only=True)
class Tramlines:
    """Pairs of bare wheel tracks along the rows.

    spacing_m: distance from pair to pair
    track_m: distance between the middles of the two tracks
    width_m: width of each track
    offset_m: distance from the world's origin to a pair's middle, to the left of the rows
    """

    spacing_m: Annotated[float, Ge(4.0), Le(200.0)] = 24.0
    track_m: Annotated[float, Ge(1.0), Le(3.5)] = 2.0
    width_m: Annotated[float, Ge(0.1), Le(1.0)] = 0.45
    offset_m: Metres = 0.0


@dataclass(frozen=True, kw_only=True)
class Params(UniformParams):
    """The stand of level `uniform`, changed by maps.

    Where a map holds no value nothing grows, or the crop has its own height.

    lean_azimuth_deg: direction in which the stems lean, clockwise from north
    density_file: GeoTIFF of stems per m2
    height_file: GeoTIFF of the height of the crop in m
    density_variation: smooth random change on top of the density
    height_variation: smooth random change on top of the height
    patches: lodged places that are given one by one
    lodging: lodged places that are drawn at random
    tramlines: bare wheel tracks
    """

    lean_azimuth_deg: Azimuth = 90.0
    density_file: str | None = None
    height_file: str | None = None
    density_variation: Variation | None = None
    height_variation: Variation | None = None
    patches: tuple[Patch, ...] = ()
    lodging: Lodging | None = None
    tramlines: Tramlines | None = None


class Maps(Uniform):
    """A stand of maps and patches."""

    def __init__(self, params: Params, setup: FieldSetup) -> None:
        density, height = (
            None if name is None else Raster.from_geotiff(setup.folder / name, setup.origin, quantity=of)
            for name, of in ((params.density_file, STEMS), (params.height_file, CROP_HEIGHT))
        )
        self._take(params, setup, density, height)

    @staticmethod
    def from_rasters(
        params: Params, setup: FieldSetup, density: Raster | None, height: Raster | None
    ) -> "Maps":
        """A stand of rasters in world coordinates: stems per m2 and height of the crop [m]."""
        maps = Maps.__new__(Maps)
        maps._take(params, setup, density, height)
        return maps

    def _take(self, params: Params, setup: FieldSetup, density: Raster | None, height: Raster | None) -> None:
        Uniform.__init__(self, params, setup)
        self.params, self._stems = params, self.density_max
        self._density, self._height = density, height
        self.notes = [note for of in (density, height) if of is not None for note in of.notes]
        stream = setup.stream.child("stand")
        self._density_waves = _variation(params.density_variation, stream.child("density"))
        self._height_waves = _variation(params.height_variation, stream.child("height"))
        self._crop_height = load_crop(params.crop, setup.folder).stand.height if height is not None else 1.0
        self._lodging = _Patches(params, stream.child("lodging"))
        highest = self._stems if density is None else float(np.nanmax(density.values))
        lowest = self._stems if density is None else float(np.nanmin(density.values))
        if lowest < 0.0 or not 0.0 < highest <= DENSITY_LIMIT:
            expected = f"expected a map of 0 to {DENSITY_LIMIT:g} stems/m2, some of them > 0"
            raise InputError("field.stand.density_file", f"{lowest:g} to {highest:g}", expected)
        if (
            height is not None
            and not 0.05 <= float(np.nanmin(height.values)) <= np.nanmax(height.values) <= 5.0
        ):
            raise InputError("field.stand.height_file", None, "expected heights of 0.05 to 5 m")
        spread = 3.0 * params.density_variation.sd_percent * PERCENT if params.density_variation else 0.0
        self.density_max = min(highest * (1.0 + spread), DENSITY_LIMIT)

    def density(self, x: Any, y: Any) -> Array:
        """Stems per m2, at most `density_max`."""
        own = self.params.stems_per_m2
        base = np.full(np.broadcast_shapes(np.shape(x), np.shape(y)), self._stems if own is None else own)
        if self._density is not None:
            base = np.nan_to_num(self._density.sample(x, y))
        changed = base * (1.0 + self._density_waves.height(x, y))
        return np.clip(changed, 0.0, self.density_max)

    def covers(self, x: Any, y: Any) -> NDArray[np.bool_]:
        """True on the maps of density and height, where the stand has them."""
        known = np.ones(np.broadcast_shapes(np.shape(x), np.shape(y)), dtype=bool)
        for raster in (self._density, self._height):
            if raster is not None:
                known &= np.isfinite(raster.sample(x, y))
        return known

    def height_factor(self, x: Any, y: Any) -> Array:
        """Plant length relative to the crop's own."""
        factor = self.params.height_factor * (1.0 + self._height_waves.height(x, y))
        if self._height is not None:
            height = self._height.sample(x, y) / self._crop_height
            factor = factor * np.where(np.isfinite(height), height, 1.0)
        return np.clip(factor, 0.05, 4.0)

    def lean(self, x: Any, y: Any) -> tuple[Array, Array]:
        """Mean lean from the vertical and its direction [rad]."""
        return self._lodging.lean(x, y)

    def bare(self, x: Any, y: Any) -> NDArray[np.bool_]:
        """True in the wheel tracks of tramlines."""
        return self.may_be_bare(x, y, 0.0)

    def may_be_bare(self, x: Any, y: Any, radius: float) -> NDArray[np.bool_]:
        """True within the radius of a wheel track."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        t = self.params.tramlines
        if t is None:
            return np.zeros(x.shape, dtype=bool)
        left = y * np.cos(self.row_heading) - x * np.sin(self.row_heading) - t.offset_m
        across = np.abs(left - t.spacing_m * np.round(left / t.spacing_m))
        return np.asarray(np.abs(across - 0.5 * t.track_m) <= 0.5 * t.width_m + radius)


class _Patches:
    """Lean everywhere: the stand's own, of listed patches, and of random ones.

    Random patches: one per cell of a square lattice, so far from each other that the wanted share of the area
    lodges on average; a hash of the cell gives place, size and azimuth, so that no list is needed.
    """

    def __init__(self, params: Params, stream: Stream) -> None:
        self._own = params.lean_deg * DEG, from_azimuth(params.lean_azimuth_deg)
        self._listed, self._random = params.patches, params.lodging
        self._seed, self._cell = stream.integer(), 0.0
        if self._random is not None and self._random.share_percent > 0.0:
            a, b = self._random.diameter_min_m, self._random.diameter_max_m
            mean_area = np.pi / 12.0 * (a * a + a * b + b * b)  # of even diameters
            self._cell = float(np.sqrt(mean_area / (self._random.share_percent * PERCENT)))

    def lean(self, x: Any, y: Any) -> tuple[Array, Array]:
        """Mean lean and its direction [rad]."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        angle, azimuth = np.full(x.shape, self._own[0]), np.full(x.shape, self._own[1])
        if self._random is not None and self._cell > 0.0:
            self._lay_random(x, y, angle, azimuth, self._random)
        for patch in self._listed:
            inside = np.hypot(x - patch.x_m, y - patch.y_m) <= patch.radius_m
            angle[inside], azimuth[inside] = patch.lean_deg * DEG, from_azimuth(patch.azimuth_deg)
        return angle, azimuth

    def _lay_random(self, x: Array, y: Array, angle: Array, azimuth: Array, lodging: Lodging) -> None:
        i, j = np.floor(x / self._cell).astype(np.int64), np.floor(y / self._cell).astype(np.int64)
        reach = int(np.ceil(0.5 * lodging.diameter_max_m / self._cell))
        for di in range(-reach, reach + 1):
            for dj in range(-reach, reach + 1):
                px, py, size, turn_a, turn_b = (
                    hash_uniform(self._seed, i + di, j + dj, n).reshape(x.shape) for n in range(5)
                )
                diameter = lodging.diameter_min_m + size * (lodging.diameter_max_m - lodging.diameter_min_m)
                far = np.hypot((i + di + px) * self._cell - x, (j + dj + py) * self._cell - y)
                inside = far <= 0.5 * diameter
                normal = np.sqrt(-2.0 * portable.log1p(-turn_a)) * np.cos(2.0 * np.pi * turn_b)  # Box-Muller
                heading = from_azimuth(lodging.azimuth_deg) + lodging.azimuth_sd_deg * DEG * normal
                angle[inside], azimuth[inside] = lodging.lean_deg * DEG, heading[inside]


def _variation(params: Variation | None, stream: Stream) -> Waves:
    if params is None or params.sd_percent == 0.0:
        return Waves.none()
    return make_random_field(params.sd_percent * PERCENT, params.length_m, stream)


LEVEL = Level(
    Maps,
    Params,
    "maps of density and height, lodged patches, tramlines",
    cost="0.3 ms per page of 8 m x 8 m",
    tolerance="density, height and lean constant over a tile of 1 m",
)
