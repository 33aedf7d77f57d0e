"""Straw on the ground: masses on the lattice nodes, from which the depth follows.

Masses are float64 and each node belongs to one page (its lower-left ones), so their sum is exact; the depth
that rays see is float32 and written to every page that shows the node.
"""

from functools import lru_cache
from itertools import pairwise
from math import ceil, cos, hypot, sin

import numpy as np
from numpy.typing import NDArray

from swath.field.layout import PAGE_NODES
from swath.field.pages import Key, PageStore
from swath.field.tops import update_bumps, update_bumps_within

Array = NDArray[np.float64]


def spread_straw(
    store: PageStore, polygon: Array, mass: float, heading: float | None, depth_per_kg: float
) -> None:
    """Lay a mass [kg] on the nodes in and around a convex polygon given in node units of the stand frame.

    heading [rad] in that frame: straw lies as a ridge along it; None: even.
    """
    x, y, weight = _points_inside(polygon)
    if heading is not None:
        c, s = cos(heading), sin(heading)
        corner = [c * b - s * a for a, b in polygon.tolist()]
        middle, half = 0.5 * (max(corner) + min(corner)), 0.5 * (max(corner) - min(corner))
        across = (c * y - s * x - middle) / max(half, 1e-9)
        weight = weight * np.maximum(1.0 - across * across, 0.0)
    whole = float(weight.sum())
    if mass == 0.0 or whole <= 0.0:
        return
    weight = weight * (mass / whole)
    u, v = np.floor(x), np.floor(y)
    fx, fy = x - u, y - v
    u0, v0 = int(u.min()), int(v.min())
    nx, ny = int(u.max()) - u0 + 2, int(v.max()) - v0 + 2
    first = (v.astype(np.int64) - v0) * nx + u.astype(np.int64) - u0
    near, far = (1 - fy) * weight, fy * weight
    share = np.concatenate([(1 - fx) * near, fx * near, (1 - fx) * far, fx * far])
    flat = np.concatenate([first, first + 1, first + nx, first + (nx + 1)])
    laid: Array = np.asarray(np.bincount(flat, share, minlength=nx * ny), np.float64)
    _add(store, laid.reshape(ny, nx), u0, v0, depth_per_kg)


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
            store.straw_mass.setdefault((i, j), np.zeros((n, n)))[v, u] += part
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


def _points_inside(polygon: Array, spacing: float = 0.5) -> tuple[Array, Array, Array]:
    """x, y of points over a convex polygon, less than `spacing` apart, and the area each stands for."""
    x, y, areas = [], [], []
    corners = polygon.tolist()
    ax, ay = corners[0]
    for (bx, by), (cx, cy) in pairwise(corners[1:]):
        ex, ey, fx, fy = bx - ax, by - ay, cx - ax, cy - ay
        longest = max(hypot(ex, ey), hypot(fx, fy), hypot(fx - ex, fy - ey))
        s, t = _triangle(max(1, ceil(longest / spacing)))
        x.append(ax + s * ex + t * fx)
        y.append(ay + s * ey + t * fy)
        areas.append(np.full(len(s), 0.5 * abs(ex * fy - ey * fx) / len(s)))
    return np.concatenate(x), np.concatenate(y), np.concatenate(areas)


@lru_cache(maxsize=64)
def _triangle(count: int) -> tuple[Array, Array]:
    """Middles of count^2 equal parts of a triangle, as shares of two of its sides."""
    j, i = np.divmod(np.arange(count * count), count)
    lower, upper = i + j < count, i + j < count - 1
    s = np.concatenate([i[lower] + 1 / 3, i[upper] + 2 / 3]) / count
    t = np.concatenate([j[lower] + 1 / 3, j[upper] + 2 / 3]) / count
    return s, t
