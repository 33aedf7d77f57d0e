"""Beams against bodies: solids, ground, and the canopy with a drawn depth. One ray per beam."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swath.field.layout import Solids
from swath.field.solids import solid_count
from swath.rays.checks import check_origins, check_range
from swath.rays.device import start_warp
from swath.rays.engine import Castable, Hits, RayCaster
from swath.rays.spread import SpreadTable, double_log

F32 = NDArray[np.float32]
TOP_ROOM = 0.12  # measured heights lie up to this share above the top of the crop
MARGIN = 0.01  # more than that, and than the rounding of tops [m]
PITCH = 0.08  # longest step along a beam through crop [m]: stems lean that far over the edge anyway


@dataclass(frozen=True)
class BodyHits:
    """hits: as of rays; clamped: (n,) bit k is set where a beam left axis k of the table."""

    hits: Hits
    clamped: NDArray[np.int64]


class BodyCaster(RayCaster):
    """Casts one ray per beam; how deep it goes into crop is given for each.

    table: of the spread; crop_height: of the field's crop at scale 1 [m]; exit [m], divergence [rad]: of the
    beam, mean of both directions; pitch: step through crop [m]
    """

    def __init__(
        self,
        field: Castable,
        table: SpreadTable,
        *,
        crop_height: float,
        exit_diameter: float,
        divergence: float,
        pitch: float = PITCH,
    ) -> None:
        super().__init__(field, threads=1)
        self.table = table
        self._numbers = (crop_height, exit_diameter, divergence, pitch)
        self._desk: _Desk | None = None
        self._room, self._roomed = 0.0, -1  # and the revision of the pages that it was taken from
        self._kept: list[Any] = []  # arrays whose memory the kernel reads

    def cast_beams(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        scores: ArrayLike,
        *,
        range_max: float,
        solids: Solids | None = None,
    ) -> BodyHits:
        """Hits of beams within range_max [m].

        origins [m], directions (unit): (n, 3), world; scores: (n,) standard normal numbers, low = high up
        Raises as `RayCaster.cast`.
        """
        o = np.asarray(origins, dtype=np.float64).reshape(-1, 3)
        d = np.asarray(directions, dtype=np.float64).reshape(-1, 3)
        z = np.asarray(scores, dtype=np.float32)
        if o.shape != d.shape or z.shape != o.shape[:1]:
            raise ValueError(f"origins {o.shape}, directions {d.shape}, scores {z.shape}: expected one each")
        if not math.isfinite(o.sum() + d.sum() + z.sum()):  # one bad number spoils the sum
            raise ValueError("expected finite origins, directions and scores")
        check_range(range_max)
        check_origins(self.field, o)
        wp = start_warp()
        if self._desk is None or len(self._desk.out) != len(o):
            self._desk = _Desk(wp, self, len(o))
        out = self._desk.cast(wp, self, (o, d, z), float(range_max), solids or Solids())
        organ = out[:, 1].astype(np.uint8)
        distance = np.where(organ > 0, out[:, 0], np.float32(np.nan))
        return BodyHits(Hits(distance, organ, out[:, 2], out[:, 3]), out[:, 4].astype(np.int64))

    def pack(self, wp: Any) -> Any:
        """The table as the kernel reads it."""
        from swath.rays.kernel.bodies import Canopy

        table, canopy = self.table, Canopy()
        axes = np.concatenate(table.scaled_axes())
        lean = np.ascontiguousarray(table.lean, dtype=np.float32)
        canopy.axes = self._keep(wp, axes)
        canopy.size = wp.vec4i(*(len(a) for a in table.axes))
        canopy.quantile = self._keep(wp, table.quantile.ravel())
        canopy.ground = self._keep(wp, double_log(table.ground_share).ravel())
        canopy.lift = self._keep(wp, table.ground_lift.ravel())
        canopy.node_count = table.quantile.shape[-1]
        canopy.depth = self._keep(wp, table.silhouette)
        canopy.fine = table.fine
        self._kept.append(lean)
        canopy.lean = self._share(wp, lean, wp.vec2)
        canopy.height, canopy.exit, canopy.divergence, canopy.pitch = self._numbers
        canopy.density_max = self.field.library.density_max
        canopy.cosine = table.cosine
        canopy.tangents = wp.vec2(*np.exp(table.scaled_axes()[2][[0, -1]]))
        return canopy

    def scene(self, wp: Any) -> Any:
        """The field as it is now."""
        return self._refresh(wp)

    def room(self) -> float:
        """How far measured heights may lie above the crop of the field as it is now [m]."""
        pages = self.field.pages
        if pages.revision != self._roomed:
            self._room = TOP_ROOM * float(pages.tile_top.max(initial=0.0)) + MARGIN
            self._roomed = pages.revision
        return self._room

    def things(self, wp: Any, solids: Solids) -> Any:
        """Solids as the kernel reads them."""
        return self._things(wp, solids)

    def _keep(self, wp: Any, array: Any) -> Any:
        kept = np.ascontiguousarray(array, dtype=np.float32)
        self._kept.append(kept)
        return self._share(wp, kept, wp.float32)


class _Desk:
    """A prepared launch for a fixed number of beams: what does not change is handed over once."""

    def __init__(self, wp: Any, caster: BodyCaster, count: int) -> None:
        self.rays: tuple[NDArray[Any], ...] = (
            np.zeros((count, 3)),
            np.zeros((count, 3)),
            np.zeros(count, np.float32),
        )
        self.out = np.zeros((count, 5), np.float32)
        kinds = (wp.vec3d, wp.vec3d, wp.float32)
        arrays = [
            wp.array(a, dtype=k, device="cpu", copy=False) for a, k in zip(self.rays, kinds, strict=True)
        ]
        target = wp.array(self.out, dtype=wp.float32, device="cpu", copy=False)
        self.is_empty = True
        self.canopy = caster.pack(wp)
        self.inputs = [None, caster.things(wp, Solids()), self.canopy, *arrays, 0.0, target]
        self.launch: Any = None
        self.range_max = 0.0

    def cast(
        self, wp: Any, caster: BodyCaster, rays: tuple[Any, Any, Any], range_max: float, solids: Solids
    ) -> F32:
        """Rows of distance, organ, cosine, reflectance, clamped; overwritten by the next call."""
        if len(self.out) == 0:
            return self.out
        for kept, new in zip(self.rays, rays, strict=True):
            kept[...] = new
        scene, room = caster.scene(wp), caster.room()
        count = solid_count(solids)
        things = None if count == 0 and self.is_empty else caster.things(wp, solids)
        self.is_empty = count == 0
        is_moved, self.canopy.room = self.canopy.room != room, room
        if self.launch is None:
            from swath.rays.kernel.bodies import cast_bodies

            self.inputs[0], self.inputs[1], self.inputs[6] = scene, things or self.inputs[1], range_max
            self.launch = wp.launch(
                cast_bodies, dim=len(self.out), inputs=self.inputs, device="cpu", record_cmd=True
            )
        else:
            self.launch.set_param_at_index(0, scene)
            if range_max != self.range_max:
                self.launch.set_param_at_index(6, range_max)
            if things is not None:
                self.launch.set_param_at_index(1, things)
            if is_moved:
                self.launch.set_param_at_index(2, self.canopy)
        self.range_max = range_max
        self.launch.launch()
        return self.out
