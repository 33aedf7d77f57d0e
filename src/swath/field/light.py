"""The light of sun and sky: one for cameras, scanners and what warms up.

Of a clear sky by the elevation of the sun alone, from the table `data/light/clear-sky.yaml`, which says where
it is from; through clouds 1 - 0.75 c^3.4 of the light on level ground is left (Kasten and Czeplak 1980,
doi:10.1016/0038-092X(80)90391-6), of the sun itself 1 - c. Below -12 deg it is night, as dark as at -12.
"""

from dataclasses import dataclass
from functools import cache
from math import sin
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.core.units import DEG
from swath.documents.yaml_document import read_document

Array = NDArray[np.float64]
FILE = Path(__file__).parents[1] / "data" / "light" / "clear-sky.yaml"
NOTHING = 1e-9  # light that the table has as 0
CLOUD_LOSS, CLOUD_POWER = 0.75, 3.4  # Kasten and Czeplak 1980


@dataclass(frozen=True)
class Light:
    """Light outdoors.

    wavelengths: [m], (n,)
    sun: irradiance of a surface across the sun [W/(m2 nm)] at the wavelengths, then illuminance [lx], then
        irradiance of 300 to 4000 nm [W/m2]: (n + 2,)
    sky: the same of the sky on level ground, (n + 2,)
    level: the same of both on level ground, (n + 2,)
    """

    wavelengths: Array
    sun: Array
    sky: Array
    level: Array

    @property
    def lux(self) -> float:
        """Illuminance of level ground [lx]."""
        return float(self.level[-2])

    @property
    def watts(self) -> float:
        """Irradiance of level ground [W/m2], 300 to 4000 nm."""
        return float(self.level[-1])

    def at(self, wavelength: float, values: Array) -> float:
        """One of `sun`, `sky` and `level` at a wavelength [m]: [W/(m2 nm)]."""
        return float(np.interp(wavelength, self.wavelengths, values[:-2]))


def light(elevation: float, cloud: float = 0.0) -> Light:
    """The light of a sun so high [rad] under so many clouds, 0 clear to 1 overcast."""
    wavelengths, heights, logs = _table()
    sun, sky = portable.exp([np.interp(elevation, heights, column) for column in logs.T]).reshape(2, -1)
    sun = np.where(sun <= 2.0 * NOTHING, 0.0, sun)
    rise = max(sin(elevation), 0.0)
    left = 1.0 - CLOUD_LOSS * cloud**CLOUD_POWER
    level = left * (sun * rise + sky)
    direct = (1.0 - cloud) * sun
    return Light(wavelengths, direct, level - direct * rise, level)


@cache
def _table() -> tuple[Array, Array, Array]:
    """Wavelengths [m], elevations [rad], logarithms of the light (rows, 2 (n + 2))."""
    data = read_document(FILE).data
    rows = np.array(data["rows"], dtype=float)
    values, count = rows[:, 1:].copy(), len(data["wavelengths_nm"])
    values.reshape(len(rows), 2, -1)[:, :, :count] *= 1e-3  # of mW/(m2 nm)
    return np.array(data["wavelengths_nm"]) * 1e-9, rows[:, 0] * DEG, portable.log(values + NOTHING)
