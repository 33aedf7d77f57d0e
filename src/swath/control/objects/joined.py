"""Objects level `joined`: what `cluster` finds in the scans of a laser scanner, and `radar` in its looks.

Each follows for itself. A thing of both has place, size and velocity of the scanner and more confidence;
what one of them has alone is there with its own.
"""

from dataclasses import dataclass, field, fields
from typing import Annotated, Any

import numpy as np
from annotated_types import Gt, Le

from swath.control.objects.cluster import Cluster
from swath.control.objects.cluster import Params as LidarParams
from swath.control.objects.radar import Params as RadarParams
from swath.control.objects.radar import RadarObjects
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.signals import Objects, objects_of
from swath.signals.radar import RadarTargets
from swath.signals.setup import ControlSetup

FIELDS = [field.name for field in fields(Objects) if field.name != "t"]


@dataclass(frozen=True)
class Params:
    """LiDAR and radar together.

    lidar: keys of level `cluster`
    radar: keys of level `radar`
    gate_m: distance up to which a find of each is one object
    """

    lidar: LidarParams = field(default_factory=LidarParams)
    radar: RadarParams = field(default_factory=RadarParams)
    gate_m: Annotated[float, Gt(0), Le(10)] = 1.2


class Joined(KeepsState):
    """Numbers of what the radar alone follows are negative."""

    kept = ("_lidar", "_radar")

    inputs = (*Cluster.inputs, Port("targets", RadarTargets))
    outputs = (Port("objects", Objects),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._gate = params.gate_m
        self._lidar = Cluster(params.lidar, setup)
        self._radar = RadarObjects(params.radar, setup)

    def reset(self, stream: Stream) -> Outputs:
        """Nothing seen."""
        self._radar.reset(stream)
        return self._lidar.reset(stream)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The objects at t + dt."""
        parts = (self._lidar, self._radar)
        seen, echoes = (_rows(part.step(t, dt, inputs)["objects"]) for part in parts)
        k = {name: index for index, name in enumerate(FIELDS)}
        for echo in echoes:
            near = [row for row in seen if _apart(row, echo, k) <= self._gate and row[k["number"]] > 0.0]
            if near:
                row = min(near, key=lambda row: _apart(row, echo, k))
                sure = row[k["confidence"]], echo[k["confidence"]]
                row[k["confidence"]] = 1.0 - (1.0 - sure[0]) * (1.0 - sure[1])
            else:
                echo[k["number"]] *= -1.0
                seen.append(echo)
        return {"objects": objects_of(t + dt, seen)}


def _rows(objects: Any) -> list[list[float]]:
    columns = [np.asarray(getattr(objects, name), dtype=np.float64) for name in FIELDS]
    return [list(row) for row in zip(*(c.tolist() for c in columns), strict=True)]


def _apart(a: list[float], b: list[float], k: dict[str, int]) -> float:
    """Between the middles of two objects [m]."""
    return float(np.hypot(a[k["x"]] - b[k["x"]], a[k["y"]] - b[k["y"]]))


LEVEL = Level(
    Joined,
    Params,
    summary="heaps of a laser scan and detections of a radar, each followed, then joined",
    cost="1 ms per scan",
    tolerance="place of a person within 0.3 m where the scanner sees it, else 0.6 m",
)
