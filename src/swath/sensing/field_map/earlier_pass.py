"""Field map level `earlier_pass`: what this machine, or another one, measured today beside the place.

Measured on wheat logs, values of passes d apart correlate as r = 0.82 exp(-d / 60 m) (docs/how-to/field.md).
So the best guess at a place is the mean of all, plus r of the difference of what was measured near it.
"""

from collections import deque
from dataclasses import dataclass
from math import exp
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core import portable
from swath.core.component import Inputs, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.field.site_setup import SiteSetup
from swath.sensing.field_map.places import Answer, LocatedMap, PlaceParams
from swath.signals import F64, Fix, Odometry, YieldReading

NEAR, RANGE_M = 0.82, 60.0  # correlation of passes side by side, and over which distance it falls to 1/e
BEHIND = 400  # past places that are kept until their grain is measured


@dataclass(frozen=True)
class Params(PlaceParams):
    """delay_s: from the knife to the yield sensor; apart_m: between kept values; least_m: nearer ones are of
    the present pass and are left out; width_m: of the header that measured, none = the machine's own
    """

    delay_s: Annotated[float, Ge(0), Le(60)] = 12.0
    apart_m: Annotated[float, Gt(0), Le(100)] = 4.0
    least_m: Annotated[float, Ge(0), Le(100)] = 6.0
    width_m: Annotated[float, Gt(0), Le(30)] | None = None


class EarlierPass(LocatedMap):
    """`passed`: fixes of the machine that measures `grain`, by default the own ones."""

    inputs = (
        Port("fix", Fix),
        Port("odometry", Odometry, optional=True),
        Port("grain", YieldReading),
        Port("passed", Fix),
    )
    kept: ClassVar[tuple[str, ...]] = ("_heading", "_behind", "_values")

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        super().__init__(params, setup)
        self._e = params
        self._width = params.width_m or setup.machine.header_width

    def reset(self, stream: Stream) -> Outputs:
        """Nothing measured."""
        self._behind: deque[tuple[int, float, float, float]] = deque(maxlen=BEHIND)  # t, x, y, speed
        self._values: list[tuple[float, float, float, int]] = []  # x, y, kg/m2, t
        return super().reset(stream)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Take in what was measured, then look ahead."""
        self._take(t + dt, inputs["passed"], inputs["grain"])
        return super().step(t, dt, inputs)

    def _take(self, now: int, fix: Fix | None, reading: YieldReading | None) -> None:
        if fix is None or not np.isfinite(fix.x):
            return
        if not self._behind or fix.t > self._behind[-1][0]:
            self._behind.append((fix.t, fix.x, fix.y, fix.speed))
        then = now - round(self._e.delay_s * NS)
        cut = next((row for row in reversed(self._behind) if row[0] <= then), None)
        if reading is None or cut is None or not cut[3] > 0.3:
            return
        _, x, y, speed = cut
        if self._values and np.hypot(x - self._values[-1][0], y - self._values[-1][1]) < self._e.apart_m:
            return
        self._values.append((x, y, reading.flow / (self._width * speed), now))

    def look_up(self, t: int, x: F64, y: F64, heading: float) -> Answer:
        """The guess at points, and how good it is."""
        nothing = np.full(len(x), np.nan)
        if len(self._values) < 3:
            return Answer(nothing, nothing, nothing)
        px, py, value, when = (np.array(column, dtype=float) for column in zip(*self._values, strict=True))
        away = np.hypot(x[:, None] - px, y[:, None] - py)
        weight = np.where(away >= self._e.least_m, portable.exp(-3.0 * away / RANGE_M), 0.0)
        total = weight.sum(axis=1)
        known = total > exp(-9.0)
        safe = np.maximum(total, 1e-12)
        local, age = ((weight * a).sum(axis=1) / safe for a in (value, t - when))
        nearest = np.where(weight > 0.0, away, np.inf).min(axis=1)
        r = NEAR * portable.exp(-np.where(known, nearest, 0.0) / RANGE_M)
        mean, sd = float(value.mean()), float(value.std())
        guess = mean + r * (local - mean)
        left = sd * np.sqrt(1.0 - r * r)
        return Answer(*(np.where(known, a, np.nan) for a in (guess, left, age / NS)))


LEVEL = Level(
    EarlierPass,
    Params,
    "what was measured today in the passes beside, weighed by their distance",
    cost="1 ms",
    tolerance="share 0.82 exp(-d / 60 m) of what was measured d beside",
)
