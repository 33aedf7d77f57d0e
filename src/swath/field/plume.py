"""Dust that drifts: puffs that go with the wind, grow and settle.

A puff of the mass m that has gone x with the wind has the concentration

    C = m / ((2 pi)^1.5 sy^2 sz) exp(-(dx^2 + dy^2) / (2 sy^2)) (exp(-(z - h)^2 / (2 sz^2)) + exp(-(z + h)^2 /
    (2 sz^2)))

with sy, sz of Briggs 1973 for open country by Pasquill's class, on top of the spread s0 at the source, x at
least 0.5 m/s times its age, so that it grows in calm air, too. Its height h goes down as its grains fall
(drag of Stokes with that of Schiller and Naumann 1933); on the ground it loses the fall speed times the
concentration there. What it takes from light is k C, k of coarse plant dust at 905 nm by Mie's theory, within
15 % the same from 550 to 1550 nm.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, pi, sqrt
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.core.component import KeepsState

Array = NDArray[np.float64]
Stability = Literal["A", "B", "C", "D", "E", "F"]
# sy = c x (1 + 1e-4 x)^-1/2, sz = a x (1 + b x)^-p: c, a, b, p
BRIGGS: dict[Stability, tuple[float, float, float, float]] = {
    "A": (0.22, 0.20, 0.0, 0.5),
    "B": (0.16, 0.12, 0.0, 0.5),
    "C": (0.11, 0.08, 2e-4, 0.5),
    "D": (0.08, 0.06, 1.5e-3, 0.5),
    "E": (0.06, 0.03, 3e-4, 1.0),
    "F": (0.04, 0.016, 3e-4, 1.0),
}
CALM = 0.5  # puffs grow as in a wind of at least this speed [m/s]
THIN, FAR = 1e-6, 600.0  # a puff is gone whose middle has less extinction [1/m], or that went further [m]
CLOSE = 0.3  # puffs whose heights scatter by less of their spread are merged
AIR_VISCOSITY, AIR_DENSITY, GRAVITY = 1.81e-5, 1.204, 9.80665  # of air at 20 C [Pa s, kg/m3], [m/s2]


@dataclass(frozen=True)
class Grains:
    """Dust of one size. share: of the mass; diameter [m]; density [kg/m3]; extinction [m2/kg]."""

    share: float
    diameter: float
    density: float
    extinction: float


# Of plant dust; the shares make a median of 35 um by mass
PLANT = (
    Grains(0.25, 10e-6, 1300.0, 340.0),
    Grains(0.4, 30e-6, 1300.0, 130.0),
    Grains(0.35, 50e-6, 1300.0, 80.0),
)


def fall_speed(diameter: float, density: float) -> float:
    """Speed [m/s] at which a ball of a diameter [m] and density [kg/m3] falls in air."""
    free = GRAVITY * density * diameter**2 / (18.0 * AIR_VISCOSITY)
    speed = free
    for _ in range(30):
        reynolds = AIR_DENSITY * speed * diameter / AIR_VISCOSITY
        speed = 0.5 * (speed + free / (1.0 + 0.15 * float(reynolds**0.687)))
    return speed


class Puffs(KeepsState):
    """The dust of one source of many puffs.

    rows: x, y, height [m], way with the wind [m], mass [kg], extinction [m2/kg], fall speed [m/s]: (n, 7)
    """

    kept: ClassVar[tuple[str, ...]] = ("rows",)

    def __init__(self, stability: Stability = "C", start: float = 0.0) -> None:
        self.stability, self.start = stability, start
        self.rows = np.zeros((0, 7))

    def emit(self, place: Sequence[float], mass: float, grains: Sequence[Grains] = PLANT) -> None:
        """New puffs of a mass [kg], one of each size, at world x, y and height above the ground [m]."""
        new = [(*place, 0.0, g.share * mass, g.extinction, fall_speed(g.diameter, g.density)) for g in grains]
        self.rows = np.concatenate([self.rows, np.array(new).reshape(-1, 7)])

    def drift(self, dt: float, wind: Sequence[float]) -> None:
        """A step [s] in a wind, east and north [m/s]."""
        rows = self.rows
        rows[:, :2] += dt * np.asarray(wind)
        rows[:, 3] += dt * max(hypot(*wind), CALM)
        across, high = self.spread()
        down = rows[:, 6] * dt
        on_ground = np.clip(down - rows[:, 2], 0.0, down)  # of the way down, so much is left at the ground
        rows[:, 2] = np.maximum(rows[:, 2] - down, 0.0)
        rows[:, 4] *= portable.exp(-sqrt(2.0 / pi) * on_ground / high)
        peak = rows[:, 5] * rows[:, 4] / (across * across * high) * (2.0 / (2.0 * pi) ** 1.5)
        self.rows = rows[(peak >= THIN) & (rows[:, 3] < FAR)]

    def spread(self) -> tuple[Array, Array]:
        """Standard deviations, level and up [m], (n,) each."""
        c, a, b, p = BRIGGS[self.stability]
        x = self.rows[:, 3]
        across = c * x / np.sqrt(1.0 + 1e-4 * x)
        high = a * x / (np.sqrt(1.0 + b * x) if p == 0.5 else 1.0 + b * x)
        return np.sqrt(self.start**2 + across**2), np.sqrt(self.start**2 + high**2)

    def packed(self) -> Array:
        """As the kernel takes them: x, y, height, 1 / (2 sy^2), 1 / (2 sz^2), extinction in the middle of a
        puff in free air [1/m], (n, 6).
        """
        across, high = self.spread()
        middle = self.rows[:, 5] * self.rows[:, 4] / ((2.0 * pi) ** 1.5 * across * across * high)
        shape = [0.5 / (across * across), 0.5 / (high * high), middle]
        return np.column_stack([self.rows[:, :3], *shape])

    def merged(self) -> Array:
        """As `packed`, where puffs that left together and still float at about one height are one, with the
        mean and the variance of their heights.
        """
        packed = self.packed()
        if len(packed) == 0:
            return packed
        apart = (np.diff(self.rows[:, [0, 1, 3]], axis=0) != 0.0).any(axis=1)
        first = np.flatnonzero(np.append(True, apart))
        group = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(packed))))
        weight = np.add.reduceat(packed[:, 5], first)
        mean = np.add.reduceat(packed[:, 5] * packed[:, 2], first) / weight
        variance = np.add.reduceat(packed[:, 5] * (packed[:, 2] - mean[group]) ** 2, first) / weight
        one = packed[first]
        spread = 0.5 / one[:, 4]
        is_close = variance <= CLOSE**2 * spread
        one[:, 2], one[:, 4] = mean, 0.5 / (spread + variance)
        one[:, 5] = weight * np.sqrt(spread / (spread + variance))
        return np.concatenate([one[is_close], packed[~is_close[group]]])
