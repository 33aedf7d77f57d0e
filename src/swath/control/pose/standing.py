"""Whether a machine stands, by its wheels: then it does not turn, and a gyroscope reads its bias."""

from math import cos, hypot, sin

from swath.core.component import KeepsState
from swath.core.schedule import NS
from swath.signals import Fix

MEAN_S = 1.0  # s, over which the wheels' speed is averaged: 3 mm/s are left of 3 cm/s at 50 Hz
STILL = 0.02  # m/s: mean speed below which a machine stands, estimate
AT_ONCE = 0.1  # m/s: a sample above it ends the stand


class Standing(KeepsState):
    """Follows the speed of the wheels. mean: over about `MEAN_S` [m/s], None before the first sample."""

    kept = ("mean",)

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Nothing known."""
        self.mean: float | None = None

    def take(self, speed: float, seconds: float) -> bool:
        """Whether it stands. speed: measured [m/s]; seconds: since the last one."""
        if self.mean is None:
            self.mean = speed
        self.mean += min(max(seconds, 0.0) / MEAN_S, 1.0) * (speed - self.mean)
        return abs(self.mean) < STILL and abs(speed) < AT_ONCE


class GroundVelocity(KeepsState):
    """The receiver's velocity, averaged as the wheels' speed is: a creep is more than the noise of a fix.

    share: of the variance of a fix that is left in the mean
    """

    kept = ("share", "_east", "_north", "_t")

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Nothing known."""
        self.share, self._east, self._north, self._t = 1.0, 0.0, 0.0, -1

    def take(self, fix: Fix) -> float:
        """Mean speed over ground [m/s], of a fix with a velocity."""
        seconds = (fix.t - self._t) / NS if self._t >= 0 else MEAN_S
        part = min(seconds / MEAN_S, 1.0)
        self.share = part**2 + (1.0 - part) ** 2 * self.share
        self._t = fix.t
        self._east += part * (fix.speed * cos(fix.course) - self._east)
        self._north += part * (fix.speed * sin(fix.course) - self._north)
        return hypot(self._east, self._north)
