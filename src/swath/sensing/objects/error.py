"""Objects level `error`: the truth as a detector gives it, with misses, false alarms, noise and delay."""

from collections import deque
from dataclasses import dataclass
from math import cos, exp, sin
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, Outputs
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import DEG, PERCENT
from swath.field.site_setup import SiteSetup
from swath.sensing.objects.truth import Params as TruthParams
from swath.sensing.objects.truth import TruthObjects
from swath.signals import objects_of

Metres = Annotated[float, Ge(0), Le(10)]
FALSE_SIZE = 0.5  # of what is not there, each way [m]
FALSE_TOP = 1.5  # of it [m]


@dataclass(frozen=True)
class Params(TruthParams):
    """A detector with errors. All numbers are uncited estimates: measure those of your own detector.

    least_visible_m: height that must not be hidden for an object to be seen at all
    miss_percent: share of the looks at what can be seen that miss it
    false_per_h: false alarms per hour
    false_s: mean duration of a false alarm
    position_sd_m: standard deviation of x and y each, near the sensor
    position_sd_percent: standard deviation that is added, of the distance
    velocity_sd_m_s: standard deviation of both components
    delay_s: time from the measurement to the sample
    """

    least_visible_m: Annotated[float, Gt(0), Le(10)] = 0.3
    miss_percent: Annotated[float, Ge(0), Le(100)] = 5.0
    false_per_h: Annotated[float, Ge(0), Le(1e5)] = 2.0
    false_s: Annotated[float, Gt(0), Le(60)] = 0.5
    position_sd_m: Metres = 0.1
    position_sd_percent: Annotated[float, Ge(0), Le(50)] = 1.0
    velocity_sd_m_s: Metres = 0.2
    delay_s: Annotated[float, Ge(0), Le(2)] = 0.1


class ErrorObjects(TruthObjects):
    """Every look draws anew; a false alarm stays at its place before the machine as long as it lasts."""

    kept = ("_false", "_waiting", "_count")

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        super().__init__(params, setup)
        self._e = params

    def reset(self, stream: Stream) -> Outputs:
        """Nothing seen."""
        self._stream = stream
        self._false: list[tuple[float, float, float]] = []  # number, x, y
        self._count = 0
        waiting = round(self._e.delay_s / self._setup.period)
        self._waiting: deque[list[list[float]]] = deque([[] for _ in range(waiting)])
        return super().reset(stream)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The objects that a look some time ago gave; the sample carries the time of the look."""
        e, draw = self._e, self._stream.at(t + dt)
        rows = []
        for row in self.rows(t + dt, inputs["state"]):
            chance = float(draw.random())
            normals: list[float] = draw.standard_normal(4).tolist()
            visible = (1.0 - row[-1]) * row[7]
            if visible < e.least_visible_m or chance < e.miss_percent * PERCENT:
                continue
            sd = e.position_sd_m + e.position_sd_percent * PERCENT * (abs(row[2]) + abs(row[3]))
            spread = {2: sd, 3: sd, 8: e.velocity_sd_m_s, 9: e.velocity_sd_m_s}
            for k, normal in zip(spread, normals, strict=True):
                row[k] += spread[k] * normal
            row[10], row[11] = 1.0 - e.miss_percent * PERCENT, float("nan")
            rows.append(row)
        rows += self._alarms(draw, dt / NS)
        self._waiting.append(rows)
        late = round(e.delay_s / self._setup.period)
        return {"objects": objects_of(max(t + dt - late * dt, 0), self._waiting.popleft())}

    def _alarms(self, draw: np.random.Generator, seconds: float) -> list[list[float]]:
        """What is not there, at this look."""
        e = self._e
        stays = exp(-seconds / e.false_s)
        self._false = [alarm for alarm in self._false if draw.random() < stays]
        for _ in range(int(draw.poisson(e.false_per_h * seconds / 3600.0))):
            away = e.reach_m * float(draw.random()) ** 0.5
            bearing = self._look + e.sector_deg * DEG * (2.0 * float(draw.random()) - 1.0)
            x, y, _ = self.mounting.position.tolist()
            self._count += 1
            self._false.append((-float(self._count), x + away * cos(bearing), y + away * sin(bearing)))
        sure = 1.0 - e.miss_percent * PERCENT
        size = FALSE_SIZE, FALSE_SIZE, FALSE_TOP
        return [[n, 0.0, x, y, 0.0, *size, 0.0, 0.0, sure, float("nan")] for n, x, y in self._false]


LEVEL = Level(
    ErrorObjects,
    Params,
    summary="the truth with misses, false alarms, noise and delay",
    cost="1 ms per look",
    tolerance="equal to truth with every number at 0",
    sees_truth=True,
)
