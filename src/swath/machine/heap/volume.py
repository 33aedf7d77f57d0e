"""Heap level `volume`: how much is in the box, as if it were raked level all the time."""

from typing import Any

from swath.core.registry import Level
from swath.field.grain import GrainReceiver
from swath.machine.heap.open_box import Heap, Params


class Volume(Heap):
    """A level surface; what is above the largest heap runs over."""

    cell = 100.0

    def pour(self, mass: float, x: float, y: float, ground: GrainReceiver, pose: Any) -> float:
        """Take grain [kg]; returns what stays, all of it up to the largest heap."""
        room = max(self.largest * self.density - self.grain, 0.0)
        kept = min(mass, room)
        self._caught.add(kept)
        self._surface.level(self.grain / self.density)
        if mass > kept:
            self._spilled.add(mass - kept)
            ground.receive(mass - kept, pose.apply([self.box.x, 0.6 * self.box.width, 0.0]))
        return kept


LEVEL = Level(
    Volume,
    Params,
    summary="the mass alone, level; full at the largest heap that fits on the rim",
    cost="none",
    tolerance="mass exact; holds up to 30 % more than one spot of height_map",
)
