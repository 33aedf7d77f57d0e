"""The heading of two antennas on one machine: the direction of their baseline, less how it is fitted."""

from collections.abc import Sequence
from math import atan2, cos, hypot, sin, sqrt

from swath.core.component import KeepsState
from swath.core.errors import InputError
from swath.core.portable import product
from swath.sensing.gnss.antenna import Antenna, Place
from swath.signals import MachineState

LEAST = 0.2  # baseline [m]


class TwoAntennas(KeepsState):
    """sd = s sqrt(2) / B: s of the relative position of one antenna across the baseline B [m]

    Level machine; where it leans, the direction of the baseline over ground counts, as receivers report it.
    """

    kept = ("_first",)

    def __init__(self, first: Place, second: Place, noise: float, reach: int) -> None:
        dx, dy = second.x_m - first.x_m, second.y_m - first.y_m
        self.baseline = hypot(dx, dy)
        if self.baseline < LEAST:
            expected = f"expected a place {LEAST:g} m or more from the antenna"
            raise InputError("second_antenna", f"({second.x_m:g}, {second.y_m:g})", expected)
        self.sd = noise * sqrt(2.0) / self.baseline
        self._fitted = atan2(dy, dx)
        self._first, self._second = Antenna(first, reach), Antenna(second).mounting.position

    def reset(self) -> None:
        """Forget where they were."""
        self._first.reset()

    def take(self, states: Sequence[MachineState]) -> None:
        """New states, oldest first."""
        self._first.take(states)

    def heading(self, t: int, draw: float) -> float:
        """Measured heading at t [rad]. draw: a standard normal number"""
        at, rotation = self._first.machine_at(t)
        a, b = (at + product(rotation, own) for own in (self._first.mounting.position, self._second))
        angle = atan2(float(b[1] - a[1]), float(b[0] - a[0])) - self._fitted + self.sd * draw
        return atan2(sin(angle), cos(angle))
