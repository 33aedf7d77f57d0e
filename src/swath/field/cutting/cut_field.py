"""The cut of a field: one compiled pass over the cells, the sums after it."""

from collections.abc import Sequence
from itertools import chain
from math import ceil, floor
from operator import attrgetter, is_
from struct import pack_into
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field.cutting.cut_result import TILE_CELLS, Corner, Cut, StemIndex, cells_inside
from swath.field.memory_layout import PAGE_CUT_CELLS, REVISION
from swath.field.paging.pages import PageStore
from swath.kernels import filled, member_array, repeatable, start_warp

Array = NDArray[np.float64]
CORNERS_MAX = 64
PAGES_MAX = 256  # of one launch, as in cut_rows.cpp
STATUS, PAGE_COUNT, NEWLY_CUT, CROP_STEMS, CHANGED = range(5)
POOLS = ("table", "cut_slot", "cut", "tile_stand", "tile_prototype", "tile_top")
POOLS_OF = attrgetter(*POOLS)
STEM = np.dtype([(n, float) for n in ("rank", "height", "ear", "grain", "straw", "crop")])  # as in the kernel


class Cutter:
    """Cuts the pages of a store.

    The arrays of a kernel launch are made once; pools of pages are taken anew where they were replaced. sway:
    the most that wind leans stems, see `tops.update_tops`
    """

    def __init__(self, store: PageStore, stems: StemIndex, *, sway: float = 0.0) -> None:
        self.store, self.stems, self.sway = store, stems, sway
        self._polygon, self._edges = np.zeros((CORNERS_MAX, 2)), np.zeros((CORNERS_MAX, 4))
        self._ask, self._report = np.zeros(4, np.int32), np.zeros(5, np.int32)
        self._corner_bytes, self._ask_bytes = self._polygon.data.cast("B"), self._ask.data.cast("B")
        self._pages = np.zeros((PAGES_MAX, 4), np.int32)
        self._tiles = np.zeros((PAGES_MAX, 64), np.uint8)
        self._masses = np.zeros((2, 3))  # grain, straw, grain left; of them by earlier cuts [kg]
        self._pools: dict[str, Any] = {}
        self._held: tuple[Any, ...] = ()
        self._lines: dict[tuple[int, int], _Lines] = {}
        self._land: Any = None
        self._launch: Any = None
        self._count: Any = None

    def cut(self, corners: list[Corner], code: int) -> Cut:
        """Bring every cell of a convex polygon that is higher down to the height of a code.

        corners: counter-clockwise, in cell units of the stand frame
        """
        return self._cut_rows(len(corners), *self._take(corners), code)

    def standing_cells(self, corners: list[Corner]) -> int | None:
        """Number of cells of a convex polygon on which crop stands, corners as of `cut`.

        None for too many corners, or more pages than there can be in memory.
        """
        if len(corners) > CORNERS_MAX:
            return None
        count = self._counted(corners)
        if count is None:
            u, v = cells_inside(np.array(corners))
            self.store.need_at(u // PAGE_CUT_CELLS, v // PAGE_CUT_CELLS)
            count = self._counted(corners)
        return count

    def _counted(self, corners: list[Corner]) -> int | None:
        """As `standing_cells`; None where not all pages are in memory."""
        pack_into("3i", self._ask_bytes, 0, len(corners), *self._take(corners))
        self._refresh()
        self._count.launch()
        is_missing, count, *_ = self._report.tolist()
        return None if is_missing else count

    def _take(self, corners: list[Corner]) -> tuple[int, int]:
        """Take over a polygon; its first and last row of cells."""
        if len(corners) > CORNERS_MAX:
            raise InputError("polygon", len(corners), f"expected at most {CORNERS_MAX} corners")
        pack_into(f"{2 * len(corners)}d", self._corner_bytes, 0, *chain.from_iterable(corners))
        y = [v for _, v in corners]
        return ceil(min(y) - 0.5), floor(max(y) - 0.5)

    def standing(
        self, places: Sequence[Corner], du: float, dv: float, count: int
    ) -> NDArray[np.bool_] | None:
        """Whether crop stands at the middles of `count` steps from each place, (n, count).

        Places are in cell units of the stand frame. None where not all pages are in memory.
        """
        self._refresh()
        if (shape := (len(places), count)) not in self._lines:
            self._lines[shape] = _Lines(self._land, *shape)
        return self._lines[shape].look(places, (du, dv))

    def _cut_rows(self, corners: int, first: int, last: int, code: int) -> Cut:
        """Cut these rows of cells of the polygon; in two halves when they lie on too many pages."""
        pack_into("4i", self._ask_bytes, 0, corners, first, last, code)
        pages = self._run(code)
        if pages is None:
            if first == last:
                raise InputError("polygon", None, f"expected one less than {8 * PAGES_MAX} tiles wide")
            middle = (first + last) // 2
            lower = self._cut_rows(corners, first, middle, code)
            return lower + self._cut_rows(corners, middle + 1, last, code)
        report: list[int] = self._report.tolist()
        if report[CHANGED] == 0:
            return Cut()
        self._note(pages)
        grain, straw, left = (self._masses[0] - self._masses[1]).tolist()
        area = report[NEWLY_CUT] * (self.stems.library.tile_size / TILE_CELLS) ** 2
        return Cut(grain, straw, report[CROP_STEMS], area, left)

    def _run(self, code: int) -> list[list[int]] | None:
        """Launch until all pages are there. The polygon's pages as the kernel has them, None: too many."""
        report, store = self._report, self.store
        while True:
            report[CHANGED] = 0
            self._refresh()
            self._launch.launch()
            status, count, *_ = report.tolist()
            if status == 3:
                return None
            pages: list[list[int]] = self._pages[:count].tolist()
            keys = [(i, j) for j, i in sorted([(j, i) for i, j, _, _ in pages])]
            store.need(keys)
            if status == 0:
                return pages
            for key in keys:
                slot = store.keys[key]
                if -1 - int(store.pages.cut_slot[slot]) > code:
                    store.open_cut(slot)

    def _note(self, pages: list[list[int]]) -> None:
        """Book-keeping after codes changed."""
        store = self.store
        store.pages.counters[REVISION] += 1
        for i, j, is_lower, is_cut in pages:
            if is_cut:
                store.recut.add((i, j))
            if is_lower:
                store.try_collapse(store.keys[i, j])

    def _refresh(self) -> None:
        """The launch with the pools as they are now."""
        p, store = self.store.pages, self.store
        held = (store.code_max, *POOLS_OF(p))
        if self._launch is not None and all(map(is_, held, self._held)):
            return
        self._held = held
        pools = {name: getattr(p, name) for name in POOLS} | {"code_max": store.code_max}
        stale = [name for name, pool in pools.items() if self._pools.get(name) is not pool]
        start_warp()
        from swath.field.cutting.land_kernel import Land

        if self._land is None:
            library = self.stems.library
            self._land = filled(
                Land,
                tile_size=library.tile_size,
                height_max=library.height_max,
                stem_reach=library.reach,
                sway=self.sway,
            )
        for name in stale:
            self._pools[name] = pools[name]
            setattr(self._land, name, member_array(Land, name, pools[name]))
        self._land.table_x, self._land.table_y = p.table_x, p.table_y
        if self._launch is None:
            self._prepare()
        else:
            self._launch.set_param_at_index(0, self._land)
            self._count.set_param_at_index(0, self._land)
        self._lines = {}

    def _prepare(self) -> None:
        """The launch."""
        from swath.field.cutting import cut_kernel as kernel

        stems, library = self.stems, self.stems.library
        bodies = {
            "rank": library.stem_rank,
            "height": library.stem_height,
            "ear": stems.ear_height,
            "grain": library.grain_kg,
            "straw": library.straw_kg,
            "crop": stems.is_crop,
        }
        rows: NDArray[Any] = np.zeros(len(library.stem_rank), STEM)
        for name, column in bodies.items():
            rows[name] = column
        first, at = stems.by_cell()
        self._roots = filled(
            kernel.Roots,
            first=first,
            at=at,
            stems=rows,
            straw_exponent=stems.straw_exponent,
        )
        polygon = self._share(self._polygon), self._share(self._edges, start_warp().vec4d)
        ask, report = self._share(self._ask), self._share(self._report)
        sums = (
            self._share(self._masses, start_warp().vec3d),
            self._share(self._pages),
            self._share(self._tiles),
        )
        self._launch = repeatable(kernel.cut_cells, [self._land, self._roots, *polygon, ask, *sums, report])
        self._count = repeatable(kernel.standing_cells, [self._land, *polygon, ask, report])

    def _share(self, array: NDArray[Any], dtype: Any = Any) -> Any:
        """The same memory for Warp."""
        return start_warp().array(array, dtype=dtype, device="cpu", copy=False)


class _Lines:
    """Looks up crop at `count` places along each of `lines` lines."""

    def __init__(self, land: Any, lines: int, count: int) -> None:
        from swath.field.cutting.cut_kernel import crop_along

        self._starts, self._step = np.zeros((lines, 2)), np.zeros(2)
        self._crop, self._is_missing = np.zeros((lines, count), np.bool_), np.zeros(1, np.int32)
        arrays = (self._starts, self._step, self._crop, self._is_missing)
        shared = [start_warp().array(a, device="cpu", copy=False) for a in arrays]
        self._launch = repeatable(crop_along, [land, *shared]).launch

    def look(self, places: Sequence[Corner], step: Corner) -> NDArray[np.bool_] | None:
        """As `Cutter.standing`."""
        self._starts[:], self._step[:], self._is_missing[0] = places, step, 0
        self._launch()
        return None if self._is_missing[0] else self._crop.copy()
