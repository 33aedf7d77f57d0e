"""Straw on the ground: masses on the lattice nodes, from which the depth follows.

Masses are float64 and each node belongs to one page (its lower-left ones), so their sum is exact; the depth
that rays see is float32 and written to every page that shows the node.
"""

from collections.abc import Sequence
from math import cos, floor, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field.cutting.cut_result import Corner
from swath.field.memory_layout import PAGE_NODES, REVISION
from swath.field.paging.height_bounds import update_bumps, update_bumps_within
from swath.field.paging.pages import PageStore
from swath.field.paging.stored_changes import Key
from swath.kernels import Row, repeatable, start_warp

Array = NDArray[np.float64]
SPACING = 0.5  # of the points that straw is laid from, in nodes
CORNERS_MAX = 64
ROOM = 4096  # nodes of a polygon that memory is kept for


class StrawLayer:
    """Lays straw on the nodes of a store. depth_per_kg: on a node [m/kg]."""

    def __init__(self, store: PageStore, depth_per_kg: float) -> None:
        self._store, self._depth_per_kg = store, depth_per_kg
        self._corners, self._whole = np.zeros((CORNERS_MAX, 2)), np.zeros(6, np.int32)
        self._laid = np.zeros(ROOM)
        self._launch: Any = None

    def lay(self, polygon: Sequence[Corner], mass: float, heading: float | None) -> None:
        """Lay a mass [kg] on the nodes in and around a convex polygon in node units of the stand frame.

        heading [rad] in that frame: straw lies as a ridge along it, a parabola across; None: even. Every
        point of a lattice over the polygon, less than SPACING apart, lays its share on the four nodes around.
        """
        if mass == 0.0:
            return
        if len(polygon) > CORNERS_MAX:
            raise InputError("polygon", len(polygon), f"expected at most {CORNERS_MAX} corners")
        c, s, middle, half = 1.0, 0.0, 0.0, 1.0
        if heading is not None:
            c, s = cos(heading), sin(heading)
            across = [c * y - s * x for x, y in polygon]
            middle, half = 0.5 * (max(across) + min(across)), max(0.5 * (max(across) - min(across)), 1e-9)
        self._make_room(polygon)
        self._numbers.write(mass, c, s, middle, half, SPACING)
        self._corners[: len(polygon)] = polygon
        self._whole[:2] = len(polygon), heading is not None
        self._launch.launch()
        _, _, u0, v0, u1, v1 = self._whole.tolist()
        if u1 >= u0:
            rows, columns = v1 - v0 + 1, u1 - u0 + 1
            laid = self._laid[: rows * columns].reshape(rows, columns)
            _add(self._store, laid, u0, v0, self._depth_per_kg)

    def _make_room(self, polygon: Sequence[Corner]) -> None:
        """The launch, with memory for the nodes around a polygon."""
        columns, rows = (floor(max(side)) - floor(min(side)) + 3 for side in zip(*polygon, strict=True))
        if self._launch is None or rows * columns > len(self._laid):
            self.compile(rows * columns)

    def compile(self, nodes: int = ROOM) -> None:
        """Load what is compiled, some ms the first time, with memory for so many nodes."""
        from swath.field import straw_kernel as kernel

        wp = start_warp()
        self._laid = np.zeros(max(nodes, ROOM))
        self._numbers = Row(kernel.Ridge)
        corners = wp.array(self._corners, dtype=wp.vec2d, device="cpu", copy=False)
        whole, laid = (wp.array(a, device="cpu", copy=False) for a in (self._whole, self._laid))
        self._launch = repeatable(kernel.lay, [corners, self._numbers.array, whole, laid])


def write_depth(store: PageStore, keys: list[Key], depth_per_kg: float) -> None:
    """Write the depth of straw on pages and on the borders that their neighbours share with them."""
    for key in keys:
        slot = store.keys[key]
        mass = store.straw_mass.get(key)
        if mass is not None:
            store.pages.straw[slot, :PAGE_NODES, :PAGE_NODES] = mass * depth_per_kg
    shown = {(i - a, j - b) for i, j in keys for a in (0, 1) for b in (0, 1)}
    here = sorted(key for key in shown if key in store.keys)
    for key in here:
        _write_border(store, key, depth_per_kg)
    update_bumps(store, here)


def _write_border(store: PageStore, key: Key, depth_per_kg: float) -> None:
    """The last row and column of a page show nodes of the next pages."""
    (i, j), n = key, PAGE_NODES
    depth = store.pages.straw[store.keys[key]]
    right, above, corner = (store.straw_of(k) for k in ((i + 1, j), (i, j + 1), (i + 1, j + 1)))
    depth[:n, n] = right[:, 0] * depth_per_kg if right is not None else 0.0
    depth[n, :n] = above[0] * depth_per_kg if above is not None else 0.0
    depth[n, n] = corner[0, 0] * depth_per_kg if corner is not None else 0.0


def _add(store: PageStore, laid: Array, x0: int, y0: int, depth_per_kg: float) -> None:
    """Add masses on nodes (ny, nx) whose first is node (x0, y0)."""
    ny, nx = laid.shape
    n = PAGE_NODES
    keys = [
        (i, j) for j in range(y0 // n, (y0 + ny - 1) // n + 1) for i in range(x0 // n, (x0 + nx - 1) // n + 1)
    ]
    store.need(keys)
    for i, j in keys:
        left, right = max(x0, i * n), min(x0 + nx, (i + 1) * n)
        low, high = max(y0, j * n), min(y0 + ny, (j + 1) * n)
        part = laid[low - y0 : high - y0, left - x0 : right - x0]
        if part.any():
            u, v = slice(left - i * n, right - i * n), slice(low - j * n, high - j * n)
            if (i, j) not in store.straw_mass:
                store.straw_mass[i, j] = np.zeros((n, n))
            store.straw_mass[i, j][v, u] += part
            _show(store, (i, j), v, u, depth_per_kg)
    update_bumps_within(store, x0, y0, x0 + nx - 1, y0 + ny - 1)
    store.pages.counters[REVISION] += 1


def _show(store: PageStore, key: Key, rows: slice, columns: slice, depth_per_kg: float) -> None:
    """Write the depth on nodes that a page owns, on it and on the borders where its neighbours show them."""
    (i, j), n, depth = key, PAGE_NODES, store.pages.straw
    new = store.straw_mass[key][rows, columns] * depth_per_kg
    depth[store.keys[key], rows, columns] = new
    before, below, corner = ((i - 1, j), (i, j - 1), (i - 1, j - 1))
    if columns.start == 0 and before in store.keys:
        depth[store.keys[before], rows, n] = new[:, 0]
    if rows.start == 0 and below in store.keys:
        depth[store.keys[below], n, columns] = new[0]
    if columns.start == 0 and rows.start == 0 and corner in store.keys:
        depth[store.keys[corner], n, n] = new[0, 0]
