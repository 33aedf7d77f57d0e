"""The attitude of two antennas on one machine: the direction of their baseline, less how it is fitted."""

from collections.abc import Sequence
from math import asin, atan2, cos, hypot, sin, sqrt

from swath.core.component import KeepsState
from swath.core.errors import InputError
from swath.core.portable import product
from swath.sensing.gnss.antenna import Antenna, Place
from swath.signals import MachineState

LEAST = 0.2  # baseline [m]


class TwoAntennas(KeepsState):
    """sd = s sqrt(2) / B: s of the relative position of one antenna across the baseline B [m]

    The direction of the baseline over ground is the heading, as receivers report it; its tilt is the roll
    where it lies within 45 deg of across the machine, else the pitch.
    """

    kept = ("_first",)

    def __init__(self, first: Place, second: Place, noise: float, reach: int) -> None:
        dx, dy, dz = second.x_m - first.x_m, second.y_m - first.y_m, second.z_m - first.z_m
        self.baseline = hypot(dx, dy)
        if self.baseline < LEAST:
            expected = f"expected a place {LEAST:g} m or more from the antenna"
            raise InputError("second_antenna", f"({second.x_m:g}, {second.y_m:g})", expected)
        self.sd = noise * sqrt(2.0) / self.baseline
        self._fitted, self._rise = atan2(dy, dx), atan2(dz, self.baseline)
        self._is_across = abs(dy) >= abs(dx)
        self._up = (1.0 if dy > 0.0 else -1.0) if self._is_across else (-1.0 if dx > 0.0 else 1.0)
        self._first, self._second = Antenna(first, reach), Antenna(second).mounting.position

    def reset(self) -> None:
        """Forget where they were."""
        self._first.reset()

    def take(self, states: Sequence[MachineState]) -> None:
        """New states, oldest first."""
        self._first.take(states)

    def seen(self, t: int, draws: Sequence[float] = (0.0, 0.0), vertical: float = 1.0) -> dict[str, float]:
        """Fields of a Fix measured at t: heading, its sd, and roll or pitch [rad].

        draws: two standard normal numbers; vertical: errors of the height over those of east and north
        """
        at, rotation = self._first.machine_at(t)
        a, b = (at + product(rotation, own) for own in (self._first.mounting.position, self._second))
        x, y, z = (float(v) for v in b - a)
        turned = atan2(y, x) - self._fitted + self.sd * draws[0]
        tilt = asin(z / sqrt(x * x + y * y + z * z)) - self._rise + vertical * self.sd * draws[1]
        name = "roll" if self._is_across else "pitch"
        return {"heading": atan2(sin(turned), cos(turned)), "heading_sd": self.sd, name: self._up * tilt}
