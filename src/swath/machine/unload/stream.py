"""Grain in the air: ballistic flight of what leaves a pipe, and where it comes down."""

from dataclasses import dataclass
from math import fsum, sqrt

import numpy as np

from swath.core.component import KeepsState
from swath.field.site_setup import Landing
from swath.machine.tyre import GRAVITY
from swath.signals import F64

DRAG = 0.2  # how fast a dense stream takes on the speed of the air [1/s], an estimate
SHARE = 1.0 / 6.0  # of each of four points at sqrt(3) sd; with the middle they have the spread's variance


@dataclass(frozen=True)
class Parcel:
    """Grain that left the mouth together. t: then [s]; mass [kg]; place, speed: then, world (3,)"""

    t: float
    mass: float
    place: F64
    speed: F64


class Stream(KeepsState):
    """Parcels in flight. spread: of where a parcel comes down, 1 sigma [m]; wind: world (3,) [m/s]"""

    kept = ("_parcels",)

    def __init__(self, landing: Landing, spread: float, wind: F64) -> None:
        self._landing, self._spread, self._wind = landing, spread, wind
        self._parcels: list[Parcel] = []

    def clear(self) -> None:
        """Nothing in the air."""
        self._parcels = []

    def add(self, parcel: Parcel) -> None:
        """It leaves the mouth."""
        self._parcels.append(parcel)

    @property
    def mass(self) -> float:
        """In the air [kg]."""
        return fsum(p.mass for p in self._parcels)

    def fly(self, t: float) -> tuple[float, float]:
        """Up to a time [s]: masses that came down and stayed in a box, and that came down elsewhere [kg]."""
        caught = missed = 0.0
        flying = []
        for parcel in self._parcels:
            place = self._down(parcel, t)
            if place is None:
                flying.append(parcel)
                continue
            kept = fsum(self._landing.land(m, p) for m, p in self._points(parcel.mass, place))
            caught, missed = caught + kept, missed + parcel.mass - kept
        self._parcels = flying
        return caught, missed

    def _down(self, parcel: Parcel, t: float) -> F64 | None:
        """Where it has come down by a time, None while it flies."""
        age = t - parcel.t
        place = self._at(parcel, age)
        under = self._under(place)
        if place[2] > under:
            return None
        drop = parcel.place[2] - under
        return self._at(parcel, min(age, fall_time(float(drop), float(-parcel.speed[2]))))

    def _at(self, parcel: Parcel, age: float) -> F64:
        pull = DRAG * (self._wind - parcel.speed)
        pull[2] = -GRAVITY
        place: F64 = parcel.place + parcel.speed * age + 0.5 * pull * age**2
        return place

    def _under(self, place: F64) -> float:
        """Height of the grain or the ground below a point [m]."""
        found = self._landing.bodies.box_under(place)
        if found is None:
            return float(self._landing.field.ground_height(place[0], place[1]))
        name, x, y = found
        bodies = self._landing.bodies
        return float(bodies.pose_of(name).position[2]) + bodies.boxes[name].surface_at(x, y)

    def _points(self, mass: float, place: F64) -> list[tuple[float, F64]]:
        if self._spread <= 0.0:
            return [(mass, place)]
        far = sqrt(3.0) * self._spread
        around = [(far, 0.0), (-far, 0.0), (0.0, far), (0.0, -far)]
        aside = [(SHARE * mass, place + np.array([x, y, 0.0])) for x, y in around]
        return [(mass - 4.0 * (SHARE * mass), place), *aside]


def fall_time(drop: float, down: float) -> float:
    """Time [s] to fall so far [m], the speed downward at the start given [m/s]."""
    return (sqrt(max(down * down + 2.0 * GRAVITY * drop, 0.0)) - down) / GRAVITY
