"""When a cart brings its grain to the truck, and which of several goes there first."""

from collections.abc import Mapping, Sequence
from math import dist

from swath.control.job.calls import Calls
from swath.control.job.carts import OtherCart, is_taken
from swath.control.job.ground import Point
from swath.control.turns.dubins import Place
from swath.signals import HeapState, PeerState

TURNS = 40.0  # m, that its way to the truck is longer than straight there, about


class ToTruck:
    """truck: place beside it [m]; number: of the cart; leave: of the largest heap, from which it is loaded;
    is_alone: without other carts
    """

    def __init__(self, truck: Point, number: int, leave: float, calls: Calls, *, is_alone: bool) -> None:
        self._truck, self._number, self._leave = truck, number, leave
        self._calls, self._is_alone = calls, is_alone

    def brings(self, heap: HeapState, combines: Mapping[int, PeerState], others: Sequence[OtherCart]) -> bool:
        """Whether the cart is loaded, or nobody needs it any more."""
        return self._calls.is_spare(combines.values(), others) or heap.level >= self._leave

    def leaves(self, heap: HeapState, combines: Mapping[int, PeerState], others: Sequence[OtherCart]) -> bool:
        """Nobody needs it; or loaded, without room for half a tank that waits, or, alone, for all to come."""
        is_spare = self._calls.is_spare(combines.values(), others)
        if is_spare or heap.level < self._leave:
            return is_spare and heap.grain > 0.0
        return not self._calls.has_room(heap, combines.values(), others, is_alone=self._is_alone)

    def is_first(self, here: Place, others: Sequence[OtherCart]) -> bool:
        """Whether the truck is free for a cart that has not set out to it."""
        return self._is_alone or not self.is_taken(dist(here[:2], self._truck) + TURNS, others)

    def is_taken(self, left: float, others: Sequence[OtherCart]) -> bool:
        """Whether another cart is there, or goes there first. left: of the own way there [m]"""
        return is_taken(self._truck, self._number, left, others)
