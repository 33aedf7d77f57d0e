"""Cooperate level `oscillate`: the stream sweeps to and fro and levels the heap, near the rim not."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.control.cooperate.station import BoxView, Shared, StationKeeper
from swath.core.registry import Level
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params:
    """shift_m_s: speed of the sweep; top_m: from that little freeboard on it fills up from front to rear
    keep: how the station is kept
    """

    shift_m_s: Annotated[float, Gt(0), Le(1)] = 0.1
    top_m: Annotated[float, Ge(0), Le(2)] = 0.3
    keep: Shared = field(default_factory=Shared)


class Oscillate(StationKeeper):
    """A triangle in time between half a width from both ends, until grain is near the rim."""

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        super().__init__(params.keep, setup)
        self.params = params

    def aim(self, t: float, view: BoxView) -> tuple[float, bool]:
        """The place of now; near the rim the first from the front with room."""
        if self.tops_up(view, self.params.top_m):
            return self.from_front(t, view)
        inner = view.reach
        way, since = self._memory.get("way", 1.0), t - self._memory.get("t", t)
        place = self._memory.get("place", 0.0) + way * self.params.shift_m_s * since
        place = min(max(place, -inner), inner)
        if abs(place) >= inner:
            way = -1.0 if place > 0.0 else 1.0
        self._memory |= {"way": way, "place": place, "t": t}
        return place, False


LEVEL = Level(
    Oscillate,
    Params,
    summary="sweeps along the box to and fro, near the rim from front to rear",
    cost="0.1 ms per step",
    tolerance="fills 95 % and more of the largest heap on the middle line (closed form)",
)
