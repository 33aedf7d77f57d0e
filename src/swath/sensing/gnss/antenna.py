"""The antenna of a receiver on its machine: where it is and how fast, from the machine's true states.

Two antennas on one machine give its attitude: the direction of their baseline, less how it is fitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import asin, atan2, hypot, sqrt
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.component import KeepsState
from swath.core.errors import InputError
from swath.core.frames import Pose, wrapped
from swath.core.portable import product
from swath.core.schedule import NS
from swath.field.site_setup import SiteSetup
from swath.sensing.mount import poses_at
from swath.signals import F64, FIX_QUALITIES, Fix, MachineState

WINDOW = 20_000_000  # a velocity is the mean over this long before its time [ns]
COURSE_ABOVE = 0.1  # below this speed there is no course [m/s]
NAN = float("nan")


@dataclass(frozen=True)
class Place:
    """Place of an antenna on its machine.

    x_m: ahead of the fixed axle
    y_m: leftward
    z_m: above ground
    """

    x_m: Annotated[float, Ge(-30), Le(30)] = 1.0
    y_m: Annotated[float, Ge(-30), Le(30)] = 0.0
    z_m: Annotated[float, Gt(0), Le(30)] = 3.9


class Antenna(KeepsState):
    """Path of an antenna. mounting: pose_machine_sensor; reach: how far back it is asked for [ns]."""

    kept = ("_states",)

    def __init__(self, place: Place, reach: int = 0) -> None:
        self.mounting = Pose.from_euler((place.x_m, place.y_m, place.z_m))
        self._reach = reach + WINDOW
        self._states: list[MachineState] = []

    def reset(self) -> None:
        """Forget where it was."""
        self._states = []

    def take(self, states: Sequence[MachineState]) -> None:
        """New states, oldest first; those out of reach are dropped."""
        self._states += states
        if not self._states:
            return
        last = self._states[-1].t - self._reach
        while len(self._states) > 2 and self._states[1].t <= last:
            del self._states[0]

    def machine_at(self, t: int) -> tuple[F64, F64]:
        """World position [m], (3,), and rotation, (3, 3), of its machine at t [ns]."""
        position, rotation = poses_at(self._states, np.array([t], dtype=float))
        return position[0], rotation[0]

    def at(self, t: int) -> tuple[F64, F64]:
        """World position [m] and mean velocity over the `WINDOW` before t [m/s], (3,) each.

        Between states poses are linear; velocity by the difference of two positions. The first position known
        holds for any time before it, its velocity is that of the first `WINDOW` after it.
        """
        end = max(t, self._states[0].t + WINDOW)
        times = np.array([t, end - WINDOW, end], dtype=float)
        position, rotation = poses_at(self._states, times)
        place = position + product(rotation, self.mounting.position)
        return place[0], (place[2] - place[1]) * (NS / WINDOW)


def fix_of(
    t: int,
    setup: SiteSetup,
    position: F64,
    velocity: F64,
    sd: tuple[float, float, float],
    quality: int,
    **more: Any,
) -> Fix:
    """A sample from a position [m] and velocity [m/s], (3,) each.

    sd: as in Fix, in its order
    more: its fields from `heading` on
    """
    x, y, z = (float(v) for v in position)
    speed = float(np.hypot(velocity[0], velocity[1]))
    course = atan2(velocity[1], velocity[0]) if speed >= COURSE_ABOVE else NAN
    if setup.origin is None:
        return Fix(t, x, y, z, speed, course, *sd, quality, **more)
    longitude, latitude = np.radians(setup.origin.to_lon_lat([[x, y]])[0])
    place = float(longitude), float(latitude), float(setup.origin.height + z)
    return Fix(t, x, y, z, speed, course, *sd, quality, *place, **more)


def no_fix(t: int) -> Fix:
    """Nothing received."""
    return Fix(t, NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN, FIX_QUALITIES.index("none"))


LEAST = 0.2  # baseline [m]


class TwoAntennas(KeepsState):
    """sd = s sqrt(2) / B: s of the relative position of one antenna across the baseline B [m].

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
        return {"heading": wrapped(turned), "heading_sd": self.sd, name: self._up * tilt}
