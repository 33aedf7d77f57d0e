"""A block: the rays of some decimetres of travel, counted by place beside the expected edge and by class.

Many rays together show an edge that no single scan shows: at 30 stems/m2 one ray in six is stopped.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.control.edge.canopy_classes import CLASSES, PLACES
from swath.control.edge.detector_rows import ANSWER, ROWS
from swath.core.component import State
from swath.signals import F64

ROOM = 20  # scans for which there is room at first, estimated


class Block:
    """Counts (PLACES, CLASSES) of rays beside a frame: see answer_rays.cpp, and blocks.cpp what they show.

    solid: of the same, echoes that were there a scan before; row, rays: as of `detector_rows`
    """

    def __init__(self, row: NDArray[Any] | None = None) -> None:
        self.row = np.zeros(1, ROWS["counted"]) if row is None else row
        self.rays = np.zeros(0, ANSWER)
        self.counts: F64 = np.zeros((PLACES, CLASSES))
        self.solid: F64 = np.zeros((PLACES, CLASSES))

    def clear(self) -> None:
        """No rays."""
        self.counts[:] = self.solid[:] = 0.0
        self.row[:] = 0

    def make_room(self, beams: int) -> bool:
        """Have room for one more scan of so many beams; whether its memory is another now."""
        held = self._held()
        is_short = held + beams > len(self.rays)
        if is_short:
            self.rays = np.concatenate([self.rays[:held], np.zeros(max(held, ROOM * beams), ANSWER)])
        return is_short

    def save(self) -> State:
        """Everything that is needed to go on exactly."""
        kept = {
            "row": self.row,
            "counts": self.counts,
            "solid": self.solid,
            "rays": self.rays[: self._held()],
        }
        return {name: own.copy() for name, own in kept.items()}

    def load(self, state: State) -> None:
        """Take on a state that `save` gave; its memory is another then."""
        for name in ("row", "counts", "solid"):
            getattr(self, name)[:] = state[name]
        self.rays = state["rays"].copy()

    def _held(self) -> int:
        return int(self.row["rays"][0])
