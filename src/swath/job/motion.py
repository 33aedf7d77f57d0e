"""What a level of motion does for a job (`swath.job.engine.Job`)."""

from typing import Any, Protocol

from swath.job.path import Pose
from swath.job.states import CartState, CombineState


class Motion(Protocol):
    """How machines get from place to place."""

    def combine_way(self, job: Any, combine: CombineState) -> None:
        """A combine sets out to its task: sets `left` and `pace`."""

    def begin_cut(self, job: Any, combine: CombineState) -> None:
        """A combine puts its header down at the start of its task."""

    def combine_to(self, job: Any, combine: CombineState, goal: Pose) -> None:
        """A combine sets out to a place."""

    def cart_to_combine(self, job: Any, cart: CartState) -> None:
        """A cart sets out to its combine."""

    def cart_to_truck(self, job: Any, cart: CartState) -> None:
        """A cart sets out to the truck."""

    def move(self, job: Any) -> float:
        """Move all machines; returns the time that passed [s]. Sets what of each pass was cut in
        `job.cut_now`.
        """
