"""Objects level `cluster`: what a laser scanner sees above the canopy, followed from scan to scan.

The top of the canopy ahead, and that of the stubble on the cut side where the edge is known, is a straight
line over the distance, fitted so that a thing that covers a few metres of it does not move it. Echoes that
lie well above it are joined with their neighbours, and each heap is followed over the ground. What is lower
than the crop it is in is not found: a fawn, a lying person.
"""

from dataclasses import dataclass
from math import atan2, cos, hypot, sin, tan
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.control.objects.following import FREE, Following
from swath.control.objects.track import Heap, Track
from swath.core.component import Inputs, Outputs, Port
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.signals import F64, CropEdge, Objects, Odometry, Scan
from swath.signals.setup import ControlSetup

CELL = 0.25  # echoes in one cell, or with at most one empty cell between them, are one heap [m]
STRIP = 2.5  # of the distance, over which the top of the canopy is taken [m]
TOP_PERCENTILE = 90.0  # of the heights in a strip
FEWEST = 20  # echoes that make a strip
BEYOND = 0.7  # on the cut side of the edge everything is taken as cut [m]
UNDER = 0.05  # a thing whose top lies less than this above the lowest beam can get lost [rad]


@dataclass(frozen=True)
class Params:
    """reach_m: ahead of the knife; side_m: beside the ends of the header

    above_m: a heap lies so far above the top of the canopy; above_stubble_m: on the cut side, where the edge
    is known, above that of stubble and straw; slope_percent: and so much more by the distance,
    for ground that bends; least_echoes: in a heap
    confirm: scans that show a thing before it counts; keep_s: it is kept so long without being seen
    """

    reach_m: Annotated[float, Gt(0), Le(100)] = 20.0
    side_m: Annotated[float, Ge(0), Le(50)] = 8.0
    above_m: Annotated[float, Gt(0), Le(3)] = 0.35
    above_stubble_m: Annotated[float, Gt(0), Le(3)] = 0.6
    slope_percent: Annotated[float, Ge(0), Le(20)] = 1.5
    least_echoes: Annotated[int, Ge(1), Le(1000)] = 3
    confirm: Annotated[int, Ge(1), Le(20)] = 2
    keep_s: Annotated[float, Ge(0), Le(10)] = 1.0


class Cluster(Following):
    """Takes every scan; the sample holds at the end of the step."""

    inputs = (
        Port("scan", Scan, unit="m", shape=(None,)),
        Port("odometry", Odometry, optional=True),
        Port("edge", CropEdge, optional=True),
    )
    outputs = (Port("objects", Objects),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        super().__init__(setup, "scan", params.side_m, params.confirm, params.keep_s)
        self._p = params

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The objects at t + dt."""
        now = t + dt
        speed, _ = self._go(inputs["odometry"], dt / NS)
        scan: Scan | None = inputs["scan"]
        if scan is not None and scan.t != self._seen:
            self._seen = scan.t
            points = self._points(scan, speed, (now - scan.t) / NS)
            lowest = float(scan.elevation.min())
            heaps = self._heaps(points, inputs["edge"])
            self._tracks.update(now / NS, heaps, lambda track: self._is_under(track, lowest))
        return {"objects": self._sample(now)}

    def _is_under(self, track: Track, lowest: float) -> bool:
        """Whether a thing before the machine lies under the lowest beam, where the scanner is blind."""
        x, y = self._ahead(track)
        if x < self._knife:
            return False
        seen = self._mounting.inverse().apply(np.array([x, y, track.heap.top]))
        return atan2(float(seen[2]), hypot(float(seen[0]), float(seen[1]))) < lowest + UNDER

    def _points(self, scan: Scan, speed: float, age: float) -> F64:
        """Echoes ahead (n, 3) [m], each where it is now, seen from the machine that drove on since."""
        points = self._mounting.apply(scan.points().reshape(-1, 3))
        late = np.repeat(scan.beam_t, scan.ranges.shape[1]) - age
        points[:, 0] += speed * late
        ahead = points[:, 0] - self._knife
        inside = (ahead > FREE) & (ahead < self._p.reach_m)
        inside &= (points[:, 1] > self._strip[0]) & (points[:, 1] < self._strip[1])
        return np.asarray(points[inside])

    def _heaps(self, points: F64, edge: CropEdge | None) -> list[Heap]:
        """What lies above canopy or stubble, in the frame of the dead reckoning."""
        is_cut = np.zeros(len(points), dtype=bool)
        if edge is not None and edge.is_found:
            way = points[:, 0] - edge.reference_x
            line = edge.offset + tan(edge.heading) * way
            is_cut = self._out * (points[:, 1] - line) > BEYOND
        high = [
            self._high(points[is_cut], self._p.above_stubble_m),
            self._high(points[~is_cut], self._p.above_m),
        ]
        heaps = heaps_of(np.concatenate(high))
        return [self._placed(heap) for heap in heaps if len(heap) >= self._p.least_echoes]

    def _high(self, points: F64, above: float) -> F64:
        """Those of the points that lie so far above the top of what most of them are on."""
        top = canopy_top(points[:, 0], points[:, 2])
        if top is None:
            return points[:0]
        base, slope = top
        rise = slope + 0.01 * self._p.slope_percent
        bound = base + slope * self._knife + above + rise * (points[:, 0] - self._knife)
        return np.asarray(points[points[:, 2] > bound])

    def _placed(self, points: F64) -> Heap:
        low, high = points.min(axis=0), points.max(axis=0)
        x, y = (0.5 * (low[:2] + high[:2])).tolist()
        px, py, yaw = self._pose
        c, s = cos(yaw), sin(yaw)
        length, width = np.maximum(high[:2] - low[:2], CELL).tolist()
        return Heap(px + c * x - s * y, py + s * x + c * y, length, width, float(high[2]))


def canopy_top(x: F64, z: F64) -> tuple[float, float] | None:
    """Height at x = 0 [m] and slope of the top of the canopy; None where too little is seen.

    The line through the tops of strips by Theil and Sen: the median slope of all pairs, then the median rest.
    """
    strip = np.floor(x / STRIP).astype(np.int64)
    tops = []
    for k in np.unique(strip):
        of_strip = strip == k
        if np.count_nonzero(of_strip) >= FEWEST:
            top = float(np.percentile(z[of_strip], TOP_PERCENTILE))
            tops.append((float(np.median(x[of_strip])), top))
    if not tops:
        return None
    pairs = [(b - a, v - u) for i, (a, u) in enumerate(tops) for b, v in tops[i + 1 :] if b - a > 1e-3]
    slope = float(np.median([rise / run for run, rise in pairs])) if len(tops) > 2 else 0.0
    return float(np.median([top - slope * at for at, top in tops])), slope


def heaps_of(points: F64) -> list[F64]:
    """Points (n, 3) in heaps: those with at most one empty cell of the ground between them."""
    if len(points) == 0:
        return []
    cells, owner = np.unique(np.floor(points[:, :2] / CELL).astype(np.int64), axis=0, return_inverse=True)
    apart = np.abs(cells[:, None] - cells[None]).max(axis=2)
    label = np.arange(len(cells))
    while True:
        lowest = np.where(apart <= 2, label[None], len(cells)).min(axis=1)
        if (lowest == label).all():
            break
        label = lowest
    of_point = label[owner.ravel()]
    return [points[of_point == k] for k in np.unique(of_point)]


LEVEL = Level(
    Cluster,
    Params,
    summary="heaps of echoes above the canopy of a laser scan, followed from scan to scan",
    cost="0.5 ms per scan",
    tolerance="place of a person within 0.3 m; nothing that is lower than the crop",
)
