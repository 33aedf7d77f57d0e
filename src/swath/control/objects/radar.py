"""Objects level `radar`: detections of a radar, followed from look to look.

A detection counts when its radial speed, less what the machine's own motion makes of it, is one that a thing
on a field can have, and a thing when several looks have shown it: so most false alarms go.
"""

from dataclasses import dataclass
from math import atan2, hypot
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.control.objects.following import FREE, Following, on_ground
from swath.control.objects.track import Heap, Track
from swath.core.component import Inputs, Outputs, Port
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import DEG
from swath.signals import F64, Objects, Odometry
from swath.signals.radar import RadarTargets
from swath.signals.setup import ControlSetup

SIZE = 0.5  # of a detection, which has none [m]


@dataclass(frozen=True)
class Params:
    """Objects among the detections of a radar.

    reach_m: farthest object ahead of the knife
    side_m: farthest object beside the ends of the header
    fastest_m_s: greatest speed over ground along the line of sight
    least_snr_db: least signal-to-noise ratio of a detection
    least_rcs_dbsm: least radar cross section of a detection; crop and its edge beside the path lie below it
    confirm: number of measurements that must show an object before it is reported
    keep_s: time for which an object is kept without being seen
    view_deg: field of view to both sides of the radar's axis
    near_m: distance below which low objects lie under the beam; one that gets there, before the knife, is
        kept where it was
    """

    reach_m: Annotated[float, Gt(0), Le(200)] = 30.0
    side_m: Annotated[float, Ge(0), Le(50)] = 8.0
    fastest_m_s: Annotated[float, Gt(0), Le(50)] = 4.0
    least_snr_db: Annotated[float, Ge(-20), Le(60)] = 0.0
    least_rcs_dbsm: Annotated[float, Ge(-60), Le(40)] = -18.0
    confirm: Annotated[int, Ge(1), Le(20)] = 4
    keep_s: Annotated[float, Ge(0), Le(10)] = 0.6
    view_deg: Annotated[float, Gt(0), Le(90)] = 42.0
    near_m: Annotated[float, Ge(0), Le(20)] = 5.0


class RadarObjects(Following):
    """Takes every look; the sample holds at the end of the step."""

    inputs = (Port("targets", RadarTargets), Port("odometry", Odometry, optional=True))
    outputs = (Port("objects", Objects),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        super().__init__(setup, "targets", params.side_m, params.confirm, params.keep_s)
        self._p = params

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The objects at t + dt."""
        now = t + dt
        speed, turn = self._go(inputs["odometry"], dt / NS)
        targets: RadarTargets | None = inputs["targets"]
        if targets is not None and targets.t > self._seen:
            self._seen = targets.t
            place = self._moved(speed, turn, (targets.t - now) / NS)  # where the machine was at the look
            points = self._points(targets, speed, turn)
            self._tracks.update(targets.t / NS, [_heap(p, place) for p in points], self._is_out_of_view)
        return {"objects": self._sample(now)}

    def _is_out_of_view(self, track: Track) -> bool:
        """Whether a thing before the knife lies beside the field of view, or maybe under it."""
        x, y = self._ahead(track)
        seen = self._mounting.inverse().apply(np.array([x, y, track.heap.top]))
        bearing = atan2(float(seen[1]), float(seen[0]))
        is_near = hypot(float(seen[0]), float(seen[1])) < self._p.near_m
        return x > self._knife and (is_near or abs(bearing) > self._p.view_deg * DEG)

    def _points(self, targets: RadarTargets, speed: float, turn: float) -> F64:
        """Detections ahead that may be things (n, 3) [m], in the machine's frame at the look."""
        seen = targets.points()
        ray = self._mounting.turn(seen)
        x, y, _ = self._mounting.position.tolist()
        own = (speed - turn * y) * ray[:, 0] + turn * x * ray[:, 1]
        over_ground = targets.radial_speed + own / np.maximum(targets.range, 1e-3)
        points = self._mounting.apply(seen)
        ahead = points[:, 0] - self._knife
        good = (ahead > FREE) & (ahead < self._p.reach_m) & (np.abs(over_ground) < self._p.fastest_m_s)
        good &= (points[:, 1] > self._strip[0]) & (points[:, 1] < self._strip[1])
        good &= ~(targets.snr < self._p.least_snr_db) & ~(targets.rcs < self._p.least_rcs_dbsm)
        return np.asarray(points[good])


def _heap(point: F64, place: tuple[float, float, float]) -> Heap:
    """A detection over the ground, from a machine there."""
    x, y, z = point.tolist()
    return Heap(*on_ground(x, y, place), SIZE, SIZE, z)


LEVEL = Level(
    RadarObjects,
    Params,
    summary="detections of a radar, followed from look to look",
    cost="0.2 ms per look",
    tolerance="place of a person within 0.6 m; height and size not known",
)
