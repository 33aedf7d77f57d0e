"""Straw behind the machine: a swath, or chopped and spread, laid where the outlet passes."""

from collections.abc import Sequence
from math import atan2, fsum, hypot

from swath.core.component import KeepsState
from swath.field.field import Field
from swath.machine.sweep import Corners, line_ends, signed_area, swept


class StrawOutlet(KeepsState):
    """Lays straw over the ground that the outlet passed, every `step` [m] of travel.

    outlet_x: ahead of the fixed axle [m]; width [m]
    ridge: heaped along the path, otherwise even
    """

    kept = ("_ends", "_origin", "_loose")

    def __init__(self, ground: Field, outlet_x: float, width: float, step: float, *, ridge: bool) -> None:
        self._ground, self._step, self._ridge = ground, step, ridge
        self._outlet = (outlet_x, 0.5 * width, -0.5 * width)
        self._arm = 1.01 * hypot(outlet_x, 0.5 * width)
        self.reset()

    def reset(self) -> None:
        """Nothing loose; it starts where the first state finds the machine."""
        self._ends: Corners | None = None
        self._origin = (0.0, 0.0, 1.0, 0.0)
        self._loose = 0.0

    def drop(self, straw: float, pose: Sequence[float]) -> None:
        """Straw [kg] that left the machine since the last time; where it is now, as `plain` has a pose."""
        self._loose += straw
        before = self._ends
        if before is None:
            self._begin(line_ends(pose, *self._outlet), pose)
            return
        if self._is_near(pose):
            return
        ends = line_ends(pose, *self._outlet)
        ways = [(x - u, y - v) for (x, y), (u, v) in zip(ends, before, strict=True)]
        if max(hypot(*move) for move in ways) < self._step:
            return
        polygons = swept(before, ends)
        area = fsum(signed_area(p) for p in polygons)
        if area <= 0.0:
            return
        if self._loose > 0.0:
            (dx, dy), (more_x, more_y) = ways
            heading = atan2(dy + more_y, dx + more_x) if self._ridge else None
            for polygon in polygons:
                mass = self._loose * signed_area(polygon) / area
                self._ground.deposit_straw(polygon, mass, heading=heading)
            self._loose = 0.0
        self._begin(ends, pose)

    def _begin(self, ends: Corners, pose: Sequence[float]) -> None:
        self._ends = ends
        self._origin = pose[0], pose[1], pose[3], pose[6]

    def _is_near(self, pose: Sequence[float]) -> bool:
        """True when no end of the outlet can have moved by a step: a quick look before the exact one."""
        x0, y0, c0, s0 = self._origin  # and x, y of the forward axis
        return hypot(pose[0] - x0, pose[1] - y0) + self._arm * hypot(pose[3] - c0, pose[6] - s0) < self._step
