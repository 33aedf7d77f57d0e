"""What terrain and stand levels are given besides their parameters, and the verbs they must have.

World: x east, y north, z up [m]. z = 0 is the datum of the terrain, so that heights stay below a few hundred
metres and fit float32 (rounding at 256 m: 15 um). Directions in files (`*_deg`) are counter-clockwise from
east, the same as a machine's heading.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from swath.core.random import Stream

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FieldSetup:
    """stream: random numbers of the field; folder: where relative file names start;
    origin: (easting, northing) of the world's origin in the projected system of the field's maps [m].
    """

    stream: Stream = field(default_factory=lambda: Stream(0, "field"))
    folder: Path = field(default_factory=Path)
    origin: tuple[float, float] = (0.0, 0.0)


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


class Stand(Protocol):
    """A level of the stand.

    crop: name of the crop; density_max [stems/m2]: nowhere exceeded; row_spacing [m], 0 = no rows;
    row_azimuth [rad]: direction of the rows in the world
    """

    crop: str
    density_max: float
    row_spacing: float
    row_azimuth: float

    def density(self, x: Any, y: Any) -> Array:
        """Stems per m2 at world points."""
        ...

    def height_factor(self, x: Any, y: Any) -> Array:
        """Length of the plants relative to the crop's own."""
        ...

    def lean(self, x: Any, y: Any) -> tuple[Array, Array]:
        """Mean lean from the vertical and the direction it leans to in the world [rad]."""
        ...

    def bare(self, x: Any, y: Any) -> NDArray[np.bool_]:
        """True where nothing grows although the stand is sown around it (tramlines)."""
        ...

    def may_be_bare(self, x: Any, y: Any, radius: float) -> NDArray[np.bool_]:
        """False where no point within the radius [m] is bare. May say True too often."""
        ...
