"""What compiled code takes that changes a field polygon by polygon."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field.cutting.cut_result import TILE_CELLS, Corner
from swath.field.memory_layout import MOVED, PlantLibrary
from swath.field.paging.pages import PageStore
from swath.kernels import Repeated, filled, filled_by, member_array, of_worlds, over_rows, start_warp

CORNERS_MAX, PAGES_MAX = 64, 256  # of one polygon, as in pages.cpp
CORNERS = 3  # number of a polygon at which its corners begin
SUMS, DONE, LACKED = 8, 6, 7  # as in pages.cpp
ALL_ROWS = -(1 << 31), (1 << 31) - 1
COUNTED = -2  # of a field as a profile, in the place of how often its pages moved
POOLS = (
    *("table", "cut_slot", "cut", "ground", "straw"),
    *("tile_plane", "tile_bump", "tile_stand", "tile_prototype", "tile_top"),
)
HELD = "code_max", "straw_at", "touched", "counters"  # by the store itself


class LandMemory:
    """Pages of a store as `land_kernel.Land`.

    turn: cosine and sine of the yaw of the stand, and it
    sway: the most that wind leans stems, see height_bounds.py; depth_per_kg: of straw on a node [m/kg]
    laid: room for straw on nodes [kg]; who puts it elsewhere counts that as pages that moved
    """

    def __init__(self, store: PageStore, library: PlantLibrary, **about: Any) -> None:
        self.store, self.library, self._about = store, library, about
        self.laid, self.known = np.zeros(4096), -1
        self._land: Any = None
        self._pools = dict[str, Any]()

    def now(self) -> Any:
        """The struct with the pools where they are now. known: how often they had moved then."""
        if self.known == (moved := int(self.store.counters[MOVED])):
            return self._land
        start_warp()
        from swath.field.cutting.land_kernel import Land

        if self._land is None:
            size, library = self.library.tile_size, self.library
            sizes = {"tile_size": size, "cell_area": (size / TILE_CELLS) ** 2}
            reach = {"height_max": library.height_max, "stem_reach": library.reach}
            self._land = filled(Land, **self._about, **sizes, **reach)
        pages, self.known = self.store.pages, moved
        pools = {name: getattr(pages, name) for name in POOLS} | {"laid": self.laid}
        for name, pool in (pools | {name: getattr(self.store, name) for name in HELD}).items():
            if self._pools.get(name) is not pool:
                self._pools[name] = pool
                setattr(self._land, name, member_array(Land, name, pool))
        self._land.table_x, self._land.table_y = pages.table_x, pages.table_y
        return self._land


class Tasks:
    """Polygons in worlds for a kernel of `cut_kernel`; attributes are those of `land_kernel.Work`."""

    def __init__(self, polygons: NDArray[np.float64], found: NDArray[np.int32], needs: Any) -> None:
        start_warp()
        from swath.field.cutting.land_kernel import Land, Roots

        n, kinds = len(polygons), (Land, Roots)
        self.polygons, self.found, self.needs, self.known = polygons, found, needs, np.full(n, -1)
        self._structs = [[kind() for _ in range(n)] for kind in kinds]
        self.lands, self.roots = map(of_worlds, kinds, self._structs)
        self._rows = self.lands.numpy(), self.roots.numpy()
        self.rows, self.pages = np.full((n, 2), ALL_ROWS, np.int32), np.zeros((n, PAGES_MAX, 4), np.int32)
        self.sums = np.zeros((n, SUMS))

    def launch(self, kernel: str) -> Repeated:
        """A launch over them."""
        from swath.field.cutting import cut_kernel
        from swath.field.cutting.land_kernel import Work

        return over_rows(len(self.found), getattr(cut_kernel, kernel), filled_by(Work, self))

    def know(self, world: int, land: LandMemory, roots: Any) -> None:
        """Take the memory of a field as it is now."""
        if self.known[world] != (moved := land.store.counters[MOVED]):
            self._structs[0][world], self._structs[1][world] = structs = land.now(), roots
            for row, struct in zip(self._rows, structs, strict=True):
                row[world] = struct.numpy_value()
            self.known[world] = moved

    def count(self, world: int, laid: NDArray[np.float64]) -> None:
        """Of a field as a profile: straw [kg] is but added up, to `laid` (1,); all else Python does."""
        from swath.field.cutting.land_kernel import Land

        if self.known[world] != COUNTED:
            self._structs[0][world] = land = filled(Land, laid=laid)
            self._rows[0][world], self.known[world] = land.numpy_value(), COUNTED


class Task(Tasks):
    """One polygon of a field at a time. land: its memory."""

    kernel: str

    def __init__(self, land: LandMemory) -> None:
        polygons = np.zeros((1, 1, CORNERS + 2 * CORNERS_MAX))
        super().__init__(polygons, np.ones(1, np.int32), np.zeros(1, np.int32))
        self.land = land

    @cached_property
    def stems(self) -> Any:
        """`Roots`."""
        from swath.field.cutting.land_kernel import Roots

        return Roots()

    @cached_property
    def _once(self) -> Repeated:
        return self.launch(self.kernel)

    def ask(self, corners: Sequence[Corner], first: float, second: float) -> None:
        """A polygon, corners counter-clockwise [m], world, and two numbers."""
        if len(corners) > CORNERS_MAX:
            raise InputError("polygon", len(corners), f"expected at most {CORNERS_MAX} corners")
        asked = self.polygons[0, 0]
        asked[:CORNERS] = len(corners), first, second
        asked[CORNERS : CORNERS + 2 * len(corners)] = [x for corner in corners for x in corner]

    def is_done(self) -> bool:
        """Do it; False where something is lacking."""
        self.know(0, self.land, self.stems)
        self._once.launch()
        return bool(self.sums[0, DONE])
