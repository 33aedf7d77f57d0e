"""What both throughput controls share: how fast the wanted speed may change, and the error they work on."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Gt, Le

from swath.control.speed.guards import Guarded
from swath.core.errors import InputError
from swath.core.units import KMH, PERCENT
from swath.signals import EngineState, FeedReading

Speed = Annotated[float, Gt(0), Le(40)]
CROP_SHARE = 0.1  # below this share of the wanted throughput there is no crop in the machine


@dataclass(frozen=True, kw_only=True)
class Common(Guarded):
    """A throughput that is held.

    throughput_kg_s: wanted throughput of grain and straw
    engine_load_percent: engine load that is not to be exceeded
    entry_speed_kmh: speed as long as no crop comes
    min_speed_kmh: least speed
    max_speed_kmh: greatest speed
    ramp_kmh_s: largest change up, 0.2-0.4 in practice (uncited estimate)
    slow_kmh_s: largest change down
    """

    throughput_kg_s: Annotated[float, Gt(0), Le(200)] = 39.0
    engine_load_percent: Annotated[float, Gt(0), Le(100)] = 95.0
    entry_speed_kmh: Speed = 5.0
    min_speed_kmh: Speed = 1.5
    max_speed_kmh: Speed = 10.0
    ramp_kmh_s: Speed = 0.3
    slow_kmh_s: Speed = 1.0

    def __post_init__(self) -> None:
        if self.min_speed_kmh > self.max_speed_kmh:
            expected = f"expected <= max_speed_kmh = {self.max_speed_kmh:g}"
            raise InputError("min_speed_kmh", self.min_speed_kmh, expected)


def room(p: Common, feed: FeedReading | None, engine: EngineState | None) -> float | None:
    """Share of the wanted throughput that is still free, the less of feed and engine; None = nothing known.

    < 0 where there is too much.
    """
    free = [] if feed is None else [1.0 - feed.flow / p.throughput_kg_s]
    if engine is not None:
        free.append(1.0 - engine.load / (p.engine_load_percent * PERCENT))
    return min(free) if free else None


def has_crop(p: Common, feed: FeedReading | None) -> bool:
    """True when crop comes in, or nobody knows."""
    return feed is None or feed.flow >= CROP_SHARE * p.throughput_kg_s


def ramped(p: Common, speed: float, wanted: float, dt: float) -> float:
    """The next speed [m/s] on the way to a wanted one, within ramps and bounds."""
    rise, fall = p.ramp_kmh_s * KMH * dt, p.slow_kmh_s * KMH * dt
    near = min(max(wanted, speed - fall), speed + rise)
    return min(max(near, p.min_speed_kmh * KMH), p.max_speed_kmh * KMH)
