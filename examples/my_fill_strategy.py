"""A fill strategy of your own, in one file: copy it, change it, name it in a scenario.

    machines:
      cart:
        cooperate: {level: examples/my_fill_strategy.py:TwoSpots, hold_s: 60}

`StationKeeper` keeps the station beside the combine; a strategy says where in the box grain comes down. This
one fills two places in turn, each for `hold_s`, and is done when neither has room. Without `StationKeeper` a
class will do whose output `station` is a `Station`: `docs/explanation/cart.md`.
"""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Gt

from swath.control.cooperate.station import BoxView, Shared, StationKeeper
from swath.signals.setup import ControlSetup


class TwoSpots(StationKeeper):
    """Two places, a quarter of the length before and behind the middle."""

    @dataclass(frozen=True)
    class Params:
        """Keys of the scenario file: time at each place [s]."""

        hold_s: Annotated[float, Gt(0)] = 30.0

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        super().__init__(Shared(), setup)
        self.params = params

    def aim(self, t: float, view: BoxView) -> tuple[float, bool]:
        """Where now [m ahead of the middle], and whether the box is full."""
        spots = [0.5 * view.half, -0.5 * view.half]
        turn = int(t // self.params.hold_s) % 2
        there = [spot for spot in (spots[turn], spots[1 - turn]) if view.has_room(spot)]
        return (there[0] if there else spots[turn]), not there
