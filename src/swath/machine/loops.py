"""The drive as its closed loop (hydrostat under a governor): first order with limited acceleration."""

from math import isfinite
from typing import NamedTuple

import numpy as np

from swath.core.errors import InputError
from swath.kernels import Rows, repeatable, shared
from swath.machine.machine_sheet import Dynamics
from swath.signals import EngineState


class Loop(NamedTuple):
    """Numbers of `drive_kernel.Loop`."""

    lag: float
    accel: float
    decel: float
    fastest: float


def loop_of(d: Dynamics) -> Loop:
    """The loop of a machine."""
    return Loop(d.speed_lag, d.accel, d.decel, d.max_speed)


class SpeedLoop:
    """A loop, compiled; where it ends does not depend on the steps it is taken in."""

    def __init__(self, dynamics: Dynamics) -> None:
        from swath.machine import drive_kernel as kernel

        self._asked = np.zeros(5)
        given = [Rows(kernel.Loop, 1, [loop_of(dynamics)]).array, shared(self._asked)]
        self._follow = repeatable(kernel.follow_wanted, given).launch

    def advance(self, speed: float, wanted: float, dt: float) -> tuple[float, float]:
        """(speed after dt [s], distance in it [m]); speeds [m/s], < 0 backwards. Slowing uses `decel`."""
        self._asked[:3] = speed, wanted, dt
        self._follow()
        _, _, _, reached, way = self._asked.tolist()
        return reached, way


def within_drive(wanted: float, drive: EngineState | None) -> float:
    """A wanted speed [m/s], at most what the drive can give; without a powertrain unchanged.

    InputError where it is not finite.
    """
    wanted = wanted if drive is None else min(max(wanted, -drive.speed_limit), drive.speed_limit)
    if not isfinite(wanted):
        raise InputError("speed command", wanted, "expected a finite speed")
    return wanted
