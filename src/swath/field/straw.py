"""Straw on the ground: masses on the lattice nodes, from which the depth follows.

Masses are float64 and each node belongs to one page (its lower-left ones), so their sum is exact; the depth
that rays see is float32 and written to every page that shows the node.
"""

from collections.abc import Sequence
from math import nan

import numpy as np

from swath.field.cutting.cut_result import Corner
from swath.field.cutting.height_bounds import update_bumps
from swath.field.cutting.land import LACKED, Task
from swath.field.memory_layout import MOVED, PAGE_NODES
from swath.field.paging.pages import PageStore
from swath.field.paging.stored_changes import Key


class StrawLayer(Task):
    """Lays straw on the nodes of a field."""

    kernel = "lay_straw"

    def lay(self, corners: Sequence[Corner], mass: float, heading: float | None) -> None:
        """Lay a mass [kg] on the nodes in and around a convex polygon, corners counter-clockwise [m], world.

        heading [rad]: straw lies as a ridge along it, a parabola across; None: even
        """
        if mass == 0.0:
            return
        store, n = self.land.store, PAGE_NODES
        self.ask(corners, mass, nan if heading is None else heading)
        self.rows[0, 0] = 0
        while not self.is_done():
            if (count := int(self.sums[0, LACKED])) > len(self.land.laid):
                self.land.laid = np.zeros(count)
                store.counters[MOVED] += 1
                continue
            u0, u1, v0, v1 = self.pages[0, 0].tolist()
            laid = self.land.laid[:count].reshape(-1, u1 - u0 + 1)
            keys = [(i, j) for j in range(v0 // n, v1 // n + 1) for i in range(u0 // n, u1 // n + 1)]
            store.need(keys)
            self.rows[0, 0] = 1
            for i, j in keys:
                own = laid[max(j * n - v0, 0) : (j + 1) * n - v0, max(i * n - u0, 0) : (i + 1) * n - u0]
                if own.any() and (i, j) not in store.straw_mass:
                    store.open_straw((i, j), store.keys[i, j], np.zeros((n, n)))


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
