"""Cooperate level `front_to_back`: from the front end of the box to its rear, each place until it is full."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Gt, Le

from swath.control.cooperate.station import BoxView, Shared, StationKeeper
from swath.core.registry import Level
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params:
    """Fill the box from front to back.

    shift_m_s: how fast the cart moves on along the stream
    keep: how the station beside the other machine is kept
    """

    shift_m_s: Annotated[float, Gt(0), Le(1)] = 0.1
    keep: Shared = field(default_factory=Shared)


class FrontToBack(StationKeeper):
    """Moves on while there is no room under the stream. It needs the profile of the grain."""

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        super().__init__(params.keep, setup)
        self.params = params

    def aim(self, t: float, view: BoxView) -> tuple[float, bool]:
        """The first place from the front with room; one that was left is not gone back to."""
        return self.from_front(t, view, self.params.shift_m_s)


LEVEL = Level(
    FrontToBack,
    Params,
    summary="moves on from front to rear as the grain reaches the rim",
    cost="0.1 ms per step",
    tolerance="fills 95 % and more of the largest heap on the middle line (closed form)",
)
