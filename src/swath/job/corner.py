"""Corners of opening rounds for driven machines: timed, backwards, then set down on the next side.

The machine reverses as far as its turn begins behind the corner, where that ground is clear, and comes to the
next side when its time is over and nobody needs the ground there.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.job.combine_ways import axle_pose
from swath.job.driver import Driver
from swath.job.machines import REVERSE, Combine
from swath.job.path import Pose, ahead_of
from swath.job.states import DONE
from swath.job.traffic import is_free

Array = NDArray[np.float64]


@dataclass
class Corner:
    """time: left of it [s]; back: way that it still reverses [m]; goal: of its fixed axle; behind, ground:
    that it needs to reverse, and there, boxes; is_granted: it has that ground
    """

    time: float
    back: float
    goal: Pose
    behind: Array
    ground: Array
    is_granted: bool = False

    @property
    def is_over(self) -> bool:
        """True when the machine may be set down on the next side."""
        return self.is_granted and self.time <= DONE

    @property
    def wished(self) -> Array:
        """All ground that it needs."""
        return np.vstack([self.behind, self.ground])

    @property
    def reserved(self) -> Array:
        """Ground that it has."""
        return self.wished if self.is_granted else self.behind

    def ask(self, others: list[Array]) -> None:
        """For the ground on the next side, when the time is over."""
        self.is_granted = self.is_granted or (self.time <= DONE and is_free(self.ground, others))

    def held_by(self, others: Mapping[str, Array]) -> str:
        """Who holds ground on the next side; "" for nobody."""
        return next((n for n, o in others.items() if not is_free(self.ground, [o])), "")

    def step(self, driver: Driver, others: list[Array], dt: float) -> None:
        """Reverse for a time [s], where nobody is there: who comes behind drives along the other side."""
        machine, way = driver.machine, min(self.back, REVERSE * dt)
        machine.speed, self.time = 0.0, self.time - dt
        there = ahead_of(machine.pose, -way)
        if way > 0.0 and is_free(driver.footprint.sweep([(there, there.heading)]), others):
            machine.set_down(there, machine.trailer)
            self.back -= way


def corner_of(driver: Driver, combine: Combine, angle: float, start: Pose) -> Corner:
    """The corner before a side that starts at a pose. angle: of the corner [rad]"""
    back, goal = combine.corner_back(angle), axle_pose(start, combine.sheet.knife_x)
    behind, ground = (
        driver.footprint.sweep([(p, p.heading)]) for p in (ahead_of(driver.machine.pose, -back), goal)
    )
    return Corner(combine.corner_time(angle), back, goal, behind, ground)
