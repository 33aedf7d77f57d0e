"""What kernels see of a field: its arrays as they are now, on the device that rays run on."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.edges.profile import refused
from swath.field.field import Field
from swath.field.memory_layout import Pages, PlantLibrary, Shape, Solids, primitive_rows, shared_rows
from swath.field.wind import GUST_SHARE
from swath.kernels import member_array, repeatable
from swath.rays.geometry import make_solid_arrays

F32 = NDArray[np.float32]
POOLS = (
    *("table", "ground", "straw", "tile_plane", "tile_stand", "tile_top", "tile_bump"),
    *("tile_prototype", "cut_slot", "cut"),
)


class LiveScene:
    """The field's own memory on the CPU, a copy on another device, renewed after each change.

    version: goes up whenever the scene itself changes, not what its arrays hold; top_room: hits may lie above
    crop by this share of its height; has_plants: with the primitives of plants
    shown: (2,) counters of the pages that it shows: REVISION, which `top_of` depends on, and MOVED
    """

    def __init__(self, field: Field, device: str, *, top_room: float = 0.0, has_plants: bool = True) -> None:
        self.field, self.device, self.top_room = field, device, top_room
        self._has_plants = has_plants
        self.version = 0
        self._scene: Any = None
        self._held: dict[str, Any] = {}  # pool name -> the array last given to Warp
        self._raise: Any = None  # the launch that finds tops of pages, of the arrays as they are held
        self._pages: Pages | None = None
        self.shown = np.full(2, -1, np.int64)
        self._place = (float("nan"), 0, 0)  # yaw of the stand, first page of the table
        self._library: PlantLibrary | None = None

    def share(self, wp: Any, array: NDArray[Any], dtype: Any) -> Any:
        """The array for Warp: the same memory on the CPU, a copy elsewhere."""
        return wp.array(array, dtype=dtype, device=self.device, copy=self.device != "cpu")

    def solid_arrays(self, wp: Any, solids: Solids) -> Any:
        """Solids as kernels read them."""
        return make_solid_arrays(wp, solids, self.device)

    def set_wind(self, wp: Any, t: int) -> None:
        """The wind at a time [ns]; the scene must be fresh."""
        scene = self._scene
        wind = self.field.wind
        if wind is None and scene.sways == 0:
            return
        self.version += 1
        scene.sways = 0 if wind is None else 1
        if wind is None:
            return
        size = self.field.library.tile_size
        scene.toward = wp.vec2(*wind.toward)
        scene.slopes = wp.vec3(wind.steady, (1.0 - GUST_SHARE) * wind.amplitude, GUST_SHARE * wind.amplitude)
        for name, k, phase in zip(("wave", "gust"), (wind.wave, wind.gust), wind.phases(t), strict=True):
            x, y = k[0] * size, k[1] * size
            setattr(scene, name, wp.vec3d(x, y, 0.5 * (x + y) - phase))

    def refresh(self, wp: Any, *, cells: bool = False) -> Any:
        """The scene as it is now: pools that were reallocated are taken anew, copies renewed.

        cells: with the search index of single rays, which is made for whoever asks for it first
        """
        from swath.rays.kernel.scene import Scene
        from swath.rays.kernel.tops import raise_tops

        if self.field.profile is not None:
            raise refused("sensor that casts rays beside it")
        if self._scene is None:
            self._scene = Scene()
        if self._library is not self.field.library:
            self._library, self._pages = self.field.library, None
            self._take_library(self._library)
        if cells and "cell_start" not in self._held:
            self._hold("cell_start", self._library.cell_start)
            self._hold("cell_items", self._library.cell_items)
        scene, pages = self._scene, self.field.pages
        yaw = self.field.stand_yaw
        now = pages.counters[: len(self.shown)]
        if pages is self._pages and (now == self.shown).all() and yaw == self._place[0]:
            return scene
        self._pages, self.shown[:] = pages, now
        place = yaw, pages.table_x, pages.table_y
        if place != self._place:
            self._place, self.version = place, self.version + 1
            scene.turn = wp.vec2d(np.cos(yaw), np.sin(yaw))
            scene.table_x, scene.table_y = pages.table_x, pages.table_y
        for name in POOLS:
            pool = getattr(pages, name)
            if self._held.get(name) is not pool or self.device != "cpu":
                self._hold(name, pool)
        count = len(pages.ground)
        if "page_top" not in self._held or len(self._held["page_top"]) != count:
            self._hold("page_top", np.zeros(count, np.float32))
        given = [scene, 1.0 + self.top_room]
        if self.device != "cpu":
            wp.launch(raise_tops, count, given, device=self.device)
            return scene
        if self._raise is None:
            self._raise = repeatable(raise_tops, given, threads=count)
        self._raise.launch()
        return scene

    def _hold(self, name: str, array: NDArray[Any]) -> None:
        """Another array under a name of the scene."""
        from swath.rays.kernel.scene import Scene

        self._held[name], self._raise = array, None
        self.version += 1
        setattr(self._scene, name, member_array(Scene, name, array, self.device))

    def _take_library(self, library: PlantLibrary) -> None:
        if self._has_plants:
            self._hold("prims", pack_primitives(library))
        self._hold("reflectance", library.reflectance)
        self._held.pop("cell_start", None)  # of the library before
        scene = self._scene
        scene.tile_size = library.tile_size
        scene.side = library.tile_size / library.columns
        scene.columns, scene.bins, scene.bin_height = library.columns, library.bins, library.bin_height


def pack_primitives(library: PlantLibrary) -> F32:
    """Primitives as the kernel reads them, (4 m, 4), see `kernel/scene.py`."""
    rows = shared_rows(library)
    if rows is None:
        rows = primitive_rows(len(library.owner))
        rows[:, 0:3], rows[:, 4:7], rows[:, 8:11] = library.a, library.b, library.width
        rows[:, 3] = np.where(library.shape == Shape.TRIANGLE, -1.0, library.radius)
        rows[:, 12:14] = library.base
    rows[:, 7], rows[:, 11] = library.stem_rank[library.owner], library.organ
    if len(library.own_reflectance):
        rows[:, 14] = library.own_reflectance
    result: F32 = rows.reshape(-1, 4)
    return result
