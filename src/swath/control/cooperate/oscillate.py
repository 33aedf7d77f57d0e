"""Cooperate level `oscillate`: the stream sweeps along the box to and fro and levels the heap."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Gt, Le

from swath.control.cooperate.station import BoxView, Shared, StationKeeper
from swath.core.registry import Level
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params:
    """shift_m_s: speed of the sweep; keep: how the station is kept"""

    shift_m_s: Annotated[float, Gt(0), Le(1)] = 0.1
    keep: Shared = field(default_factory=Shared)


class Oscillate(StationKeeper):
    """A triangle in time between half a width from both ends. It turns where a place is full."""

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        super().__init__(params.keep, setup)
        self.params = params

    def aim(self, t: float, view: BoxView) -> tuple[float, bool]:
        """The place of now; full when no place within the sweep has room."""
        inner = view.reach
        there = [place for _, place in view.open_places()]
        way, since = self._memory.get("way", 1.0), t - self._memory.get("t", t)
        place = self._memory.get("place", 0.0) + way * self.params.shift_m_s * since
        place = min(max(place, -inner), inner)
        if abs(place) >= inner or not any((at - place) * way > 0.0 for at in there):
            way = -1.0 if any(at < place for at in there) else 1.0
        self._memory |= {"way": way, "place": place, "t": t}
        return place, not there


LEVEL = Level(
    Oscillate,
    Params,
    summary="sweeps along the box to and fro",
    cost="0.1 ms per step",
    tolerance="fills 95 % and more of the largest heap on the middle line (closed form)",
)
