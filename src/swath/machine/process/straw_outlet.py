"""Straw behind machines: a swath, or chopped and spread, laid where the outlet passes."""

from collections.abc import Sequence
from math import hypot, isnan
from typing import Any, NamedTuple

import numpy as np

from swath.core.errors import SwathError
from swath.core.together import KeepsRows
from swath.field.field import Field
from swath.kernels import Repeated, filled, over_rows
from swath.machine.sweep import POLYGON, Corners, FieldTasks, OneWorld


class Outlet(NamedTuple):
    """Lays straw over the ground that it passed, every `step` [m] of travel.

    x: ahead of the fixed axle [m]; width [m]
    is_ridge: heaped along the path, otherwise even
    """

    ground: Field
    x: float
    width: float
    step: float
    is_ridge: bool


class Outlets(KeepsRows):
    """The outlets of many worlds. straw: that left them since the last time [kg]."""

    kept = ("_states",)

    def __init__(self, outlets: Sequence[Outlet]) -> None:
        n = len(outlets)
        self._fields, self.straw, self._states = [o.ground for o in outlets], np.zeros(n), np.zeros((n, 10))
        self._outlets = np.array([
            (o.x, 0.5 * o.width, -0.5 * o.width, o.step, 1.01 * hypot(o.x, 0.5 * o.width), o.is_ridge)
            for o in outlets
        ])  # fmt: skip

    def clear(self) -> None:
        """Nothing loose; they start where the first state finds the machine."""
        self._states[:] = 0.0

    def launches(self, needs: Any, *kernels: str, **given: Any) -> list[Repeated]:
        """Drop, lay, after which `lay_rest` may be needed.

        kernels: before them; given: `active`, `poses` and what these take, see `crop_kernel.Dropping`
        """
        from swath.machine import crop_kernel as kernel

        n = len(self._fields)
        polygons, found = np.zeros((n, 2, POLYGON)), np.zeros(n, np.int32)
        self._tasks = FieldTasks(self._fields, polygons, found, needs)
        own = {"straw": self.straw, "outlets": self._outlets, "states": self._states}
        its = filled(kernel.Dropping, polygons=polygons, found=found, **own, **given)
        each = [over_rows(n, getattr(kernel, name), its) for name in (*kernels, "drop_straw")]
        return [*each, self._tasks.launch("lay_straw")]

    def lay_rest(self) -> dict[int, SwathError]:
        """Lay what compiled code did not; by world why that is refused."""
        return self._tasks.rest(self._lay)

    def _lay(self, world: int, polygon: Corners, mass: float, heading: float) -> None:
        self._fields[world].deposit_straw(polygon, mass, heading=None if isnan(heading) else heading)


class StrawOutlet(OneWorld):
    """The outlet of one world, see `Outlet`."""

    def __init__(self, *outlet: Any) -> None:
        self._all, self._pose = Outlets([Outlet(*outlet)]), np.zeros((1, 12))
        super().__init__(self._all)
        given = {"active": np.ones(1, np.bool_), "poses": self._pose}
        self._launches = self._all.launches(np.zeros(1, np.int32), **given)

    def reset(self) -> None:
        """Nothing loose; it starts where the first state finds the machine."""
        self._all.clear()

    def drop(self, straw: float, pose: Sequence[float]) -> None:
        """Straw [kg] that left the machine since the last time; where it is now, as `plain` has a pose."""
        self._all.straw[0], self._pose[0] = straw, pose
        for launch in self._launches:
            launch.launch()
        for error in self._all.lay_rest().values():
            raise error
