"""How fast a machine may drive by the objects that it knows of: it stops before what is in its way."""

from dataclasses import dataclass
from math import sqrt
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.core.component import KeepsState
from swath.core.schedule import NS
from swath.signals import Objects, Odometry
from swath.signals.setup import MachineGeometry

AHEAD_S = 6.0  # what would come into the way later is let be [s]
BESIDE = 1.0  # an object whose middle lies farther behind the knife is past [m]


@dataclass(frozen=True)
class Stop:
    """What a speed law does before objects. Without the slot `objects` it does nothing.

    gap_m: distance left between the knife and an object where the machine stands
    side_m: width beside the ends of the header that is kept free too
    brake_m_s2: deceleration that it counts on
    react_s: time until it brakes
    sure: confidence from which on an object counts [1]
    hold_s: time for which it still stands after the path is free again
    """

    gap_m: Annotated[float, Ge(0), Le(50)] = 2.5
    side_m: Annotated[float, Ge(0), Le(20)] = 1.0
    brake_m_s2: Annotated[float, Gt(0), Le(10)] = 0.6
    react_s: Annotated[float, Ge(0), Le(5)] = 1.2
    sure: Annotated[float, Gt(0), Le(1)] = 0.5
    hold_s: Annotated[float, Ge(0), Le(60)] = 2.0


class ObstacleStop(KeepsState):
    """Bounds a wanted speed by the objects ahead, each where it will be as it goes on."""

    kept = ("_hold",)

    def __init__(self, params: Stop, machine: MachineGeometry) -> None:
        self._p, self._knife = params, machine.knife_x
        ends = [machine.header_end(side)[1] for side in ("right", "left")]
        self._lane = ends[0] - params.side_m, ends[1] + params.side_m
        self.reset()

    def reset(self) -> None:
        """Nothing in the way."""
        self._hold = 0.0  # left to stand [s]

    def limit(
        self,
        wanted: float,
        objects: Objects | None,
        odometry: Odometry | None,
        dt: int,
        other: float = float("inf"),
    ) -> float:
        """The speed [m/s] that may be driven instead of a wanted one, over the next `dt` [ns].

        other: what another law allows
        """
        if objects is None:
            return min(other, wanted)
        speed = wanted if odometry is None else max(odometry.speed, 0.0)
        bound = wanted
        for k in range(len(objects.x)):
            if objects.confidence[k] >= self._p.sure:
                bound = min(bound, self._bound(objects, k, speed))
        self._hold = self._p.hold_s if bound <= 0.0 else max(self._hold - dt / NS, 0.0)
        return min(other, 0.0 if self._hold > 0.0 else bound)

    def _bound(self, objects: Objects, k: int, speed: float) -> float:
        """Greatest speed because of one object."""
        p = self._p
        x, y, vx, vy = (float(a[k]) for a in (objects.x, objects.y, objects.velocity_x, objects.velocity_y))
        reach = 0.5 * max(float(objects.length[k]), float(objects.width[k]))
        ahead = x - reach - self._knife
        if x < self._knife - BESIDE:
            return float("inf")
        until = min(max(ahead, 0.0) / max(speed - vx, 0.3), AHEAD_S)
        low, high = sorted((y, y + vy * until))
        if high + reach < self._lane[0] or low - reach > self._lane[1]:
            return float("inf")
        comes = max(-vx, 0.0) * (p.react_s + speed / p.brake_m_s2)
        free = ahead - p.gap_m - comes
        # v react + v^2 / (2 brake) = free
        b = p.brake_m_s2
        return 0.0 if free <= 0.0 else sqrt((b * p.react_s) ** 2 + 2.0 * b * free) - b * p.react_s
