"""How full a combine's tank will be, by what its passes have brought per metre."""

from collections.abc import Sequence
from math import fsum, inf, isfinite, nan

from swath.control.job.passes import Pass, way_along
from swath.core.component import KeepsState
from swath.signals import MachineLoad

LEAST = 50.0  # m of a pass, from which what it brings is known
EMPTY = 0.004  # of the tank


class TankForecast(KeepsState):
    """Of a combine that cuts passes in their order. full: share of the tank at which it stands"""

    kept = ("_before", "_per_metre")

    def __init__(self, passes: Sequence[Pass], full: float) -> None:
        self._passes, self._full = passes, full
        self._lengths = [way_along(work.line_m) for work in passes]
        self.reset()

    def reset(self) -> None:
        """Nothing is known."""
        self._before, self._per_metre = nan, 0.0

    def update(self, load: MachineLoad, way: float) -> None:
        """So far along a pass [m]."""
        brought = load.tank_grain + load.unloaded_grain
        if not isfinite(self._before):
            self._before = brought
        if way > LEAST:
            self._per_metre = max(brought - self._before, 0.0) / way

    def begin(self, load: MachineLoad) -> None:
        """A pass is over: what comes from now on is that of the next one."""
        self._before = load.tank_grain + load.unloaded_grain

    def is_too_full(self, load: MachineLoad, index: int) -> bool:
        """At the end of a pass: whether the tank would be full in those to come that no cart can reach."""
        return self._more(load, self._blind(index + 1)) > self._full

    def wants_cart(self, load: MachineLoad, index: int, left: float) -> bool:
        """Whether the tank would be full before the second pass from now that a cart can be beside: it has to
        be emptied in the first. left: of the present pass [m], < 0 behind it
        """
        first = index if left > 0.0 else index + 1
        while first < len(self._passes) and not self._passes[first].has_cart:
            first += 1
        if first >= len(self._passes):
            return False
        way = max(left, 0.0) + fsum(self._lengths[index + 1 : first + 1])
        return self._more(load, way + self._blind(first + 1)) > self._full

    def is_full_before_cart(self, load: MachineLoad, index: int, left: float) -> bool:
        """Whether the tank is full before it comes to a pass in which a cart can be poured into driving."""
        way = max(left, 0.0)
        for work, length in zip(self._passes[index + 1 :], self._lengths[index + 1 :], strict=True):
            if work.cart_beside:
                break
            way += length
        return self._more(load, way) > self._full

    def _blind(self, index: int) -> float:
        """Length of the passes from one on, to the next beside which a cart can be [m]."""
        way = 0.0
        for work, length in zip(self._passes[index:], self._lengths[index:], strict=True):
            if work.has_cart:
                return way
            way += length
        return way

    def _more(self, load: MachineLoad, way: float) -> float:
        """Level of the tank after so many metres."""
        if load.tank_level <= EMPTY:
            return -inf
        return load.tank_level * (1.0 + self._per_metre * way / load.tank_grain)
