"""Speed level `joined_ahead`: scanner and map together, each as much as it has proved right.

Both learn what their values weigh, and how far their forecasts were off from what the feeder measured then.
As far as the scanner sees, the forecast is their mean, weighted by the inverse of those squares; where it
sees nothing, the map's alone. What a map says farther ahead does not slow a machine whose scanner sees.
"""

from dataclasses import dataclass

from swath.control.speed.guards import GUARD_INPUTS
from swath.control.speed.look_ahead import LookAhead
from swath.control.speed.look_ahead import Params as LookParams
from swath.control.speed.map_ahead import MapAhead
from swath.control.speed.map_ahead import Params as MapParams
from swath.core.component import Inputs, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.signals import CropAhead, EngineState, FeedReading, FieldMap, Odometry
from swath.signals.setup import ControlSetup

LEAST = 1e-4  # square of a relative error: nothing counts as better


@dataclass(frozen=True, kw_only=True)
class Params(LookParams):
    """As for `look_ahead`; power is of what the scanner sees, a map's value counts as it is."""


class JoinedAhead(LookAhead):
    """Two sights, that learn side by side; the law itself is that of `look_ahead`."""

    kept = ("_speed", "_distance", "_eye", "_map", "_guard")

    inputs = (
        Port("odometry", Odometry),
        Port("map", FieldMap),
        Port("ahead", CropAhead),
        Port("feed", FeedReading, optional=True),
        Port("engine", EngineState, optional=True),
        *GUARD_INPUTS,
    )

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        super().__init__(params, setup)
        keys = vars(params) | {"power": 1.0}
        self._eye, self._map = LookAhead(params, setup), MapAhead(MapParams(**keys), setup)

    def reset(self, stream: Stream) -> Outputs:
        """Nothing seen, nothing learned."""
        for sight in (self._eye, self._map):
            sight.reset(stream)
        return super().reset(stream)

    def _look(self, now: int, inputs: Inputs, speed: float) -> None:
        for sight in (self._eye, self._map):
            sight._distance = self._distance
            sight._look(now, inputs, speed)

    def _learn(self, t: int, speed: float, feed: FeedReading | None, h: float) -> None:
        for sight in (self._eye, self._map):
            sight._learn(t, speed, feed, h)

    @property
    def has_learned(self) -> bool:
        """Whether one of them has."""
        return self._eye.has_learned or self._map.has_learned

    def rates(self, begin: float) -> list[tuple[float, float]]:
        """As of one sight: where the scanner saw, else where the map has places."""
        eye, chart = (dict(s.rates(begin)) if s.has_learned else {} for s in (self._eye, self._map))
        found = []
        for gap in sorted(eye or chart):
            rows = [
                (max(sight._miss, LEAST), rate)
                for sight, own in ((self._eye, eye), (self._map, chart))
                if (rate := _at(own, gap)) is not None
            ]
            if rows:
                total = 1.0 / rows[0][0] + (1.0 / rows[1][0] if len(rows) > 1 else 0.0)
                both = rows[0][1] / rows[0][0] + (rows[1][1] / rows[1][0] if len(rows) > 1 else 0.0)
                found.append((gap, both / total))
        return found


def _at(rates: dict[float, float], gap: float) -> float | None:
    """The rate at a way ahead: of the last place before it, if the sight reaches so far."""
    if not rates or gap > max(rates):
        return None
    before = [at for at in rates if at <= gap]
    return rates[max(before)] if before else None


LEVEL = Level(
    JoinedAhead,
    Params,
    summary="constant throughput from scanner and map, each weighted by how right it was so far",
    cost="200 us per step",
    tolerance="in time for what comes; on measured crop between scanner and feed_rate (docs/how-to/field.md)",
)
