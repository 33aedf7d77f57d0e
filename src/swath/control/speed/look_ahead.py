"""Speed level `look_ahead`: constant throughput, from the crop that a scanner sees ahead of the knife, from a
map of the field, or from both.

The speed falls in time for what comes. How much throughput a forecast means is learned from the feeder, after
the crop has gone in:

- A scanner sees an amount (height times extinction, or height alone). One factor is learned for it, kg/m2 per
  amount.
- A map with correlation r to what stands says r of its differences: who acts on them in full makes the
  throughput vary by sqrt(2 (1 - r)) of the crop's variation, who acts on what the map says by sqrt(1 - r^2).
  So a line is learned, throughput per distance over the map's value: its height over `learn_m`, its slope
  over `slope_m` from what differs from the last `learn_m`. A map that says nothing of that gets the slope
  0, and the law follows the measured throughput alone.
- Where both have learned, the forecast is their mean as far as the scanner sees, each weighted by the inverse
  of the square by which its own forecasts were off. What a map says farther ahead does not slow a machine
  whose scanner sees.

`map_ahead` and `joined_ahead` are the same law with the inputs that they need.
"""

from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass
from math import exp, fsum, isfinite, sqrt
from typing import Annotated, ClassVar, TypeVar

from annotated_types import Ge, Gt, Le

from swath.control.speed.guards import GUARD_INPUTS, Guards
from swath.control.speed.throughput_target import Common, has_crop, ramped, room
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import KMH
from swath.signals import CropAhead, CropEdge, EngineState, FeedReading, FieldMap, Odometry, SpeedCommand
from swath.signals.setup import ControlSetup

Row = TypeVar("Row", bound=tuple[float, ...])
KEPT = 200  # places and past moments that are remembered
SPACING = 0.25  # between remembered places [m]
JUDGED_M = 60.0  # distance over which it is judged how good a forecast is [m]
UNTRIED = 0.04  # square of the relative error of a forecast that was not tried yet
BEST = 1e-4  # square of a relative error: nothing counts as better
TRUSTED_M = 20.0  # distance that proportion counts as in the slope, for a map that varies by TRUSTED_CV
TRUSTED_CV = 0.1
SLOWEST = 0.1  # m/s, slower no throughput is compared with a map


@dataclass(frozen=True, kw_only=True)
class Params(Common):
    """What is learned, and over which distances.

    sensor_delay_s: from the knife to the throughput sensor
    lead_s: how much earlier to act, for the drive
    smooth_m: distance over which what a scanner sees is averaged (a map is smooth)
    learn_m: distance over which the factor, or the height of a map's line, is learned
    slope_m: distance over which it is learned how much of a map's differences comes true
    power: throughput goes with amount^power of what a scanner sees, above 1 where dense crop hides itself.
    """

    sensor_delay_s: Annotated[float, Ge(0), Le(20)] = 2.8
    lead_s: Annotated[float, Ge(0), Le(5)] = 1.2
    smooth_m: Annotated[float, Ge(0), Le(50)] = 2.5
    learn_m: Annotated[float, Gt(0), Le(1000)] = 15.0
    slope_m: Annotated[float, Gt(0), Le(10_000)] = 300.0
    power: Annotated[float, Gt(0), Le(3)] = 1.0


@dataclass(frozen=True, kw_only=True)
class MapParams(Params):
    """As of `look_ahead`, learning faster.

    learn_m: distance over which the height of a map's line is learned
    """

    learn_m: Annotated[float, Gt(0), Le(1000)] = 5.0


class Forecast(KeepsState, ABC):
    """What is known of the crop ahead, by distance of the knife, and what it has proved to weigh.

    missed: square of the relative error of its forecasts, over the last `JUDGED_M`
    """

    kept: ClassVar[tuple[str, ...]] = ("_seen_t", "_places", "missed")

    def __init__(self, params: Params, knife: float) -> None:
        self._p, self._knife = params, knife

    def reset(self) -> None:
        """Nothing seen, nothing learned."""
        self._seen_t, self.missed = -1, UNTRIED
        self._places: deque[tuple[float, float]] = deque(maxlen=KEPT)  # distance of the knife, value there

    @abstractmethod
    def look(self, now: int, distance: float, speed: float, inputs: Inputs) -> None:
        """Take in what was sent. distance: driven [m] at `now` [ns]."""

    @abstractmethod
    def learn(self, t: int, distance: float, speed: float, feed: FeedReading | None, h: float) -> None:
        """Compare what is measured at t [ns] with what was cut when that crop came in. h: seconds."""

    @property
    @abstractmethod
    def has_learned(self) -> bool:
        """Whether what is known has a weight."""

    @abstractmethod
    def rate_of(self, value: float) -> float:
        """Throughput per distance [kg/m] where that much stands."""

    def rates(self, begin: float) -> list[tuple[float, float]]:
        """Distance ahead of `begin` [m] and throughput per distance there [kg/m]; none before it learned."""
        if not self.has_learned:
            return []
        places = [(0.0, self._value_at(begin))] + [(s - begin, a) for s, a in self._places if s > begin]
        return [(gap, self.rate_of(a)) for gap, a in places if isfinite(a) and a > 0.0]

    def _value_at(self, distance: float) -> float:
        """At the nearest known place before a distance; nan = not seen."""
        return next((a for place, a in reversed(self._places) if place <= distance), float("nan"))

    def _cut_then(self, t: int, past: "deque[Row]") -> Row | None:
        """What was noted when the crop that is measured at t came in."""
        then = t - round(self._p.sensor_delay_s * NS)
        return next((row for row in reversed(past) if row[0] <= then), None)

    def _judge(self, flow: float, measured: float, way: float) -> None:
        wrong = (flow - measured) / self._p.throughput_kg_s
        slow = exp(-way / JUDGED_M)
        self.missed = slow * self.missed + (1.0 - slow) * wrong * wrong


class Seen(Forecast):
    """Throughput ahead by a scanner; one factor is learned."""

    kept = (*Forecast.kept, "_raw", "_past", "_sums")

    def reset(self) -> None:
        """Nothing seen, nothing learned."""
        super().reset()
        self._raw: deque[tuple[float, float]] = deque(maxlen=KEPT)  # as places, not smoothed
        self._past: deque[tuple[float, float]] = deque(maxlen=KEPT)  # time, amount cut per second
        self._sums = 0.0, 0.0

    @property
    def factor(self) -> float:
        """kg/s of throughput per amount cut per second; 0 = nothing learned yet."""
        return self._sums[1] / self._sums[0] if self._sums[0] > 0.0 else 0.0

    @property
    def has_learned(self) -> bool:
        """Whether the factor is known."""
        return self.factor > 0.0

    def rate_of(self, value: float) -> float:
        """Throughput by the factor."""
        return self.factor * value

    def look(self, now: int, distance: float, speed: float, inputs: Inputs) -> None:
        """Remember the amount at the place where it was seen, `now` minus its time ago."""
        ahead: CropAhead | None = inputs.get("ahead")
        edge: CropEdge | None = inputs["edge"]
        amount = at = float("nan")
        if ahead is not None:
            t, amount, at = ahead.t, ahead.amount, ahead.ahead
        elif edge is not None:
            t, amount, at = edge.t, edge.crop_height, edge.reference_x
        if not isfinite(amount) or t == self._seen_t:
            return
        self._seen_t = t
        place = distance - speed * (now - t) / NS + at - self._knife
        if self._raw and place - self._raw[-1][0] < SPACING:
            return
        self._raw.append((place, max(amount, 0.0) ** self._p.power))
        near = [a for s, a in self._raw if s >= place - self._p.smooth_m]
        self._places.append((place - 0.5 * self._p.smooth_m, fsum(near) / len(near)))

    def learn(self, t: int, distance: float, speed: float, feed: FeedReading | None, h: float) -> None:
        """The factor, over the last `learn_m`."""
        amount = self._value_at(distance)
        self._past.append((t, amount * speed if isfinite(amount) else float("nan")))
        if feed is None or not has_crop(self._p, feed):
            return
        _, cut = self._cut_then(t, self._past) or (0, float("nan"))
        if isfinite(cut) and cut > 0.0:
            if self.has_learned:
                self._judge(self.factor * cut, feed.flow, speed * h)
            kept = exp(-speed * h / self._p.learn_m)
            self._sums = self._sums[0] * kept + cut * cut, self._sums[1] * kept + cut * feed.flow


class Mapped(Forecast):
    """Throughput ahead by a map; a line from its yield to the throughput is learned.

    A map that is too high everywhere does no harm, nor does one that says nothing.
    """

    kept = (*Forecast.kept, "_cut", "_long", "_short")

    def reset(self) -> None:
        """Nothing seen, nothing learned."""
        super().reset()
        self._cut: deque[tuple[float, float, float]] = deque(maxlen=KEPT)  # time, value of the map, speed
        self._long = (
            0.0,
            0.0,
        )  # over the distance: square of the value above its mean, product with the rate's
        self._short = (0.0, 0.0, 0.0)  # distance, and over it value, rate

    @property
    def has_learned(self) -> bool:
        """Whether the line is known."""
        return self._short[0] > 0.0 and self._short[1] > 0.0

    @property
    def slope(self) -> float:
        """kg/m of throughput per distance over the map's value: regression, at first proportion."""
        w, m, r = self._short
        spread, together = self._long
        trusted = TRUSTED_M * (TRUSTED_CV * m / w) ** 2
        return max((together + trusted * r / m) / (spread + trusted), 0.0)

    def rate_of(self, value: float) -> float:
        """Throughput by the line."""
        w, m, r = self._short
        return max(r / w + self.slope * (value - m / w), 0.1 * r / w)

    def look(self, now: int, distance: float, speed: float, inputs: Inputs) -> None:
        """What lies nearer than the map's first place stays, all farther is what the newest map says."""
        seen: FieldMap | None = inputs.get("map")
        if seen is None or seen.t == self._seen_t:
            return
        self._seen_t = seen.t
        begin = distance - speed * (now - seen.t) * 1e-9 - self._knife
        ahead = list(zip((begin + seen.ahead).tolist(), seen.grain.tolist(), strict=True))
        near = [row for row in self._places if row[0] < ahead[0][0]]
        self._places = deque([*near, *ahead], maxlen=KEPT)

    def learn(self, t: int, distance: float, speed: float, feed: FeedReading | None, h: float) -> None:
        """The line, its height over `learn_m` and its slope over `slope_m`."""
        self._cut.append((t, self._value_at(distance), speed))
        if feed is None or not has_crop(self._p, feed):
            return
        _, value, went = self._cut_then(t, self._cut) or (0, float("nan"), 0.0)
        if not isfinite(value) or value <= 0.0 or went < SLOWEST:
            return
        rate, travel = feed.flow / went, speed * h
        if self.has_learned:
            self._judge(self.rate_of(value) * went, feed.flow, travel)
        kept = exp(-travel / self._p.learn_m)
        w, m, r = (
            kept * old + travel * new for old, new in zip(self._short, (1.0, value, rate), strict=True)
        )
        self._short = (w, m, r)
        kept, more, higher = exp(-travel / self._p.slope_m), value - m / w, rate - r / w
        spread, together = self._long
        self._long = kept * spread + travel * more * more, kept * together + travel * more * higher


class LookAhead(KeepsState):
    """Feed-forward on the crop ahead, with weights that are learned."""

    kept: ClassVar[tuple[str, ...]] = ("_speed", "_distance", "_forecasts", "_guard")

    inputs: tuple[Port, ...] = (
        Port("odometry", Odometry),
        Port("map", FieldMap, optional=True),
        Port("ahead", CropAhead, optional=True),
        Port("feed", FeedReading, optional=True),
        Port("engine", EngineState, optional=True),
        *GUARD_INPUTS,
    )
    outputs = (Port("command", SpeedCommand),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._p = params
        self._guard = Guards(params, setup.machine)
        knife = setup.machine.knife_x
        self._forecasts: dict[str, Forecast] = {"seen": Seen(params, knife), "mapped": Mapped(params, knife)}

    def reset(self, stream: Stream) -> Outputs:
        """Entry speed, nothing seen, nothing learned."""
        self._guard.reset()
        for forecast in self._forecasts.values():
            forecast.reset()
        self._speed = self._p.entry_speed_kmh * KMH
        self._distance = 0.0
        return {"command": SpeedCommand(0, self._speed)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The next command, valid at t + dt."""
        h = dt / NS
        odometry: Odometry = inputs["odometry"]
        self._distance += odometry.speed * h
        for forecast in self._forecasts.values():
            forecast.look(t + dt, self._distance, odometry.speed, inputs)
        for forecast in self._forecasts.values():
            forecast.learn(t + dt, self._distance, odometry.speed, inputs["feed"], h)
        wanted = self._wanted(inputs["feed"], inputs["engine"])
        self._speed = ramped(self._p, self._speed, wanted, h)
        speed = self._guard.limit(self._speed, inputs, dt)
        return {"command": SpeedCommand(t + dt, speed)}

    def end_reason(self, t: int) -> str:
        """Why the run ends: the machine stopped because it no longer saw the edge."""
        return self._guard.reason

    def _wanted(self, feed: FeedReading | None, engine: EngineState | None) -> float:
        """Speed [m/s] that keeps the throughput now and at every place ahead, slowing down in time."""
        p, entry = self._p, self._p.entry_speed_kmh * KMH
        if not any(forecast.has_learned for forecast in self._forecasts.values()):
            free = room(p, feed, engine)
            return entry if free is None or not has_crop(p, feed) else self._speed
        fall = p.slow_kmh_s * KMH
        speeds = [
            sqrt((p.throughput_kg_s / rate) ** 2 + 2.0 * fall * gap)
            for gap, rate in self.rates(self._distance + self._speed * p.lead_s)
        ]
        wanted = min(speeds, default=entry)
        if engine is not None and engine.load > 1e-2 * p.engine_load_percent:
            wanted = min(wanted, self._speed * p.engine_load_percent * 1e-2 / engine.load)
        return wanted

    def rates(self, begin: float) -> list[tuple[float, float]]:
        """Distance ahead of `begin` [m] and throughput per distance there [kg/m], by all that is known."""
        seen, mapped = (self._forecasts.get(name) for name in ("seen", "mapped"))
        eye, chart = ([] if f is None else f.rates(begin) for f in (seen, mapped))
        if not seen or not mapped or not eye or not chart:
            return eye or chart
        at, sd2 = dict(chart), [max(f.missed, BEST) for f in (seen, mapped)]
        found = []
        for gap, rate in sorted(dict(eye).items()):
            before = [place for place in at if place <= gap]
            if before and gap <= chart[-1][0]:
                rate = (rate / sd2[0] + at[max(before)] / sd2[1]) / (1.0 / sd2[0] + 1.0 / sd2[1])
            found.append((gap, rate))
        return found


def _with(*needed: str, without: tuple[str, ...] = ()) -> tuple[Port, ...]:
    """Inputs of `look_ahead`, of which some must be connected and others are not there."""
    ports = [port for port in LookAhead.inputs if port.name not in without]
    return tuple(Port(p.name, p.signal) if p.name in needed else p for p in ports)


class MapAhead(LookAhead):
    """Look ahead by a map alone."""

    inputs = _with("map", without=("ahead",))

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        super().__init__(params, setup)
        del self._forecasts["seen"]


class JoinedAhead(LookAhead):
    """Look ahead by scanner and map, both of which must be there."""

    inputs = _with("map", "ahead")


LEVEL = Level(
    LookAhead,
    Params,
    summary="constant throughput from the crop ahead, seen or mapped, its weight learned from the feeder",
    cost="about 20 us per step, 200 us with a map",
    tolerance="in time for what comes, as good as the sight; the factor lags by `learn_m`",
)
PRESETS = {
    "map_ahead": Level(
        MapAhead,
        MapParams,
        summary="`look_ahead` by a map, which must be there",
        cost="80 us per step",
        tolerance="in time for what comes, as good as the map",
    ),
    "joined_ahead": Level(
        JoinedAhead,
        Params,
        summary="`look_ahead` by scanner and map, which must both be there",
        cost="200 us per step",
        tolerance="in time for what comes; on measured crop between scanner and feed_rate (how-to/field)",
    ),
}
