"""Cooperate level `by_profile`: to where the measured profile is lowest, near the rim from front to rear."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.control.cooperate.station import BoxView, Shared, StationKeeper
from swath.core.registry import Level
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params:
    """Fill the box where it is lowest.

    shift_m_s: how fast the cart moves along the stream
    better_m: how much lower the grain must be elsewhere before the cart goes there
    top_m: freeboard from which on the box is filled up from front to rear
    keep: how the station beside the other machine is kept
    """

    shift_m_s: Annotated[float, Gt(0), Le(1)] = 0.15
    better_m: Annotated[float, Ge(0), Le(2)] = 0.2
    top_m: Annotated[float, Ge(0), Le(2)] = 0.3
    keep: Shared = field(default_factory=Shared)


class ByProfile(StationKeeper):
    """Goes towards the lowest place, until grain is near the rim."""

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        super().__init__(params.keep, setup)
        self.params = params

    def aim(self, t: float, view: BoxView) -> tuple[float, bool]:
        """The place of now; near the rim the first from the front with room."""
        if self.tops_up(view, self.params.top_m):
            return self.from_front(t, view)
        there = view.open_places()
        place, since = self._memory.get("place", 0.0), t - self._memory.get("t", t)
        goal = self._memory.get("goal", 0.0)
        if there:
            lowest, best = min(there)
            here = [high for high, at in there if abs(at - goal) < 0.3]
            if not here or lowest < min(here) - self.params.better_m:
                goal = best
        step = self.params.shift_m_s * since
        place += min(max(goal - place, -step), step)
        self._memory |= {"goal": goal, "place": place, "t": t}
        return place, not there


LEVEL = Level(
    ByProfile,
    Params,
    summary="goes to where the measured profile is lowest, near the rim from front to rear",
    cost="0.1 ms per step",
    tolerance="fills 95 % and more of the largest heap on the middle line (closed form)",
)
