"""Speed level `map_ahead`: as `look_ahead`, by a map of the field instead of a scanner.

A map with correlation r to what stands tells r of its differences: who acts on them in full makes the
throughput vary by sqrt(2 (1 - r)) of the crop's variation, who acts on what the map tells by sqrt(1 - r^2).
So the law learns from the feeder a line, throughput per way over the map's value: its height over `learn_m`,
its slope over `slope_m` from what differs from the last `learn_m`. A map that tells nothing of that gets the
slope 0, and the law follows the measured throughput alone.
"""

from collections import deque
from dataclasses import dataclass
from math import exp, isfinite
from typing import Annotated

from annotated_types import Gt, Le

from swath.control.speed.guards import GUARD_INPUTS
from swath.control.speed.look_ahead import JUDGED_M, KEPT, LookAhead
from swath.control.speed.look_ahead import Params as LookParams
from swath.control.speed.throughput_target import has_crop
from swath.core.component import Inputs, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.signals import EngineState, FeedReading, FieldMap, Odometry
from swath.signals.setup import ControlSetup

TRUSTED_M = 20.0  # way that proportion counts as in the slope, for a map that varies by TRUSTED_CV
TRUSTED_CV = 0.1
SLOWEST = 0.1  # m/s, slower no throughput is compared


@dataclass(frozen=True, kw_only=True)
class Params(LookParams):
    """smooth_m is not used here, a map is smooth
    slope_m: distance over which it is learned how much of the map's differences comes true
    """

    learn_m: Annotated[float, Gt(0), Le(1000)] = 5.0
    slope_m: Annotated[float, Gt(0), Le(10_000)] = 300.0


class MapAhead(LookAhead):
    """Feed-forward on the map, whose weight is learned: a map that is too high everywhere does no harm, nor
    does one that tells nothing."""

    kept = (*LookAhead.kept, "_cut", "_long", "_short")

    inputs = (
        Port("odometry", Odometry),
        Port("map", FieldMap),
        Port("feed", FeedReading, optional=True),
        Port("engine", EngineState, optional=True),
        *GUARD_INPUTS,
    )

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        super().__init__(params, setup)
        self._m = params

    def reset(self, stream: Stream) -> Outputs:
        """Entry speed, nothing seen, nothing learned."""
        self._cut: deque[tuple[int, float, float]] = deque(maxlen=KEPT)  # time, value of the map, speed
        self._long = (0.0, 0.0)  # over the way: square of the value above its mean, product with the rate's
        self._short = (0.0, 0.0, 0.0)  # way, and over it value, rate
        return super().reset(stream)

    def _look(self, now: int, inputs: Inputs, speed: float) -> None:
        """What lies nearer than the map's first place stays, all farther is what the newest map says."""
        seen: FieldMap | None = inputs["map"]
        if seen is None or seen.t == self._seen_t:
            return
        self._seen_t = seen.t
        begin = self._distance - speed * (now - seen.t) * 1e-9 - self._knife
        ahead = list(zip((begin + seen.ahead).tolist(), seen.grain.tolist(), strict=True))
        near = [row for row in self._places if row[0] < ahead[0][0]]
        self._places = deque([*near, *ahead], maxlen=KEPT)

    def _learn(self, t: int, speed: float, feed: FeedReading | None, h: float) -> None:
        """Compare what is measured now with what the map said of the crop that came in then."""
        self._cut.append((t, self._amount_at(self._distance), speed))
        if feed is None or not has_crop(self._p, feed):
            return
        then = t - round(self._p.sensor_delay_s * NS)
        _, value, went = next((row for row in reversed(self._cut) if row[0] <= then), (0, float("nan"), 0.0))
        if not isfinite(value) or value <= 0.0 or went < SLOWEST:
            return
        rate, way = feed.flow / went, speed * h
        if self.has_learned:
            wrong = (self._rate_of(value) * went - feed.flow) / self._p.throughput_kg_s
            slow = exp(-way / JUDGED_M)
            self._miss = slow * self._miss + (1.0 - slow) * wrong * wrong
        kept = exp(-way / self._p.learn_m)
        w, m, r = (kept * old + way * new for old, new in zip(self._short, (1.0, value, rate), strict=True))
        self._short = (w, m, r)
        kept, more, higher = exp(-way / self._m.slope_m), value - m / w, rate - r / w
        spread, together = self._long
        self._long = kept * spread + way * more * more, kept * together + way * more * higher

    @property
    def has_learned(self) -> bool:
        """Whether the map has a weight."""
        return self._short[0] > 0.0 and self._short[1] > 0.0

    @property
    def slope(self) -> float:
        """kg/m of throughput per way over the map's value: regression, at first proportion."""
        _, m, r = self._short
        w, (spread, together) = self._short[0], self._long
        trusted = TRUSTED_M * (TRUSTED_CV * m / w) ** 2
        return max((together + trusted * r / m) / (spread + trusted), 0.0)

    def _rate_of(self, value: float) -> float:
        """Throughput per way [kg/m] where the map says so much."""
        w, m, r = self._short
        return max(r / w + self.slope * (value - m / w), 0.1 * r / w)

    def rates(self, begin: float) -> list[tuple[float, float]]:
        """As of a scanner: way ahead of a distance [m] and throughput there per way [kg/m]."""
        places = [(0.0, self._amount_at(begin))] + [(s - begin, a) for s, a in self._places if s > begin]
        return [(gap, self._rate_of(a)) for gap, a in places if isfinite(a) and a > 0.0]


LEVEL = Level(
    MapAhead,
    Params,
    summary="constant throughput from a map, what its differences are worth learned from the feeder",
    cost="80 us per step",
    tolerance="in time for what comes, as good as the map",
)
