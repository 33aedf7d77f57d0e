"""What terrain and stand levels are given besides their parameters, and the verbs they must have.

World: x east, y north, z up [m]. z = 0 is the datum of the terrain, so that heights stay below a few hundred
metres and fit float32 (rounding at 256 m: 15 um). In files an azimuth is clockwise from north, as surveyors
have it and in `field.yaml`; a heading is counter-clockwise from east, as a machine's yaw. Inside, all
directions are counter-clockwise from east.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from swath.core.ability import ByMembers
from swath.core.random import Stream
from swath.core.units import DEG
from swath.field.crop_sheet import Weeds, load_crop

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FieldSetup:
    """stream: random numbers of the field; folder: where relative file names start.

    origin: (easting, northing) of the world's origin in the projected system of the field's maps [m];
    to_local: longitude and latitude (n, 2) [deg] -> world (n, 2) [m], None where the field has no place on
    earth; tracks: driven passes of the field, world points (n, 2) each
    """

    stream: Stream = field(default_factory=lambda: Stream(0, "field"))
    folder: Path = field(default_factory=Path)
    origin: tuple[float, float] = (0.0, 0.0)
    to_local: Callable[[Any], Array] | None = None
    tracks: tuple[Array, ...] = ()


def from_azimuth(azimuth_deg: float) -> float:
    """Direction counter-clockwise from east [rad] of an azimuth clockwise from north [deg]."""
    return (90.0 - azimuth_deg) * DEG


def drilled(
    crop: str, stems_per_m2: float | None, row_spacing_m: float | None, folder: Path
) -> tuple[float, float]:
    """Density [stems/m2] and row spacing [m] of a stand; what is None is that of the crop's sheet."""
    if stems_per_m2 is not None and row_spacing_m is not None:
        return stems_per_m2, row_spacing_m
    stand = load_crop(crop, folder).stand
    return (
        stand.density if stems_per_m2 is None else stems_per_m2,
        stand.row_spacing if row_spacing_m is None else row_spacing_m,
    )


@runtime_checkable
class HasExtent(Protocol, metaclass=ByMembers):
    """A terrain or a stand that is known from a map, which ends somewhere."""

    def covers(self, x: Any, y: Any) -> NDArray[np.bool_]:
        """True on the map, for world points [m], in the shape of x and y broadcast."""
        ...


class Terrain(Protocol):
    """A level of the terrain."""

    def height(self, x: Any, y: Any) -> Array:
        """Height [m] at world points, in the shape of x and y broadcast. Known everywhere."""
        ...

    def lattice(self, u: Array, v: Array, yaw: float) -> Array:
        """Height [m] at the crossings of u (n,) and v (m,) of a frame turned by yaw, shape (m, n).

        A crossing gives the same bits whatever other crossings are asked for along with it.
        """
        ...


@runtime_checkable
class HasRoughness(Protocol):
    """A terrain that knows how rough it is. gd_n0: Gd at 0.1 cycles/m, ISO 8608 [m3]."""

    gd_n0: float


class Stand(Protocol):
    """A level of the stand.

    crop: name of the crop; density_max [stems/m2]: nowhere exceeded; row_spacing [m], 0 = no rows;
    row_heading [rad]: direction of the rows in the world, counter-clockwise from east; weeds: under the crop
    It may have a `wind` (`field/wind.py`) and a `detail` too.
    """

    crop: str
    density_max: float
    row_spacing: float
    row_heading: float
    weeds: Weeds | None

    def density(self, x: Any, y: Any) -> Array:
        """Stems per m2 at world points."""
        ...

    def height_factor(self, x: Any, y: Any) -> Array:
        """Length of the plants relative to the crop's own."""
        ...

    def lean(self, x: Any, y: Any) -> tuple[Array, Array]:
        """Mean lean from the vertical and its direction, counter-clockwise from east [rad]."""
        ...

    def bare(self, x: Any, y: Any) -> NDArray[np.bool_]:
        """True where nothing grows although the stand is sown around it (tramlines)."""
        ...

    def may_be_bare(self, x: Any, y: Any, radius: float) -> NDArray[np.bool_]:
        """False where no point within the radius [m] is bare. May say True too often."""
        ...
