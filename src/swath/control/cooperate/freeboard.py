"""How much room there is at the walls of a box, smoothed, and how fast it goes.

An alpha-beta filter of critical damping and time constant T for each place along the box: with the residual
r = measured - x, x' = v + 2 r / T and v' = r / T^2.
"""

import numpy as np

from swath.core.component import KeepsState
from swath.signals import F64

SMOOTHED = 1.0  # time constant [s]
JUMP = 0.15  # a change by more is another look at the box, not grain that rose [m]


class FreeboardTrack(KeepsState):
    """Smoothed freeboard of every place, rear to front [m], and its rate [m/s]."""

    kept = ("_free", "_rate")

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Nothing known."""
        self._free: F64 | None = None
        self._rate: F64 | None = None

    def update(self, measured: F64, h: float) -> None:
        """A step of h [s] passed. measured: of now, rear to front (station,) [m]."""
        if self._free is None or self._rate is None or len(self._free) != len(measured):
            self._free, self._rate = measured.copy(), np.zeros(len(measured))
            return
        ahead = self._free + self._rate * h
        rest, share = measured - ahead, min(h / SMOOTHED, 0.5)
        jumps = np.abs(rest) > JUMP
        self._free = np.where(jumps, measured, ahead + 2.0 * share * rest)
        self._rate = np.where(jumps, 0.0, self._rate + share / SMOOTHED * rest)

    def after(self, seconds: float) -> F64:
        """What is left in so many seconds if grain keeps rising as it does now [m]."""
        assert self._free is not None
        assert self._rate is not None
        return self._free + np.minimum(self._rate, 0.0) * seconds
