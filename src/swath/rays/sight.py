"""Pages that beams can get to: nothing else of a field has to be in memory for a scan."""

from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.field import FAR, Field
from swath.field.memory_layout import STEM_REACH
from swath.kernels import address, repeatable, shared

F64 = NDArray[np.float64]
MANY = 4096  # beams that look to all sides, near enough: the pages around are cheaper to tell
ROOM = 256  # pages found missing in one walk; what does not fit is found by the next
SQRT_3 = sqrt(3.0)  # length of a vector over the largest of its three parts, at most
MOVED, TURNED = 0.4, 0.01  # beams may move [m] and turn so far before they are walked along again
# Of the integers of sight.cpp: pages that had left memory when beams were walked along last, -1 = they were
# not; pages missing, -1 = all pages around are to be brought in; walks so far; how many numbers there are.
DROPPED_THEN, MISSING, WALKS, NUMBERS = 16, 17, 18, 19


class Sight:
    """What a sensor sees of a field. reach [m]: its beams end there.

    exit_diameter [m], divergence [rad, full angle]: what belongs to a beam lies within exit + divergence *
        range around it. A beam ends where all of it is below the lowest ground of the pages around. Tiles
        from which stems can lean into it belong to it, so that what a scan sees does not depend on other
        pages. Of very many beams all pages within the reach are taken.

    Pages are brought in for all beams that start within MOVED and point within TURNED of the given ones: the
    next scans of a machine need no look.

    whole, real: the numbers of sight.cpp, with which compiled code goes on while nothing moves in memory
    """

    def __init__(self, field: Field, *, reach: float, exit_diameter: float, divergence: float) -> None:
        self.field, self.reach, self._spot = field, reach, (0.5 * exit_diameter, 0.5 * divergence)
        self.whole = np.zeros(NUMBERS, np.int64)
        self._missing = np.zeros((ROOM, 2), np.int64)
        self._seen = np.zeros(0, np.uint8)
        self._covered = np.zeros((2, 0, 3))  # beams that were walked along last: origins, directions
        self._launch: Any = None

    @cached_property
    def real(self) -> F64:
        """The real numbers of sight.cpp."""
        yaw, wide = self.field.stand_yaw, (self._spot[0] + MOVED, self._spot[1] + TURNED)
        near = MOVED / SQRT_3, TURNED / SQRT_3
        return np.array(
            [self.field.library.tile_size, np.cos(yaw), np.sin(yaw), self.reach, *wide, FAR, *near]
        )

    def ensure(self, origins: F64, directions: F64) -> None:
        """Bring the pages of beams into memory. origins, directions (unit): (n, 3), contiguous, world [m]."""
        store, count = self.field.store, len(origins)
        while count and (missing := self._find(origins, directions)) != 0:
            if missing < 0:
                self._ensure_around(*origins[count // 2, :2].tolist())
                return
            slots = {slot: key for key, slot in store.keys.items()}
            seen = [slots[slot] for slot in np.flatnonzero(self._seen).tolist()]
            store.need([*seen, *((i, j) for i, j in self._missing[:missing].tolist())])

    def _ensure_around(self, x: float, y: float) -> None:
        """Every page within the reach and what can lean into it."""
        store, known = self.field.store, -1
        while known < (stems := int(store.counters[STEM_REACH])):
            known = stems
            wide = (
                self._spot[0] + self._spot[1] * self.reach + 1.5 * (known + 1) * self.field.library.tile_size
            )
            self.field.ensure(x, y, self.reach + wide)

    def _find(self, origins: F64, directions: F64) -> int:
        """How many pages are missing, < 0: they are not walked along; marks slots that are seen."""
        store, table = self.field.store, self.field.pages.table
        if self._launch is None:
            from swath.rays.sight_kernel import find_missing

            self._launch = repeatable(find_missing, [shared(self.whole), shared(self.real)])
        if self._covered.shape[1] != len(origins):
            self._covered = np.zeros((2, len(origins), 3))
            self.whole[DROPPED_THEN] = -1
        if len(self._seen) != len(store.ground_low):
            self._seen = np.zeros(len(store.ground_low), np.uint8)
        arrays = (table, store.ground_low, origins, directions, self._missing, self._seen, store.counters)
        (ny, nx), pages = table.shape, self.field.pages
        sizes = nx, ny, pages.table_x, pages.table_y, len(origins), ROOM, len(self._seen), MANY
        self.whole[:DROPPED_THEN] = *map(address, (*arrays, self._covered)), *sizes
        self._launch.launch()
        return int(self.whole[MISSING])
