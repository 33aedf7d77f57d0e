"""Rays against a field: many at once, on all cores, the same bits for any number of threads."""

import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swath.field.memory_layout import Solids
from swath.field.solids import solid_count
from swath.rays.device import ray_device, start_warp, thread_count
from swath.rays.field_arrays import Castable, LiveScene
from swath.rays.packets.cast import Crew, GroupWalk, Task, can_walk, no_hits
from swath.rays.packets.packing import SUB_RAYS_MAX, Lanes, bundle_lanes, image_lanes
from swath.rays.refusals import check_origins, check_range
from swath.rays.spots import Spots

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
CHUNK_MIN = 1024  # fewer rays than this are not worth another thread


@dataclass(frozen=True)
class Hits:
    """Nearest hits of rays, all in the shape of the rays.

    distance [m], nan = nothing within range; organ: `layout.Organ`; cosine: |cos| of the incidence angle;
    reflectance of what was hit at 905 nm; the last three are 0 where nothing was hit
    """

    distance: F32
    organ: NDArray[np.uint8]
    cosine: F32
    reflectance: F32

    @property
    def is_hit(self) -> NDArray[np.bool_]:
        """True where something was hit."""
        result: NDArray[np.bool_] = self.organ > 0
        return result


class RayCaster:
    """Casts rays into a field.

    threads: CPU threads, default SWATH_THREADS or all cores; device: `cpu` or a Warp device as `cuda:0`,
    default SWATH_DEVICE or `cpu`. On the CPU the kernel reads the field's own memory; on another device a
    copy of it, renewed after each change.
    """

    def __init__(self, field: Castable, *, threads: int | None = None, device: str | None = None) -> None:
        self.field = field
        self.threads = thread_count() if threads is None else threads
        self.device = ray_device() if device is None else device
        self._pool = ThreadPoolExecutor(self.threads) if self.threads > 1 else None
        self._crew = Crew(self._pool, self.threads)
        self.scene = LiveScene(field, self.device)
        self._group_walk: GroupWalk | None = None

    def cast(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        *,
        range_max: float,
        solids: Solids | None = None,
        t: int = 0,
    ) -> Hits:
        """Nearest hit of each ray within range_max [m], all at time t [ns], which matters in wind alone.

        origins [m], directions (unit): (n, 3), world frame. A ray that starts inside an organ or a solid does
        not see it; a ray that leaves the known pages sees only solids. Raises ValueError on rays that are
        not finite or not of unit length; InputError on a range that is not > 0 and on rays that start under
        the ground or where no page is in memory.
        """
        o, d = self._checked(origins, directions, range_max)
        hits = Hits(*no_hits(len(o)))
        if len(o):
            self._launch(o, d, float(range_max), solids or Solids(), hits, t)
        return hits

    def cast_bundles(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        *,
        range_max: float,
        solids: Solids | None = None,
        t: int = 0,
    ) -> Hits:
        """As `cast`, for the sub-rays of beams side by side: (n, s, 3), all of the result (n, s).

        Neighbouring bundles walk through the crop together (docs/rays.md). Whatever the rays are, they hit
        what `cast` says they hit; it only pays when the sub-rays of a bundle lie close together. More than
        512 sub-rays go through `cast`, and so do all rays on another device than the CPU.
        """
        o, d = _of_shape(origins, directions, 3)
        n, s = o.shape[:2]
        if not self._walks(s):
            return _shaped(self.cast(o, d, range_max=range_max, solids=solids, t=t), (n, s))
        lanes = bundle_lanes(n, d[0]) if o.size else None
        return self._walk((n, s), o, d, lanes, range_max, solids, t)

    def cast_nearest(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        count: int,
        *,
        range_max: float,
        solids: Solids | None = None,
        t: int = 0,
    ) -> Hits:
        """The `count` nearest hits of each bundle (n, s, 3), nearest first: all of the result (n, count).

        Of each sub-ray its nearest hit counts; nan where a bundle has fewer. Much quicker than all hits: a
        bundle is done when nothing nearer can come. The last is an order statistic: of 37 sub-rays that all
        hit something, the 19th is the median.
        """
        return self._nearest(origins, directions, count, False, range_max, solids, t)

    def cast_order(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        rank: int,
        *,
        range_max: float,
        solids: Solids | None = None,
        t: int = 0,
    ) -> Hits:
        """The one hit of each bundle (n, s, 3) that is number `rank`, counted from 1, by distance: (n,).

        As the last of `cast_nearest` with so many, without the others: 1 is the nearest, 19 the median of 37
        sub-rays that all hit something; nan where a bundle has fewer.
        """
        found = self._nearest(origins, directions, rank, True, range_max, solids, t)
        return Hits(*(a[:, 0] for a in _arrays(found)))

    def cast_spots(
        self,
        spots: Spots,
        rank: int | None = None,
        *,
        range_max: float,
        solids: Solids | None = None,
        t: int = 0,
    ) -> Hits:
        """As `cast_bundles`, or with a rank as `cast_order`, of beams that are not yet rays: the same bits.

        What is cheaper: rays are made where they are cast. Not so among solids, and not for single rays.
        """
        n, s = spots.shape
        lone = solids is None or solid_count(solids) == 0
        if not (lone and n > 0 and s > 1 and self.device == "cpu" and self._walks(s)):
            o, d = spots.rays()
            if rank is None:
                return self.cast_bundles(o, d, range_max=range_max, solids=solids, t=t)
            return self.cast_order(o, d, rank, range_max=range_max, solids=solids, t=t)
        if rank is not None and not 1 <= rank <= s:
            raise ValueError(f"{rank}: expected a rank of 1 to {s}, the number of sub-rays")
        first = spots.offsets[0]
        lanes = bundle_lanes(n, np.column_stack([np.ones(s), first[:, 2:4]]))
        shape, need = ((n, s), 0) if rank is None else ((n, 1), rank)
        o = np.asarray(spots.origins, dtype=np.float64)
        found = self._walk(shape, o, spots.axes, lanes, range_max, None, t, s, need, rank is not None, spots)
        return found if rank is None else Hits(*(a[:, 0] for a in _arrays(found)))

    def _nearest(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        count: int,
        only: bool,
        range_max: float,
        solids: Solids | None,
        t: int,
    ) -> Hits:
        """The `count` nearest hits of each bundle, or only the last of these, (n, 1)."""
        o, d = _of_shape(origins, directions, 3)
        n, s = o.shape[:2]
        if not 1 <= count <= s:
            raise ValueError(f"{count}: expected a count of 1 to {s}, the number of sub-rays")
        asked = (n, 1 if only else count)
        if self._walks(s) and o.size:
            need, lanes = (0 if s == 1 else count), bundle_lanes(n, d[0])
            return self._walk(asked, o, d, lanes, range_max, solids, t, s, need, only)
        found = self.cast(o, d, range_max=range_max, solids=solids, t=t)
        all_hits = [a.reshape(n, s) for a in _arrays(found)]
        order = np.argsort(all_hits[0], axis=1, kind="stable")[:, count - asked[1] : count]  # nan sorts last
        return Hits(*(np.take_along_axis(a, order, axis=1) for a in all_hits))

    def cast_image(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        *,
        range_max: float,
        solids: Solids | None = None,
        t: int = 0,
    ) -> Hits:
        """As `cast`, for single rays of an image (rows, columns, 3): all of the result (rows, columns).

        origins: the same shape, or one for all (3,). Neighbours in the image should be so in space, or it is
        slow. Scan lines of single rays count as an image, too.
        """
        d = np.asarray(directions, dtype=np.float64)
        o, d = _of_shape(np.broadcast_to(np.asarray(origins, dtype=np.float64), d.shape), d, 3)
        shape = (int(o.shape[0]), int(o.shape[1]))
        if not self._walks(1):
            return _shaped(self.cast(o, d, range_max=range_max, solids=solids, t=t), shape)
        lanes = image_lanes(*shape, _pitch(d)) if o.size else None
        return self._walk(shape, o, d, lanes, range_max, solids, t)

    def _walks(self, sub_rays: int) -> bool:
        """Does the group walk serve such bundles? Else the plain kernel does, and says so once."""
        if self.device != "cpu":
            return False
        if not can_walk():
            _warn("groups of rays cannot be compiled on this machine: cast one by one, which is slower")
            return False
        if sub_rays > SUB_RAYS_MAX:
            _warn(f"{sub_rays} sub-rays: more than {SUB_RAYS_MAX} are cast one by one, which is slower")
            return False
        return True

    def _walk(
        self,
        shape: tuple[int, int],
        o: F64,
        d: F64,
        lanes: Lanes | None,
        range_max: float,
        solids: Solids | None,
        t: int,
        sub_rays: int = 1,
        need: int = 0,
        only: bool = False,
        spots: Spots | None = None,
    ) -> Hits:
        """Hits of rays, or the `need` nearest of each bundle, or `only` the last of these.

        With spots, o and d are their origins and axes.
        """
        check_range(range_max)
        hits = Hits(*no_hits(shape))
        if lanes is None:
            return hits
        rays = np.ascontiguousarray(o).reshape(-1, 3), np.ascontiguousarray(d).reshape(-1, 3)
        offsets = None if spots is None else np.ascontiguousarray(spots.offsets)
        wp = start_warp()
        scene = self.scene.refresh(wp)
        self.scene.blow(wp, t)
        if self._group_walk is None or self._group_walk.library is not self.field.library:
            self._group_walk = GroupWalk(wp, self.field.library)
        things = None if solids is None or solid_count(solids) == 0 else self.scene.things(wp, solids)
        out = tuple(a.reshape(-1) for a in _arrays(hits))
        task = Task(rays, sub_rays, lanes, float(range_max), need, only, out, offsets)
        doubts = self._group_walk.cast(wp, scene, self.scene.version, things, task, self._crew)
        if doubts:
            o, d = rays if spots is None else spots.rays()
            self._checked(o, d, range_max)  # raises where there is something wrong with them
        return hits

    def _checked(self, origins: ArrayLike, directions: ArrayLike, range_max: float) -> tuple[F64, F64]:
        """Rays as (n, 3) each, after all that `cast` refuses."""
        o = np.ascontiguousarray(origins, dtype=np.float64).reshape(-1, 3)
        d = np.ascontiguousarray(directions, dtype=np.float64).reshape(-1, 3)
        if o.shape != d.shape:
            raise ValueError(f"origins {o.shape} and directions {d.shape}: expected the same shape")
        check_range(range_max)
        if not isfinite(float(o.sum()) + float(d.sum())):  # one bad number spoils the sum
            raise ValueError("expected finite origins and directions")
        if len(d) and np.abs(np.einsum("ij,ij->i", d, d) - 1.0).max() > 1e-3:
            raise ValueError("expected unit directions")
        check_origins(self.field, o)
        return o, d

    def _launch(
        self,
        o: NDArray[np.float64],
        d: NDArray[np.float64],
        range_max: float,
        solids: Solids,
        hits: Hits,
        t: int,
    ) -> None:
        wp = start_warp()
        from swath.rays.kernel.cast import cast

        scene = self.scene.refresh(wp)
        self.scene.blow(wp, t)
        things = self.scene.things(wp, solids)
        rays = [self.scene.share(wp, o, wp.vec3d), self.scene.share(wp, d, wp.vec3d)]
        out = [
            self.scene.share(wp, a, t)
            for a, t in (
                (hits.distance, wp.float32),
                (hits.organ, wp.uint8),
                (hits.cosine, wp.float32),
                (hits.reflectance, wp.float32),
            )
        ]
        n = len(o)
        if self.device != "cpu":
            wp.launch(cast, dim=n, inputs=[scene, things, *rays, range_max, 0, *out], device=self.device)
            for array, target in zip(out, _arrays(hits), strict=True):
                target[:] = array.numpy()
            return

        def run(first: int, count: int) -> None:
            wp.launch(cast, dim=count, inputs=[scene, things, *rays, range_max, first, *out], device="cpu")

        if self._pool is None or n < 2 * CHUNK_MIN:
            run(0, n)
            return
        chunk = max(CHUNK_MIN, -(-n // (8 * self.threads)))
        list(self._pool.map(lambda first: run(first, min(chunk, n - first)), range(0, n, chunk)))


def _shaped(hits: Hits, shape: tuple[int, int]) -> Hits:
    return Hits(*(a.reshape(shape) for a in _arrays(hits)))


def _of_shape(origins: ArrayLike, directions: ArrayLike, ndim: int) -> tuple[F64, F64]:
    o, d = np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)
    if o.shape != d.shape or o.ndim != ndim or o.shape[-1] != 3:
        raise ValueError(f"origins {o.shape} and directions {d.shape}: expected both ({'n, ' * (ndim - 1)}3)")
    return o, d


def _pitch(d: F64) -> tuple[float, float]:
    """Angles between neighbours along rows and columns of an image [rad], medians along its middle."""
    row, column = d[len(d) // 2], d[:, d.shape[1] // 2]
    steps = [np.linalg.norm(np.diff(line, axis=0), axis=-1) for line in (column, row)]
    high, wide = (float(np.median(s)) if len(s) else 0.0 for s in steps)
    return high, wide


@cache
def _warn(text: str) -> None:
    """Say it once."""
    warnings.warn(text, stacklevel=3)


def _arrays(hits: Hits) -> tuple[NDArray[Any], ...]:
    return hits.distance, hits.organ, hits.cosine, hits.reflectance
