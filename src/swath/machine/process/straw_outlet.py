"""Straw behind the machine: a swath, or chopped and spread, laid where the outlet passes."""

from math import atan2, fsum, hypot

from swath.core.component import KeepsState
from swath.core.together import plain
from swath.field.field import Field
from swath.machine.sweep import Corners, line_ends, signed_area, swept
from swath.signals import MachineState


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

    def drop(self, straw: float, state: MachineState) -> None:
        """Straw [kg] that left the machine since the last time, and where the machine is now."""
        self._loose += straw
        before = self._ends
        if before is None:
            self._begin(line_ends(plain(state.pose), *self._outlet), state)
            return
        if self._is_near(state):
            return
        ends = line_ends(plain(state.pose), *self._outlet)
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
        self._begin(ends, state)

    def _begin(self, ends: Corners, state: MachineState) -> None:
        self._ends = ends
        self._origin = _stance(state)

    def _is_near(self, state: MachineState) -> bool:
        """True when no end of the outlet can have moved by a step: a quick look before the exact one."""
        x, y, c, s = _stance(state)
        x0, y0, c0, s0 = self._origin
        return hypot(x - x0, y - y0) + self._arm * hypot(c - c0, s - s0) < self._step


def _stance(state: MachineState) -> tuple[float, float, float, float]:
    """x, y [m], and x, y of the forward axis."""
    (x, y, _), ((c, _, _), (s, _, _), _) = state.pose.numbers
    return x, y, c, s
