"""What kernels see of a field: its arrays as they are now, on the device that rays run on."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.edges.profile import refused
from swath.field.field import Field
from swath.field.memory_layout import (
    PAGE_TILES,
    Pages,
    PlantLibrary,
    Shape,
    Solids,
    primitive_rows,
    shared_rows,
)
from swath.field.wind import GUST_SHARE
from swath.kernels import member_array
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
    """

    def __init__(self, field: Field, device: str, *, top_room: float = 0.0, has_plants: bool = True) -> None:
        self.field, self.device, self.top_room = field, device, top_room
        self._has_plants = has_plants
        self.version = 0
        self._scene: Any = None
        self._held: dict[str, Any] = {}  # pool name -> the array last given to Warp
        self._pages: Pages | None = None  # as they were at the revision
        self._revision = -1
        self._place = (float("nan"), 0, 0)  # yaw of the stand, first page of the table
        self._library: PlantLibrary | None = None
        self._corners: tuple[F32 | None, int, F32] = None, 0, np.zeros(0, np.float32)

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
        if pages is self._pages and pages.revision == self._revision and yaw == self._place[0]:
            return scene
        self._pages, self._revision = pages, pages.revision
        place = yaw, pages.table_x, pages.table_y
        if place != self._place:
            self._place, self.version = place, self.version + 1
            scene.turn = wp.vec2d(np.cos(yaw), np.sin(yaw))
            scene.table_x, scene.table_y = pages.table_x, pages.table_y
        for name in POOLS:
            pool = getattr(pages, name)
            if self._held.get(name) is not pool or self.device != "cpu":
                self._hold(name, pool)
        self._hold_tops(page_tops(pages, self._highest_ground(pages), self.top_room))
        return scene

    def _highest_ground(self, pages: Pages) -> F32:
        """Highest ground of each tile's plane, worked out again when pages came into memory."""
        plane, (known, made, corners) = pages.tile_plane, self._corners
        if known is not plane or made != pages.made:
            corners = plane_tops(plane, self.field.library.tile_size)
            self._corners = plane, pages.made, corners
        return corners

    def _hold_tops(self, tops: F32) -> None:
        held = self._held.get("page_top")
        if held is not None and held.shape == tops.shape and self.device == "cpu":
            held[:] = tops
            return
        self._hold("page_top", tops)

    def _hold(self, name: str, array: NDArray[Any]) -> None:
        """Another array under a name of the scene."""
        from swath.rays.kernel.scene import Scene

        self._held[name] = array
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


def plane_tops(plane: F32, tile_size: float) -> F32:
    """Highest place of each tile's plane [m], (n, 8, 8)."""
    return np.asarray(plane[..., 0] + 0.5 * tile_size * (np.abs(plane[..., 1]) + np.abs(plane[..., 2])))


def page_tops(pages: Pages, planes: F32, room: float = 0.0) -> F32:
    """Highest thing in each page [m], (n,): ground, straw or live crop with room for this share above it.

    planes: highest place of each tile's plane [m], (n, 8, 8)
    """
    crop = pages.tile_top if room == 0.0 else (1.0 + room) * pages.tile_top
    tops = planes + np.maximum(crop, pages.tile_bump)
    top: F32 = tops.reshape(len(tops), PAGE_TILES**2).max(axis=1).astype(np.float32)
    return top
