"""Straw on the ground: masses on the lattice nodes, from which the depth follows.

Masses are float64 and each node belongs to one page (its lower-left ones), so their sum is exact; the depth
that rays see is float32 and written to every page that shows the node.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from swath.field.layout import PAGE_NODES
from swath.field.pages import Key, PageStore
from swath.field.tops import update_bumps

Array = NDArray[np.float64]


def spread_straw(
    store: PageStore, polygon: Array, mass: float, heading: float | None, depth_per_kg: float
) -> None:
    """Lay a mass [kg] on the nodes in and around a convex polygon given in node units of the stand frame.

    heading [rad] in that frame: straw lies as a ridge along it; None: even.
    """
    place, weight = _points_inside(polygon)
    if heading is not None:
        across = place @ np.array([-np.sin(heading), np.cos(heading)])
        corner = polygon @ np.array([-np.sin(heading), np.cos(heading)])
        middle, half = 0.5 * (corner.max() + corner.min()), 0.5 * (corner.max() - corner.min())
        weight = weight * np.clip(1.0 - ((across - middle) / max(half, 1e-9)) ** 2, 0.0, None)
    if mass == 0.0 or weight.sum() <= 0.0:
        return
    weight = weight * (mass / weight.sum())
    low = np.floor(place).astype(np.int64)
    fx, fy = (place - low).T
    node = np.concatenate([low + np.array([a, b]) for b in (0, 1) for a in (0, 1)])
    share = np.concatenate([(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy])
    origin = node.min(axis=0)
    nx, ny = node.max(axis=0) - origin + 1
    flat = (node[:, 1] - origin[1]) * nx + node[:, 0] - origin[0]
    laid: Array = np.asarray(np.bincount(flat, share * np.tile(weight, 4), minlength=nx * ny), np.float64)
    _add(store, laid.reshape(ny, nx), int(origin[0]), int(origin[1]), depth_per_kg)


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
            mass = store.straw_mass.setdefault((i, j), np.zeros((n, n)))
            mass[low - j * n : high - j * n, left - i * n : right - i * n] += part
    write_depth(store, keys, depth_per_kg)
    store.pages.revision += 1


def _points_inside(polygon: Array, spacing: float = 0.5) -> tuple[Array, Array]:
    """Points spread over a convex polygon, less than `spacing` apart, and the area each stands for."""
    points, areas = [], []
    for b, c in pairwise(polygon[1:]):
        e, f = b - polygon[0], c - polygon[0]
        count = max(1, int(np.ceil(max(np.hypot(*e), np.hypot(*f), np.hypot(*(f - e))) / spacing)))
        j, i = np.divmod(np.arange(count * count), count)
        lower, upper = i + j < count, i + j < count - 1
        s = np.concatenate([i[lower] + 1 / 3, i[upper] + 2 / 3]) / count
        t = np.concatenate([j[lower] + 1 / 3, j[upper] + 2 / 3]) / count
        points.append(polygon[0] + s[:, None] * e + t[:, None] * f)
        areas.append(np.full(len(s), 0.5 * abs(e[0] * f[1] - e[1] * f[0]) / count**2))
    return np.concatenate(points), np.concatenate(areas)
