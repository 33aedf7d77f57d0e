"""The cut of a field: one compiled pass over the cells, the sums after it."""

from math import ceil, floor
from operator import attrgetter, is_
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field.cut_result import TILE_CELLS, Cut, StemIndex
from swath.field.pages import Key, PageStore
from swath.kernels import filled, member_array, repeatable, start_warp

Array = NDArray[np.float64]
CORNERS_MAX = 64
PAGES_MAX = 256  # of one launch, as in the kernel
STATUS, PAGE_COUNT, NEWLY_CUT, CROP_STEMS, CHANGED = range(5)
POOLS = ("table", "cut_slot", "cut", "tile_stand", "tile_prototype", "tile_top")
POOLS_OF = attrgetter(*POOLS)


class Cutter:
    """Cuts the pages of a store. sway: the most that wind leans stems, see `tops.update_tops`.

    The arrays of a kernel launch are made once; pools of pages are taken anew where they were replaced.
    """

    def __init__(self, store: PageStore, stems: StemIndex, *, sway: float = 0.0) -> None:
        self.store, self.stems, self.sway = store, stems, sway
        self._polygon = np.zeros((CORNERS_MAX, 2))
        self._ask, self._report = np.zeros(4, np.int32), np.zeros(5, np.int32)
        self._pages = np.zeros((PAGES_MAX, 3), np.int32)
        self._tiles = np.zeros((PAGES_MAX, 64), np.uint8)
        self._masses = np.zeros((2, 3))  # grain, straw, grain left; of them by earlier cuts [kg]
        self._pools: dict[str, Any] = {}
        self._held: tuple[Any, ...] = ()
        self._lines: dict[tuple[int, int], _Lines] = {}
        self._land: Any = None
        self._launch: Any = None

    def cut(self, corners: list[tuple[float, float]], code: int) -> Cut:
        """Bring every cell of a convex polygon that is higher down to the code.

        corners: counter-clockwise, in cell units of the stand frame
        """
        if len(corners) > CORNERS_MAX:
            raise InputError("polygon", len(corners), f"expected at most {CORNERS_MAX} corners")
        self._polygon[: len(corners)] = corners
        y = [v for _, v in corners]
        self._ask[0], self._ask[3] = len(corners), code
        return self._cut_rows(ceil(min(y) - 0.5), floor(max(y) - 0.5))

    def standing(self, u: Array, v: Array, du: float, dv: float, count: int) -> NDArray[np.bool_] | None:
        """Whether crop stands at the middles of `count` steps from places (n,) on, in cell units of the stand
        frame, (n, count); None where not all pages are in memory.
        """
        self._refresh()
        if (shape := (len(u), count)) not in self._lines:
            self._lines[shape] = _Lines(self._land, *shape)
        return self._lines[shape].look(u, v, du, dv)

    def _cut_rows(self, first: int, last: int) -> Cut:
        """Cut these rows of cells of the polygon; in two halves when they lie on too many pages."""
        self._ask[1:3] = first, last
        places = self._run(int(self._ask[3]))
        if places is None:
            if first == last:
                raise InputError("polygon", None, f"expected one less than {8 * PAGES_MAX} tiles wide")
            middle = (first + last) // 2
            return self._cut_rows(first, middle) + self._cut_rows(middle + 1, last)
        if self._report[CHANGED] == 0:
            return Cut()
        self._note(places)
        return self._sum()

    def _run(self, code: int) -> list[Key] | None:
        """Launch until all pages are there. The pages of the polygon, None when there are too many."""
        report, store = self._report, self.store
        while True:
            report[CHANGED] = 0
            self._refresh()
            self._launch.launch()
            status, count = int(report[STATUS]), int(report[PAGE_COUNT])
            if status == 3:
                return None
            places: list[Key] = [(i, j) for i, j in self._pages[:count, :2].tolist()]
            keys = sorted(places, key=lambda key: key[::-1])
            store.need(keys)
            if status == 0:
                return places
            for key in keys:
                slot = store.keys[key]
                if -1 - int(store.pages.cut_slot[slot]) > code:
                    store.open_cut(slot)

    def _note(self, places: list[Key]) -> None:
        """Book-keeping after codes changed."""
        store = self.store
        store.pages.revision += 1
        touched = self._tiles[: len(places)].max(axis=1).tolist()
        lower = self._pages[: len(places), 2].tolist()
        store.recut.update(key for key, is_cut in zip(places, touched, strict=True) if is_cut)
        for key, is_lower in zip(places, lower, strict=True):
            if is_lower:
                store.try_collapse(store.keys[key])

    def _sum(self) -> Cut:
        """The masses of the last launch."""
        grain, straw, left = (self._masses[0] - self._masses[1]).tolist()
        area = int(self._report[NEWLY_CUT]) * (self.stems.library.tile_size / TILE_CELLS) ** 2
        return Cut(grain, straw, int(self._report[CROP_STEMS]), area, left)

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
        from swath.field import cut_kernel as kernel

        if self._land is None:
            library = self.stems.library
            self._land = filled(
                kernel.Land,
                tile_size=library.tile_size,
                height_max=library.height_max,
                stem_reach=library.reach,
                sway=self.sway,
            )
        for name in stale:
            self._pools[name] = pools[name]
            setattr(self._land, name, member_array(kernel.Land, name, pools[name]))
        self._land.table_x, self._land.table_y = p.table_x, p.table_y
        if self._launch is None:
            self._prepare()
        else:
            self._launch.set_param_at_index(0, self._land)
        self._lines = {}

    def _prepare(self) -> None:
        """The launch."""
        from swath.field import cut_kernel as kernel

        stems, library = self.stems, self.stems.library
        arrays = {
            "first": stems.first,
            "count": stems.count,
            "stem": stems.stem,
            "column": stems.column,
            "rank": stems.rank,
            "height": stems.height,
            "ear": stems.ear_height,
            "grain": library.grain_kg,
            "straw": library.straw_kg,
            "is_crop": stems.is_crop,
        }
        kinds: dict[str, Any] = dict.fromkeys(("first", "count", "stem"), np.int32)
        kinds |= dict.fromkeys(("column", "is_crop"), np.uint8)
        self._roots = filled(
            kernel.Roots,
            straw_exponent=stems.straw_exponent,
            **{n: np.ascontiguousarray(a, kinds.get(n, np.float64)) for n, a in arrays.items()},
        )
        inputs = [
            self._land,
            self._roots,
            self._share(self._polygon),
            self._share(self._ask),
            start_warp().array(self._masses, dtype=start_warp().vec3d, device="cpu", copy=False),
            self._share(self._pages),
            self._share(self._tiles),
            self._share(self._report),
        ]
        self._launch = repeatable(kernel.cut_cells, inputs)

    def _share(self, array: NDArray[Any]) -> Any:
        """The same memory for Warp."""
        return start_warp().array(array, device="cpu", copy=False)


class _Lines:
    """Looks up crop at `count` places along each of `lines` lines."""

    def __init__(self, land: Any, lines: int, count: int) -> None:
        from swath.field.cut_kernel import crop_along

        self._starts, self._step = np.zeros((lines, 2)), np.zeros(2)
        self._crop, self._is_missing = np.zeros((lines, count), np.bool_), np.zeros(1, np.int32)
        arrays = (self._starts, self._step, self._crop, self._is_missing)
        shared = [start_warp().array(a, device="cpu", copy=False) for a in arrays]
        self._launch = repeatable(crop_along, [land, *shared]).launch

    def look(self, u: Array, v: Array, du: float, dv: float) -> NDArray[np.bool_] | None:
        """As `Cutter.standing`."""
        self._starts[:, 0], self._starts[:, 1] = u, v
        self._step[:], self._is_missing[0] = (du, dv), 0
        self._launch()
        return None if self._is_missing[0] else self._crop.copy()
