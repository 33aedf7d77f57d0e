"""Straw behind the machine: a swath, or chopped and spread, laid where the outlet passes."""

from math import atan2
from typing import Any, Protocol

import numpy as np

from swath.core.component import State
from swath.core.frames import Array
from swath.core.signals import MachineState
from swath.machine.sweep import line_ends, signed_area, swept


class StrawGround(Protocol):
    """The part of a field that takes straw."""

    def deposit_straw(self, polygon: Array, mass: float, /, *, heading: float | None = None) -> Any:
        """Lay straw [kg] over a convex polygon (n, 2) [m], as a ridge along a heading [rad]."""
        ...


class StrawOutlet:
    """Lays straw over the ground that the outlet passed, every `step` [m] of way.

    outlet_x: ahead of the fixed axle [m]; width [m]; ridge: heaped along the way, otherwise even
    """

    def __init__(
        self, ground: StrawGround, outlet_x: float, width: float, step: float, *, ridge: bool
    ) -> None:
        self._ground, self._step, self._ridge = ground, step, ridge
        self._outlet = (outlet_x, 0.5 * width, -0.5 * width)
        self.reset()

    def reset(self) -> None:
        """Nothing loose; it starts where the first state finds the machine."""
        self._ends: Array | None = None
        self._loose = 0.0

    def drop(self, straw: float, state: MachineState) -> None:
        """Straw [kg] that left the machine since the last time, and where the machine is now."""
        self._loose += straw
        ends = line_ends(state.pose, *self._outlet)
        if self._ends is None:
            self._ends = ends
        if float(np.hypot(*(ends - self._ends).T).max()) < self._step:
            return
        polygons = swept(self._ends, ends)
        area = sum(signed_area(p) for p in polygons)
        if area <= 0.0:
            return
        if self._loose > 0.0:
            dx, dy = (ends - self._ends).sum(axis=0).tolist()
            heading = atan2(dy, dx) if self._ridge else None
            for polygon in polygons:
                mass = self._loose * signed_area(polygon) / area
                self._ground.deposit_straw(polygon, mass, heading=heading)
            self._loose = 0.0
        self._ends = ends

    def save(self) -> State:
        """The open end of the swath."""
        return {"ends": None if self._ends is None else self._ends.copy(), "loose": self._loose}

    def load(self, state: State) -> None:
        """Back to a saved moment."""
        self._ends = None if state["ends"] is None else np.array(state["ends"])
        self._loose = state["loose"]
