"""Rays against a field: many at once, on all cores, the same bits for any number of threads."""

import warnings
from functools import cache
from math import frexp, isfinite, ldexp
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swath.field.field import Field
from swath.field.memory_layout import Solids
from swath.field.solid.solids import NOTHING, solid_count
from swath.rays.device import ThreadPool, ray_device, start_warp, thread_count
from swath.rays.field_arrays import LiveScene
from swath.rays.hits import CastOptions, Hits, Spots
from swath.rays.packets.packing import SUB_RAYS_MAX, Packing, pack_bundles, pack_image, pack_parallel
from swath.rays.packets.traversal import PacketTraversal, can_compile
from swath.rays.refusals import check_origins, check_range

F64 = NDArray[np.float64]
Rays = tuple[ArrayLike, ArrayLike]
CHUNK_MIN = 1024  # fewer rays than this are not worth another thread
NOT_COMPILED = "ray packets cannot be compiled on this machine: cast one by one, which is slower"


class RayCaster:
    """Casts rays into a field.

    threads: CPU threads, default SWATH_THREADS or all cores
    device: `cpu`, `cuda` or `cuda:0`, `cuda:1` ..., default SWATH_DEVICE or `cpu`; notes: what its user
        should know, each once. On the CPU the kernels read the field's own memory. On another device the
        plain kernel runs, on a copy of that memory that is renewed after each change.
    """

    def __init__(self, field: Field, *, threads: int | None = None, device: str | None = None) -> None:
        self.field = field
        self.threads = thread_count() if threads is None else threads
        self.device = ray_device(device)
        self.scene = LiveScene(field, self.device)
        self._pool = ThreadPool(self.threads)
        self._packets: PacketTraversal | None = None
        self.notes: list[str] = []

    @property
    def index_bytes(self) -> int:
        """Memory of the search index of ray packets [bytes], 0 before it is made."""
        return 0 if self._packets is None else self._packets.index.byte_count

    def cast(self, origins: ArrayLike, directions: ArrayLike, **options: Unpack[CastOptions]) -> Hits:
        """Nearest hit of each ray by the plain kernel, one ray after the other.

        origins [m], directions (unit): (n, 3), world frame. A ray that starts inside an organ or a solid does
        not see it; a ray that leaves the known pages sees only solids. Raises ValueError on rays that are
        not finite or not of unit length; InputError on a range that is not > 0 and on rays that start under
        the ground or where no page is in memory.
        """
        o, d = self._checked(origins, directions, options["range_max"])
        hits = Hits.uninitialised((len(o),), options.get("normals", False))
        if len(o):
            self._launch(o, d, hits, options)
        return hits

    def cast_solids(
        self, origins: ArrayLike, directions: ArrayLike, *, range_max: float, solids: Solids, normals: bool
    ) -> Hits:
        """As `cast`, against solids alone: crop and ground are not there, rays may start anywhere."""
        o, d = (np.ascontiguousarray(v, dtype=np.float64).reshape(-1, 3) for v in (origins, directions))
        hits = Hits.uninitialised((len(o),), normals)
        if len(o):
            self._hit_solids(o, d, range_max, solids, hits)
        return hits

    def _hit_solids(self, o: F64, d: F64, range_max: float, solids: Solids, hits: Hits) -> None:
        """Nearest solid of each ray, (n, 3) or (1, 3) for all."""
        from swath.rays.kernel.solids_alone import cast_solids

        wp = start_warp()
        self._run(wp, cast_solids, [self.scene.solid_arrays(wp, solids)], o, d, range_max, hits)

    def cast_bundles(self, bundles: Spots | Rays, **options: Unpack[CastOptions]) -> Hits:
        """As `cast`, for the sub-rays of beams: origins and directions (n, s, 3), or `Spots`, which are
        made into rays where they are cast; all of the result (n, s).

        Bundles side by side go through the crop together as packets (docs/explanation/lidar.md).
        Whatever the rays are, they hit what `cast` says they hit; it only pays when the sub-rays of a bundle
        lie close together.
        More than 512 sub-rays go through `cast`, and so do all rays on another device than the CPU.
        """
        if isinstance(bundles, Spots):
            n, s = bundles.shape
            is_lone = solid_count(options.get("solids") or NOTHING) == 0
            if is_lone and n > 0 and s > 1 and self._has_packets(s):
                return self._traverse((n, s), bundles, pack_bundles(n, s), options)
            bundles = bundles.rays()
        o, d = _of_shape(*bundles)
        n, s = o.shape[:2]
        if not self._has_packets(s):
            return self.cast(o, d, **options).reshaped((n, s))
        packing = pack_bundles(n, s) if o.size else None
        return self._traverse((n, s), (np.ascontiguousarray(o), d), packing, options)

    def cast_image(self, origins: ArrayLike, directions: ArrayLike, **options: Unpack[CastOptions]) -> Hits:
        """As `cast`, for single rays of an image (rows, columns, 3): all of the result (rows, columns).

        origins: the same shape, or one for all (3,). Neighbours in the image should be so in space, or it is
        slow. Scan lines of single rays count as an image, too.
        """
        start = np.ascontiguousarray(origins, dtype=np.float64)
        o, d = _of_shape(
            np.broadcast_to(start, np.shape(directions)) if start.shape == (3,) else start, directions
        )
        shape = (int(d.shape[0]), int(d.shape[1]))
        if not self._has_packets(1):
            return self.cast(o, d, **options).reshaped(shape)
        packing = pack_image(*shape, _pitch_ratio(d)) if d.size else None
        return self._traverse(shape, (start, d), packing, options)

    def cast_parallel(self, origins: F64, direction: F64, **options: Unpack[CastOptions]) -> Hits:
        """As `cast`, for rays from (n, 3) in one direction (3,): what is close together goes as packets."""
        o, ways = np.ascontiguousarray(origins), np.broadcast_to(direction, origins.shape)
        if len(o) == 0 or not self._has_packets(1):
            return self.cast(o, ways, **options)
        rays = o, np.ascontiguousarray(direction)
        return self._traverse((len(o),), rays, pack_parallel(o, direction), options)

    def _has_packets(self, sub_rays: int) -> bool:
        """Can such bundles be cast as packets? Else the plain kernel serves, and a warning says so once."""
        if self.device != "cpu":
            return False
        if not can_compile():
            _warn(NOT_COMPILED)
            self.notes = [NOT_COMPILED]
            return False
        if sub_rays > SUB_RAYS_MAX:
            _warn(f"{sub_rays} sub-rays: more than {SUB_RAYS_MAX} are cast one by one, which is slower")
            return False
        return True

    def _traverse(
        self,
        shape: tuple[int, ...],
        rays: Spots | tuple[F64, F64],
        packing: Packing | None,
        options: CastOptions,
    ) -> Hits:
        """Hits of rays that go as packets; None: there are no rays."""
        range_max, solids = options["range_max"], options.get("solids") or NOTHING
        check_range(range_max)
        hits = Hits.uninitialised(shape, options.get("normals", False))
        if packing is None:
            return hits
        wp = start_warp()
        scene = self.scene.refresh(wp)
        self.scene.set_wind(wp, options.get("t", 0))
        if self._packets is None or self._packets.library is not self.field.library:
            self._packets = PacketTraversal(wp, self.field.library, self._pool)
        flat, has_solids = hits.reshaped((-1,)), solid_count(solids) > 0
        if has_solids and not isinstance(rays, Spots):
            o, d = (np.ascontiguousarray(a).reshape(-1, 3) for a in rays)
            self._hit_solids(o, d, range_max, solids, flat)
        flags = self._packets.cast(
            scene, self.scene.version, rays, packing, float(range_max), has_solids, flat
        )
        if flags:  # raises where there is something wrong with the rays
            o, d = rays.rays() if isinstance(rays, Spots) else rays
            o, d = np.broadcast_arrays(o, d)
            self._checked(o, d, range_max)
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

    def _launch(self, o: F64, d: F64, hits: Hits, options: CastOptions) -> None:
        """The plain kernel."""
        wp = start_warp()
        from swath.rays.kernel.cast import cast

        scene = self.scene.refresh(wp, cells=True)
        self.scene.set_wind(wp, options.get("t", 0))
        solids = self.scene.solid_arrays(wp, options.get("solids") or NOTHING)
        self._run(wp, cast, [scene, solids], o, d, options["range_max"], hits)

    def _run(self, wp: Any, kernel: Any, scene: list[Any], o: F64, d: F64, reach: float, hits: Hits) -> None:
        """A kernel of single rays over all of them."""
        from swath.rays.kernel.solids_alone import BLOCK

        rays = [self.scene.share(wp, o, wp.vec3d), self.scene.share(wp, d, wp.vec3d)]
        kinds = (wp.float32, wp.uint8, wp.float32, wp.float32, wp.vec3)
        out = [self.scene.share(wp, a, kind) for a, kind in zip(hits.arrays, kinds, strict=True)]

        def run(first: int, count: int) -> None:
            inputs = [*scene, *rays, float(reach), first, *out]
            wp.launch(kernel, dim=count, inputs=inputs, device=self.device, block_dim=BLOCK)

        if self.device == "cpu":
            self._pool.split(len(hits.organ), CHUNK_MIN, run)
            return
        run(0, len(hits.organ))
        for array, target in zip(out, hits.arrays, strict=True):
            target[:] = array.numpy()


def _of_shape(origins: ArrayLike, directions: ArrayLike) -> tuple[F64, F64]:
    o, d = np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)
    if o.shape != d.shape or o.ndim != 3 or o.shape[-1] != 3:
        raise ValueError(f"origins {o.shape} and directions {d.shape}: expected both (n, n, 3)")
    return o, np.ascontiguousarray(d)


def _pitch_ratio(d: F64) -> float:
    """Angle between neighbours along columns of an image over that along rows, medians along its middle, to a
    power of two; 1 where there is none.
    """
    if min(d.shape[:2]) < 2:
        return 1.0
    row, column = d[len(d) // 2], d[:, d.shape[1] // 2]
    steps = [np.linalg.norm(np.diff(line, axis=0), axis=-1) for line in (column, row)]
    high, wide = (float(np.median(s)) for s in steps)
    if min(high, wide) <= 0.0:
        return 1.0
    share, power = frexp(high / wide)  # share: 0.5 to 1
    return ldexp(1.0, min(max(power if share * share > 0.5 else power - 1, -16), 16))


@cache
def _warn(text: str) -> None:
    """Say it once."""
    warnings.warn(text, stacklevel=3)
