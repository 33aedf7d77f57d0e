"""What the header's controller knows before its feelers do: its own commands, and the machine's turning.

A Smith predictor (O. J. M. Smith 1957, Chemical Engineering Progress 53): what the cylinders have done since
the feelers looked, and will do from commands under way, is added to the reading; the loop then is one
without delay. To that comes how far the machine rolls and pitches over the same time at its present rates.
"""

from math import exp

import numpy as np

from swath.core.component import KeepsState
from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.machine.header.hydraulics import Cylinder, Delayed

GYRO_LAG = 0.03  # smoothing of the rates of roll and pitch [s], estimate


class Predictor(KeepsState):
    """feeler_lag, valve_lag [s]; feeler_delay, dead_time [ns]; knife_x: ahead of the fixed axle [m]"""

    kept = ("_own", "_axes", "_rates")

    def __init__(
        self, feeler_lag: float, feeler_delay: int, valve_lag: float, dead_time: int, knife_x: float
    ) -> None:
        self._own = Delayed(np.zeros(2), feeler_lag, feeler_delay)
        self._coming = dead_time + round(valve_lag * NS)
        self._time = feeler_lag + (feeler_delay + self._coming) / NS
        self._x = knife_x
        self._axes: tuple[float, float] | None = None
        self._rates = (0.0, 0.0)

    def look(self, t: int, dt: int, lift: Cylinder, tilt: Cylinder, pose: Pose) -> tuple[float, float]:
        """By how much the knife will be higher [m], its left side more up [rad], than the feelers say."""
        seen = self._own.read(t, dt, np.array([lift.place, tilt.place]))
        rise, lean = self._turning(dt, pose)
        up = lift.later(t, self._coming) - float(seen[0]) + self._time * self._x * rise
        return up, tilt.later(t, self._coming) - float(seen[1]) + self._time * lean

    def _turning(self, dt: int, pose: Pose) -> tuple[float, float]:
        """Rates [1/s] at which the forward and the left axis rise, as an ideal gyro shows them, smoothed."""
        now = float(pose.rotation[2, 0]), float(pose.rotation[2, 1])
        before = now if self._axes is None else self._axes
        self._axes, kept = now, exp(-dt / NS / GYRO_LAG)
        new = ((a - b) * NS / dt for a, b in zip(now, before, strict=True))
        first, second = (n + (r - n) * kept for n, r in zip(new, self._rates, strict=True))
        self._rates = first, second
        return self._rates
