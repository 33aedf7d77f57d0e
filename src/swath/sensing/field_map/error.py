"""Field map level `error`: a map that is right only in part, such as one of an earlier harvest.

    map = mean + r (truth, smeared) + sqrt(1 - r^2) sd N(x, y)

mean and sd are those of the field, N is a random field of unit variance over cells. The map is smeared along
the way as a yield monitor does it, is off by an offset and has cells. On wheat logs the neighbouring pass of
the same day has r = 0.68 at 12 m, a map two years old 0.2 to 0.3 (docs/how-to/field.md).
"""

from dataclasses import dataclass
from math import cos, floor, sin, sqrt
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Le

from swath.core.component import Outputs
from swath.core.random import Stream
from swath.core.registry import Level
from swath.field.site_setup import SiteSetup
from swath.sensing.field_map.places import Answer, LocatedMap, PlaceParams, mean_and_spread, true_grain
from swath.signals import F64

SMEAR = np.linspace(-0.5, 0.5, 5)  # of the kernel's length: places that are averaged along the way
FAR = 1 << 20  # nodes of the random field on either side of zero, beyond it comes again


@dataclass(frozen=True)
class Params(PlaceParams):
    """A map that differs from the truth.

    correlation: correlation of the map with the truth, smeared as it is [1]
    kernel_m: length over which the yield monitor averages, 12 s at 2 m/s
    offset_x_m: offset of the map against the world, east
    offset_y_m: offset of the map against the world, north
    cell_m: side of the map's cells
    noise_cell_m: correlation length of the map's error
    age_d: time since the map was made
    """

    correlation: Annotated[float, Ge(0), Le(1)] = 0.68
    kernel_m: Annotated[float, Ge(0), Le(200)] = 24.0
    offset_x_m: Annotated[float, Ge(-100), Le(100)] = 0.0
    offset_y_m: Annotated[float, Ge(-100), Le(100)] = 0.0
    cell_m: Annotated[float, Ge(0), Le(100)] = 5.0
    noise_cell_m: Annotated[float, Ge(0.01), Le(500)] = 15.0
    age_d: Annotated[float, Ge(0), Le(10000)] = 365.0


class ErrorMap(LocatedMap):
    """A map drawn once per run."""

    kept: ClassVar[tuple[str, ...]] = LocatedMap.kept

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        super().__init__(params, setup)
        self._e = params

    def reset(self, stream: Stream) -> Outputs:
        """Draw the map: its values come as they are asked for, by place alone."""
        x, y, _ = self._setup.start.position.tolist()
        self._mean, self._sd = mean_and_spread(self._setup.field, x, y)
        self._stream, self._nodes = stream, dict[tuple[int, int], float]()
        return super().reset(stream)

    def look_up(self, t: int, x: F64, y: F64, heading: float) -> Answer:
        """The map at points."""
        e = self._e
        x, y = x - e.offset_x_m, y - e.offset_y_m
        if e.cell_m > 0.0:
            x, y = ((np.floor(a / e.cell_m) + 0.5) * e.cell_m for a in (x, y))
        length = e.kernel_m * SMEAR
        east = x[:, None] + length * cos(heading)
        north = y[:, None] + length * sin(heading)
        grown = true_grain(self._setup.field, east.ravel(), north.ravel()).reshape(east.shape).mean(axis=1)
        left = sqrt(1.0 - e.correlation**2) * self._sd
        grain = self._mean + e.correlation * (grown - self._mean) + left * self.noise(x, y)
        here = true_grain(self._setup.field, x, y) > 0.0
        grain = np.where(here, np.maximum(grain, 0.0), np.nan)
        return Answer(grain, np.full(len(x), left), np.full(len(x), 86400.0 * e.age_d))

    def noise(self, x: F64, y: F64) -> F64:
        """The random field: bilinear between normal numbers on nodes, scaled to unit variance everywhere."""
        return np.array([self._noise(a, b) for a, b in zip(x.tolist(), y.tolist(), strict=True)])

    def _noise(self, x: float, y: float) -> float:
        u, v = x / self._e.noise_cell_m, y / self._e.noise_cell_m
        i, j = floor(u), floor(v)
        a, b = u - i, v - j
        weights = (1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b
        nodes = self._node(i, j), self._node(i + 1, j), self._node(i, j + 1), self._node(i + 1, j + 1)
        total = weights[0] * nodes[0] + weights[1] * nodes[1] + weights[2] * nodes[2] + weights[3] * nodes[3]
        return total / sqrt(weights[0] ** 2 + weights[1] ** 2 + weights[2] ** 2 + weights[3] ** 2)

    def _node(self, i: int, j: int) -> float:
        if (i, j) not in self._nodes:
            counter = (i + FAR) % (2 * FAR) * 2 * FAR + (j + FAR) % (2 * FAR)
            self._nodes[i, j] = float(self._stream.at(counter).standard_normal(1)[0])
        return self._nodes[i, j]


LEVEL = Level(
    ErrorMap,
    Params,
    "the truth with correlation, offset, cells and the smear of a yield monitor",
    cost="1 ms",
    tolerance="correlation within 0.03; equal to ideal at correlation 1 without kernel and cells",
)
