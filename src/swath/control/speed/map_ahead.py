"""Speed level `map_ahead`: as `look_ahead`, by a map of the field instead of a scanner."""

from collections import deque
from dataclasses import dataclass

from swath.control.speed.guards import GUARD_INPUTS
from swath.control.speed.look_ahead import KEPT, LookAhead
from swath.control.speed.look_ahead import Params as LookParams
from swath.core.component import Inputs, Port
from swath.core.registry import Level
from swath.signals import EngineState, FeedReading, FieldMap, Odometry


@dataclass(frozen=True, kw_only=True)
class Params(LookParams):
    """smooth_m is not used here, a map is smooth; the factor is learned as for a scanner."""


class MapAhead(LookAhead):
    """Feed-forward on the map, whose factor is learned: a map that is too high everywhere does no harm."""

    inputs = (
        Port("odometry", Odometry),
        Port("map", FieldMap),
        Port("feed", FeedReading, optional=True),
        Port("engine", EngineState, optional=True),
        *GUARD_INPUTS,
    )

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


LEVEL = Level(
    MapAhead,
    Params,
    summary="constant throughput from a map of the field, its mass per value learned from the feeder",
    cost="60 us per step",
    tolerance="in time for what comes, as good as the map",
)
