"""Straw on the ground: masses on the lattice nodes, from which the depth follows.

Masses are float64 and each node belongs to one page (its lower-left ones), so their sum is exact; the depth
that rays see is float32 and written to every page that shows the node.
"""

from functools import lru_cache
from itertools import pairwise
from math import ceil, cos, hypot, sin

import numpy as np
from numpy.typing import NDArray

from swath.field.height_bounds import update_bumps, update_bumps_within
from swath.field.memory_layout import PAGE_NODES
from swath.field.pages import Key, PageStore

Array = NDArray[np.float64]
SPACING = 0.5  # of the points that straw is laid from, in nodes


def spread(store: PageStore, polygon: Array, mass: float, heading: float | None, depth_per_kg: float) -> None:
    """Lay a mass [kg] on the nodes in and around a convex polygon (n, 2) in node units of the stand frame.

    heading [rad] in that frame: straw lies as a ridge along it, a parabola across; None: even. Every point of
    a lattice over the polygon, less than SPACING apart, lays its share on the four nodes around it.
    """
    if mass == 0.0:
        return
    points, weight = _points(polygon)
    if heading is not None:
        c, s = cos(heading), sin(heading)
        across = [c * y - s * x for x, y in polygon.tolist()]
        middle, half = 0.5 * (max(across) + min(across)), max(0.5 * (max(across) - min(across)), 1e-9)
        off = (c * points[:, 1] - s * points[:, 0] - middle) / half
        weight = weight * np.maximum(1.0 - off * off, 0.0)
    whole = float(np.add.accumulate(weight)[-1])
    if whole <= 0.0:
        return
    share = weight * (mass / whole)
    node = np.floor(points)
    u0, v0 = node.min(axis=0).astype(int).tolist()
    u1, v1 = node.max(axis=0).astype(int).tolist()
    (fx, fy), columns = (points - node).T, u1 - u0 + 2
    first = (node[:, 1].astype(int) - v0) * columns + node[:, 0].astype(int) - u0
    at = first[:, None] + np.array([0, 1, columns, columns + 1])
    corner = ((1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy)
    laid = np.zeros((v1 - v0 + 2) * columns)
    np.add.at(laid, at.ravel(), (np.stack(corner, axis=1) * share[:, None]).ravel())
    _add(store, laid.reshape(-1, columns), u0, v0, depth_per_kg)


def _points(polygon: Array) -> tuple[Array, Array]:
    """Middles (n, 2) of equal parts of the triangles of a convex polygon, and the area of each part (n,)."""
    places, areas = [], []
    a = polygon[0]
    for b, d in pairwise(polygon[1:]):
        e, f = b - a, d - a
        longest = max(hypot(*side) for side in (e, f, f - e))
        n = max(ceil(longest / SPACING), 1)
        part = _parts(n)
        places.append(a + e * part[:, :1] + f * part[:, 1:])
        areas.append(np.full(len(part), 0.5 * abs(float(e[0] * f[1] - e[1] * f[0])) / (n * n)))
    return np.concatenate(places), np.concatenate(areas)


@lru_cache(maxsize=64)
def _parts(n: int) -> Array:
    """Middles of the n * n equal parts of a triangle, as shares of its two sides, (n * n, 2)."""
    middles = [
        ((i + (1 + up) / 3) / n, (j + (1 + up) / 3) / n)
        for j in range(n)
        for i in range(n - j)
        for up in (0, 1)
        if up == 0 or i + j < n - 1
    ]
    return np.array(middles)


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
    store.pages.revision += 1


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
