"""Checks of rays: a finite range > 0, origins above the ground and over pages that are in memory."""

from math import cos, floor, isfinite, sin

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field.field import Field
from swath.field.memory_layout import PAGE_NODES, PAGE_TILES, Pages

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
BELOW = 0.001  # an origin so far below the ground still counts as on it [m]
FEW_PAGES = 4


def check_range(range_max: float) -> None:
    """Raises InputError unless it is a length > 0 [m]."""
    if not (isfinite(range_max) and range_max > 0.0):
        raise InputError("range_max", range_max, "expected a finite range > 0 m")


def check_origins(field: Field, origins: Array) -> None:
    """Raises InputError when a ray starts where no page of the field is in memory, or under the ground.

    origins: (n, 3) world [m]. Origins close to each other and above all ground around cost next to nothing.
    """
    if len(origins) == 0:
        return
    pages, side = field.pages, PAGE_TILES * field.library.tile_size
    c, s = cos(field.stand_yaw), sin(field.stand_yaw)
    low, high = _box(origins)
    corners = [(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])]
    u, v = [(c * x + s * y) / side for x, y in corners], [(c * y - s * x) / side for x, y in corners]
    i0, i1, j0, j1 = floor(min(u)), floor(max(u)), floor(min(v)), floor(max(v))
    if (i1 - i0 + 1) * (j1 - j0 + 1) <= FEW_PAGES:
        slots = pages.slots_at(*np.mgrid[i0 : i1 + 1, j0 : j1 + 1]).ravel().tolist()
        if min(slots) >= 0 and all(low[2] > pages.ground[n].max() for n in slots):
            return
    _check_each(pages, side, origins, (c * origins[:, 0] + s * origins[:, 1]) / side,
                (c * origins[:, 1] - s * origins[:, 0]) / side)  # fmt: skip


def _box(points: Array, block: int = 64) -> tuple[list[float], list[float]]:
    """Least and most of each column of (n, 3); in rows of many points, which numpy likes better."""
    whole = len(points) // block * block
    parts = [points[whole:]] if whole < len(points) else []
    low, high = list(parts), list(parts)
    if whole:
        rows = np.ascontiguousarray(points[:whole]).reshape(-1, 3 * block)
        low.append(rows.min(axis=0).reshape(block, 3))
        high.append(rows.max(axis=0).reshape(block, 3))
    return np.concatenate(low).min(axis=0).tolist(), np.concatenate(high).max(axis=0).tolist()


def _check_each(pages: Pages, side: float, origins: Array, u: Array, v: Array) -> None:
    """u, v: origins in the stand frame, in pages."""
    i, j = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
    slot = pages.slots_at(i, j)
    if (slot < 0).any():
        place = _named(origins[int(np.argmin(slot))])
        expected = "expected a ray that starts over known ground: call field.ensure(x, y, radius) first"
        raise InputError("origin", place, expected)
    tops = np.full(len(pages.ground), -np.inf)
    for n in np.flatnonzero(np.bincount(slot)).tolist():
        tops[n] = pages.ground[n].max()
    low = np.flatnonzero(origins[:, 2] <= tops[slot])
    if len(low):
        x, y = (((w - k) * PAGE_NODES)[low] for w, k in ((u, i), (v, j)))
        refuse_below(origins[low], _ground(pages, slot[low], x, y))


def refuse_below(origins: Array, ground: Array) -> None:
    """Raises InputError when an origin (n, 3) [m] lies under the ground (n,) [m] by more than BELOW."""
    depth = ground - origins[:, 2]
    worst = int(np.argmax(depth))
    if depth[worst] > BELOW:
        expected = f"expected a ray that starts above the ground, it is {depth[worst]:.3g} m below"
        raise InputError("origin", _named(origins[worst]), expected)


def _ground(pages: Pages, slot: Ints, x: Array, y: Array) -> Array:
    """Height of the soil [m] at points of pages, in lattice units."""
    a, b = np.minimum(x.astype(np.int64), PAGE_NODES - 1), np.minimum(y.astype(np.int64), PAGE_NODES - 1)
    fx, fy, g = x - a, y - b, pages.ground
    low = g[slot, b, a] * (1.0 - fx) + g[slot, b, a + 1] * fx
    high = g[slot, b + 1, a] * (1.0 - fx) + g[slot, b + 1, a + 1] * fx
    return np.asarray(low * (1.0 - fy) + high * fy)


def _named(point: Array) -> str:
    return "[" + ", ".join(f"{v:.6g}" for v in point.tolist()) + "]"
