"""Soil that gives way: its strength over the field, and the ruts that wheels leave in it.

A rut of pass n at one load is z1 n^(1/a) deep (a 2 to 3 on loose, 4 to 5 on firm soil). Written for wheels of
any load that follow each other, z^a = sum of z1^a: depth alone tells what passed before.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import ceil, floor, hypot
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swath.core.portable import power
from swath.core.units import KPA
from swath.field.cutting.height_bounds import update_bumps
from swath.field.field_setup import FieldSetup
from swath.field.maps.band import Quantity
from swath.field.maps.raster import Raster
from swath.field.memory_layout import PAGE_NODES, REVISION, different_pages
from swath.field.paging.pages import PageStore
from swath.field.paging.stored_changes import Key

Array = NDArray[np.float64]
KPAS = {"kpa": 1.0, "mpa": 1e3, "pa": 1e-3}  # to kPa, which a map without a unit is in
CONE_INDEX = Quantity("cone index in kPa", KPAS, 10.0, 1e5, called=r"cone|penetr|strength")


@dataclass(frozen=True)
class Soil:
    """Cone index of the field. index: where neither map nor spot says more [Pa].

    spots: east, north, radius [m], cone index [Pa], (n, 4)
    pass_exponent: a above
    has_ruts: wheels leave any
    """

    index: float
    raster: Raster | None
    spots: Array
    pass_exponent: float
    has_ruts: bool

    def at(self, x: Any, y: Any) -> Array:
        """Cone index [Pa] at world points, in the shape of x and y; of spots that overlap the softest."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        found = np.full(x.shape, self.index)
        if self.raster is not None:
            known = KPA * self.raster.sample(x, y)
            found = np.where(np.isfinite(known), known, found)
        inside = (
            np.hypot(x[..., None] - self.spots[:, 0], y[..., None] - self.spots[:, 1]) <= self.spots[:, 2]
        )
        if not inside.any():
            return found
        softest = np.where(inside, self.spots[:, 3], np.inf).min(axis=-1, initial=np.inf)
        return np.where(np.isfinite(softest), softest, found)


def make_soil(section: Any, setup: FieldSetup) -> Soil | None:
    """Soil of the section `field.soil`; None without: the ground is firm."""
    if section is None:
        return None
    raster = None
    if section.file is not None:
        raster = Raster.from_geotiff(setup.folder / section.file, setup.origin, quantity=CONE_INDEX)
    spots = [(s.x_m, s.y_m, s.radius_m, KPA * s.cone_index_kpa) for s in section.wet_spots]
    index = KPA * section.cone_index_kpa
    return Soil(index, raster, np.array(spots).reshape(-1, 4), section.pass_exponent, section.ruts)


class Strip(NamedTuple):
    """What a wheel rolled over, and how deep its first pass sinks [m]. start, end: world."""

    start: tuple[float, float]
    end: tuple[float, float]
    width: float
    depth: float


class Ruts:
    """Depth of ruts [m] on the nodes of pages, which show the ground that much lower."""

    def __init__(self) -> None:
        self.depth: dict[Key, NDArray[np.float32]] = {}  # (64, 64), of the nodes that a page owns
        self._plain: dict[Key, NDArray[np.float32]] = {}  # (65, 65), ground without ruts

    def press(self, strips: Iterable[Strip], to_nodes: Callable[..., Any], a: float) -> set[Key]:
        """Roll over strips; a: of the passes. to_nodes: world -> nodes. The pages whose nodes sank."""
        touched: set[Key] = set()
        for strip in strips:
            (ax, bx), (ay, by) = to_nodes(*np.transpose([strip.start, strip.end]))
            way = hypot(bx - ax, by - ay)
            half = 0.5 * strip.width * way / hypot(*np.subtract(strip.end, strip.start))
            c, s = (bx - ax) / way, (by - ay) / way
            x = np.arange(ceil(min(ax, bx) - half), floor(max(ax, bx) + half) + 1)
            y = np.arange(ceil(min(ay, by) - half), floor(max(ay, by) + half) + 1)
            along = c * (x - ax) + s * (y[:, None] - ay)
            across = c * (y[:, None] - ay) - s * (x - ax)
            v, u = np.nonzero((along >= 0.0) & (along < way) & (np.abs(across) <= half))
            touched |= self._sink(x[u], y[v], strip.depth, a)
        return touched

    def _sink(self, u: Any, v: Any, depth: float, a: float) -> set[Key]:
        n = PAGE_NODES
        keys = different_pages(u // n, v // n)
        for i, j in keys:
            own = self.depth.setdefault((i, j), np.zeros((n, n), np.float32))
            mine = (u // n == i) & (v // n == j)
            at = v[mine] % n, u[mine] % n
            own[at] = power(power(own[at].astype(float), a) + depth**a, 1.0 / a)
        return set(keys)

    def show(self, store: PageStore, keys: Iterable[Key]) -> None:
        """Lower the ground of pages in memory, and of those that share a border with them."""
        near = {(i - a, j - b) for i, j in keys for a in (0, 1) for b in (0, 1)}
        shown = [key for key in sorted(near) if key in store.keys and self._has(key)]
        for key in shown:
            slot, ground = store.keys[key], store.pages.ground
            plain = self._plain.setdefault(key, ground[slot].copy())
            ground[slot] = plain - self._around(key)
            store.ground_low[slot] = ground[slot].min()
        if shown:
            update_bumps(store, shown)
            store.pages.counters[REVISION] += 1

    def _has(self, key: Key) -> bool:
        i, j = key
        return any((i + a, j + b) in self.depth for a in (0, 1) for b in (0, 1))

    def _around(self, key: Key) -> NDArray[np.float32]:
        """Depth on all nodes that a page shows, (65, 65)."""
        (i, j), n = key, PAGE_NODES
        found = np.zeros((n + 1, n + 1), np.float32)
        for a, x in ((0, slice(n)), (1, slice(n, n + 1))):
            for b, y in ((0, slice(n)), (1, slice(n, n + 1))):
                if (own := self.depth.get((i + a, j + b))) is not None:
                    found[y, x] = own[: n if b == 0 else 1, : n if a == 0 else 1]
        return found

    def save(self) -> dict[str, Any]:
        """Nodes (n, 2) that sank, and how deep [m]."""
        nodes, depths = [np.zeros((0, 2), np.int64)], [np.zeros(0, np.float32)]
        for (i, j), own in sorted(self.depth.items()):
            v, u = np.nonzero(own)
            nodes.append(np.column_stack([u + PAGE_NODES * i, v + PAGE_NODES * j]))
            depths.append(own[v, u])
        return {"nodes": np.concatenate(nodes), "depth": np.concatenate(depths)}

    def load(self, state: Mapping[str, Any] | None) -> None:
        """Take over what `save` gave; None: no ruts."""
        self.depth, n = {}, PAGE_NODES
        for (u, v), depth in zip(state["nodes"].tolist(), state["depth"], strict=True) if state else ():
            own = self.depth.setdefault((u // n, v // n), np.zeros((n, n), np.float32))
            own[v % n, u % n] = depth
