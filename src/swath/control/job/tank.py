"""How full a combine's tank will be, by what its passes have brought for their area."""

from collections.abc import Sequence
from math import fsum, inf, isfinite, nan

from swath.control.job.passes import Pass, way_along
from swath.core.component import KeepsState
from swath.core.units import KMH
from swath.signals import MachineLoad

LEAST = 50.0  # m of a pass, from which what it brings is known
EMPTY = 0.004  # of the tank
MORE = 1.1  # of what passes bring, that those may that no cart can reach: yields differ


class TankForecast(KeepsState):
    """Of a combine that cuts passes in their order. full: share of the tank at which it stands"""

    kept = ("_before", "_yield", "_capacity")

    def __init__(self, passes: Sequence[Pass], full: float) -> None:
        self._passes, self._full = passes, full
        self._lengths = [way_along(work.line_m) for work in passes]
        self._areas = [way * work.width_m for way, work in zip(self._lengths, passes, strict=True)]
        self.reset()

    def reset(self) -> None:
        """Nothing is known."""
        self._before, self._yield, self._capacity = nan, 0.0, nan

    def update(self, load: MachineLoad, index: int, way: float) -> None:
        """So far along a pass [m]."""
        brought = load.tank_grain + load.unloaded_grain
        if not isfinite(self._before):
            self._before = brought
        if load.tank_level > EMPTY:
            self._capacity = load.tank_grain / load.tank_level
        if way > LEAST:
            self._yield = max(brought - self._before, 0.0) / (way * self._passes[index].width_m)

    def begin(self, load: MachineLoad) -> None:
        """A pass is over: what comes from now on is that of the next one."""
        self._before = load.tank_grain + load.unloaded_grain

    def is_too_full(self, load: MachineLoad, index: int, left: float = 0.0) -> bool:
        """Towards the end of a pass: whether the tank would be full in those to come that no cart can reach.

        left: of the present pass [m]
        """
        blind = self._blind(index + 1)
        return self._more(load, self._left(index, left) + blind if blind > 0.0 else 0.0) > self._full

    def is_full_in_next(self, load: MachineLoad, index: int, left: float) -> bool:
        """Whether the tank would be full before the end of the next pass. left: of the present one [m]"""
        area = self._left(index, left) + fsum(self._areas[index + 1 : index + 2])
        return self._more(load, area) > self._full

    def wants_cart(self, load: MachineLoad, index: int, left: float) -> bool:
        """Whether the tank would be full before the second pass from now that a cart can be beside: it has to
        be emptied in the first. left: of the present pass [m], < 0 behind it
        """
        first = index if left > 0.0 else index + 1
        while first < len(self._passes) and not self._passes[first].has_cart:
            first += 1
        if first >= len(self._passes):
            return False
        area = self._left(index, left) + fsum(self._areas[index + 1 : first + 1])
        return self._more(load, area + self._blind(first + 1)) > self._full

    def is_full_before_cart(self, load: MachineLoad, index: int, left: float) -> bool:
        """Whether the tank is full before it comes to a pass in which a cart can be poured into driving."""
        more = self._left(index, left)
        for work, area in zip(self._passes[index + 1 :], self._areas[index + 1 :], strict=True):
            if work.cart_beside:
                break
            more += area
        return self._more(load, more) > self._full

    def to_come(self, load: MachineLoad, index: int, left: float) -> float:
        """Grain in the tank and on what is left of this pass and the next, the last ones [kg]; nan before
        those, and where it is not known.
        """
        if self._yield <= 0.0 or index + 2 < len(self._passes):
            return nan
        return load.tank_grain + self._yield * (self._left(index, left) + fsum(self._areas[index + 1 :]))

    def stands_in(self, load: MachineLoad, index: int, left: float, turning: float) -> float:
        """When it stands for a cart if none comes before [s]: full, at the end of a pass behind which it
        would be full where no cart can be, or behind its last one; nan where it is not known. left: of the
        present pass [m], < 0 behind it; turning: speed between passes [m/s]
        """
        if not isfinite(self._capacity) or self._yield <= 0.0:
            return nan
        level, time, per_m2 = load.tank_level, 0.0, self._yield / self._capacity
        for k in range(index, len(self._passes)):
            work, is_now = self._passes[k], k == index
            brings = per_m2 * (self._left(index, left) if is_now else self._areas[k])
            takes = (max(left, 0.0) if is_now else self._lengths[k]) / (work.speed_kmh * KMH)
            if level >= self._full:
                return time
            if level + brings > self._full:
                return time + (self._full - level) / brings * takes
            level, time, blind = level + brings, time + takes, self._blind(k + 1)
            may_stand = work.has_cart and not (is_now and left < 0.0)
            if may_stand and blind > 0.0 and level + per_m2 * blind > self._full:
                return time
            time += max(work.turn_length + (min(left, 0.0) if is_now else 0.0), 0.0) / turning
        return time

    def _left(self, index: int, left: float) -> float:
        """Area of what is left of a pass, so many metres [m2]."""
        return max(left, 0.0) * self._passes[index].width_m

    def _blind(self, index: int) -> float:
        """Area of the passes from one on, to the next beside which a cart can be, and some more [m2]."""
        found = 0.0
        for work, area in zip(self._passes[index:], self._areas[index:], strict=True):
            if work.has_cart:
                break
            found += area
        return MORE * found

    def _more(self, load: MachineLoad, area: float) -> float:
        """Level of the tank after so many square metres."""
        if load.tank_level <= EMPTY:
            return -inf
        return load.tank_level * (1.0 + self._yield * area / load.tank_grain)
