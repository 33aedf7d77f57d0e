"""Pages that beams can get to: nothing else of a field has to be in memory for a scan."""

from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.field import FAR, Field
from swath.kernels import address, repeatable, start_warp

F64 = NDArray[np.float64]
MANY = 4096  # beams that look to all sides, near enough: the pages around are cheaper to tell
ROOM = 256  # pages found missing in one walk; what does not fit is found by the next
SQRT_3 = sqrt(3.0)  # length of a vector over the largest of its three parts, at most
MOVED, TURNED = 0.4, 0.01  # beams may move [m] and turn so far before they are walked along again


class Sight:
    """What a sensor sees of a field. reach [m]: its beams end there.

    exit_diameter [m], divergence [rad, full angle]: what belongs to a beam lies within exit + divergence *
        range around it. A beam ends where all of it is below the lowest ground of the pages around. Tiles
        from which stems can lean into it belong to it, so that what a scan sees does not depend on other
        pages. Of very many beams all pages within the reach are taken.

    Pages are brought in for all beams that start within MOVED and point within TURNED of the given ones: the
    next scans of a machine need no look.
    """

    def __init__(self, field: Field, *, reach: float, exit_diameter: float, divergence: float) -> None:
        self.field, self.reach, self._spot = field, reach, (0.5 * exit_diameter, 0.5 * divergence)
        self._whole = np.zeros(14, np.int64)
        self._missing = np.zeros((ROOM, 2), np.int64)
        self._seen = np.zeros(0, np.uint8)
        self._launch: Any = None
        self._covered: tuple[F64, F64, object, int] | None = None  # beams, and the pages that were there

    def ensure(self, origins: F64, directions: F64) -> None:
        """Bring the pages of beams into memory. origins, directions (unit): (n, 3), contiguous, world [m]."""
        store, count = self.field.store, len(origins)
        if count == 0:
            return
        x, y, _ = origins[count // 2].tolist()
        if count > MANY or not (abs(x) < FAR and abs(y) < FAR):
            self._ensure_around(x, y)
            return
        if self._covers(origins, directions):
            return
        while missing := self._find(origins, directions):
            slots = {slot: key for key, slot in store.keys.items()}
            seen = [slots[slot] for slot in np.flatnonzero(self._seen).tolist()]
            store.need([*seen, *missing])
        self._covered = origins.copy(), directions.copy(), store.keys, store.dropped

    def _covers(self, origins: F64, directions: F64) -> bool:
        """Whether beams are near those of the last walk, and all its pages still in memory."""
        if self._covered is None:
            return False
        store, (start, towards, keys, dropped) = self.field.store, self._covered
        if keys is not store.keys or dropped != store.dropped or len(start) != len(origins):
            return False
        moved, turned = np.abs(origins - start).max(), np.abs(directions - towards).max()
        return bool(moved <= MOVED / SQRT_3 and turned <= TURNED / SQRT_3)

    def _ensure_around(self, x: float, y: float) -> None:
        """Every page within the reach and what can lean into it."""
        store, known = self.field.store, -1
        while known < store.stem_reach:
            known = store.stem_reach
            wide = (
                self._spot[0] + self._spot[1] * self.reach + 1.5 * (known + 1) * self.field.library.tile_size
            )
            self.field.ensure(x, y, self.reach + wide)

    def _find(self, origins: F64, directions: F64) -> list[tuple[int, int]]:
        """Pages that are missing; marks slots that are seen."""
        store, pages = self.field.store, self.field.pages
        if self._launch is None:
            self._launch = self._prepare()
        if len(self._seen) != len(store.ground_low):
            self._seen = np.zeros(len(store.ground_low), np.uint8)
        self._seen[:] = 0
        arrays = (pages.table, store.ground_low, origins, directions, self._missing, self._seen)
        ny, nx = pages.table.shape
        place = nx, ny, pages.table_x, pages.table_y
        self._whole[:] = *map(address, arrays), *place, len(origins), ROOM, store.stem_reach, 0
        self._launch.launch()
        found: list[list[int]] = self._missing[: self._whole[13]].tolist()
        return [(i, j) for i, j in found]

    def _prepare(self) -> Any:
        wp = start_warp()
        from swath.rays.sight_kernel import find_missing

        yaw, wide = self.field.stand_yaw, (self._spot[0] + MOVED, self._spot[1] + TURNED)
        self._real = np.array([self.field.library.tile_size, np.cos(yaw), np.sin(yaw), self.reach, *wide])
        numbers = ((self._whole, wp.int64), (self._real, wp.float64))
        return repeatable(find_missing, [wp.array(a, dtype=k, device="cpu", copy=False) for a, k in numbers])
