"""Colour filters on an image sensor: which pixel sees which colour, and a picture of all three again.

Rows red green, green blue. The two colours that a pixel has not measured are means of its neighbours that
have (bilinear interpolation); at the border of those that are there.
"""

import numpy as np
from numpy.typing import NDArray

from swath.signals import F64


def filters(height: int, width: int) -> NDArray[np.int64]:
    """Colour of each pixel, 0 red, 1 green, 2 blue, (height, width)."""
    rows, columns = np.indices((height, width)) % 2
    return rows + columns


def filtered(light: F64) -> F64:
    """Of light (height, width, 3) what each pixel's filter lets through, (height, width)."""
    colour = filters(*light.shape[:2])
    return np.take_along_axis(light, colour[..., None], axis=2)[..., 0]


def interpolated(values: F64) -> F64:
    """A picture (height, width, 3) of what pixels behind filters measured, (height, width)."""
    colour = filters(*values.shape)
    found = []
    for k in range(3):
        own = colour == k
        total, weight = _around(np.where(own, values, 0.0)), _around(own.astype(np.float64))
        found.append(np.where(own, values, total / weight))
    return np.stack(found, axis=-1)


def _around(values: F64) -> F64:
    """Sum of the eight neighbours, those at the sides twice, with 0 beyond the border."""
    wide = np.pad(values, 1)
    rows = wide[:-2] + 2.0 * wide[1:-1] + wide[2:]
    return np.asarray(rows[:, :-2] + 2.0 * rows[:, 1:-1] + rows[:, 2:])
