"""Parts that look in Python at few states of machines alone, which compiled code finds for them."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swath.compiled import Compiled
from swath.core.blocks import Blocks
from swath.core.rows import Row
from swath.signals import MachineState


class Waking(Compiled):
    """One part in each world. asks: whose a launch wants to look; blocks: what was sent since a look."""

    reads: ClassVar = {"state": MachineState}
    blocks: Blocks

    def __init__(self, parts: Sequence[Any]) -> None:
        super().__init__(len(parts), {})
        self.parts, self.asks = parts, np.zeros(len(parts), np.int32)

    def supply(self, stage: int) -> None:
        """Have them look."""
        for world in self.asks.nonzero()[0].tolist():
            self.wake(world)

    @abstractmethod
    def wake(self, world: int) -> None:
        """Have one look at the newest state."""

    def look(self) -> None:
        """Tell all of them what was found meanwhile."""


def times_of(row: Row) -> NDArray[np.int64]:
    """Times of the samples of a row [ns], of each world or one for all."""
    found: NDArray[np.int64] = row.memory["t"] if row.is_held else row.stamp
    return found
