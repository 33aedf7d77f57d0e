"""The cut of a field, and looks at its crop, by compiled code."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field.cutting.cut_result import Corner, Cut, StemIndex
from swath.field.cutting.land import ALL_ROWS, LACKED, PAGES_MAX, LandMemory, Task
from swath.kernels import filled, over_rows

STEM = np.dtype(
    [("rank", "f4"), ("height", "f4"), *((n, "f8") for n in ("ear", "grain", "straw"))]
)  # of the kernel


class Cutter(Task):
    """Cuts a field."""

    kernel = "cut_polygons"

    def __init__(self, land: LandMemory, stems: StemIndex) -> None:
        super().__init__(land)
        self._index, self._lines = stems, dict[tuple[int, int], _Lines]()

    @cached_property
    def stems(self) -> Any:
        """All of the field."""
        from swath.field.cutting.land_kernel import Roots

        stems, library = self._index, self._index.library
        heights, kg = (library.stem_height, stems.ear_height), (library.grain_kg, library.straw_kg)
        columns = library.stem_rank, *heights, *kg
        rows: NDArray[Any] = np.zeros(len(library.stem_rank), STEM)
        for name, column in zip(STEM.names or (), columns, strict=True):
            rows[name] = column
        taken, first, at = stems.by_line()
        at[:, 0] = np.where(stems.is_crop[at[:, 0]], at[:, 0], -1 - at[:, 0])
        about = {"taken": taken, "first": first, "at": at, "straw_exponent": stems.straw_exponent}
        return filled(Roots, stems=rows, **about)

    def cut(self, corners: list[Corner], code: int) -> Cut:
        """Bring every cell of a convex polygon that is higher down to the height of a code.

        corners: counter-clockwise [m], world; STANDING: the area of crop that stands there, nothing is cut
        """
        self.ask(corners, 0.0, code)
        return self._cut_rows(*ALL_ROWS, code)

    def standing(
        self, places: Sequence[Corner], du: float, dv: float, count: int
    ) -> NDArray[np.bool_] | None:
        """Whether crop stands at the middles of `count` steps from each place, (n, count).

        Places are in cell units of the stand frame. None where not all pages are in memory.
        """
        self.know(0, self.land, self.stems)
        if (shape := (len(places), count)) not in self._lines:
            self._lines[shape] = _Lines(self.lands, *shape)
        return self._lines[shape].look(places, (du, dv))

    def _cut_rows(self, first: int, last: int, code: int) -> Cut:
        """Cut these rows of cells of the polygon; in two halves when they lie on too many pages."""
        self.rows[0] = first, last
        while not self.is_done():
            count, (first, last, *_) = int(self.sums[0, LACKED]), self.pages[0, 0].tolist()
            if count < 0 and first == last:
                raise InputError("polygon", None, f"expected one less than {8 * PAGES_MAX} tiles wide")
            if count < 0:
                lower = self._cut_rows(first, middle := (first + last) // 2, code)
                return lower + self._cut_rows(middle + 1, last, code)
            store, keys = self.land.store, [(i, j) for i, j, _, _ in self.pages[0, :count].tolist()]
            store.need(keys)
            for slot in map(store.keys.__getitem__, keys):
                if -1 - int(store.pages.cut_slot[slot]) > code:
                    store.open_cut(slot)
        grain, straw, left, area, stems = self.sums[0, :5].tolist()
        return Cut(grain, straw, int(stems), area, left)


class _Lines:
    """Looks up crop at `count` places along each of `lines` lines."""

    def __init__(self, lands: Any, lines: int, count: int) -> None:
        from swath.field.cutting.cut_kernel import crop_along

        self._starts, self._step = np.zeros((lines, 2)), np.zeros(2)
        self._crop, self._is_missing = np.zeros((lines, count), np.bool_), np.zeros(1, np.int32)
        arrays = (self._starts, self._step, self._crop, self._is_missing)
        self._launch = over_rows(1, crop_along, lands, *arrays).launch

    def look(self, places: Sequence[Corner], step: Corner) -> NDArray[np.bool_] | None:
        """As `Cutter.standing`."""
        self._starts[:], self._step[:], self._is_missing[0] = places, step, 0
        self._launch()
        return None if self._is_missing[0] else self._crop.copy()
