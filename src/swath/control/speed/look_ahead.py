"""Speed level `look_ahead`: constant throughput, from the crop that is seen ahead of the knife.

Seen is an amount (height times extinction, or height alone); how many kg/m2 one of it is, is learned from the
throughput that is measured after the crop has gone in. The speed falls in time for what comes.
"""

from collections import deque
from dataclasses import dataclass
from math import exp, fsum, isfinite, sqrt
from typing import Annotated, ClassVar

from annotated_types import Ge, Gt, Le

from swath.control.speed.guards import GUARD_INPUTS, Guards
from swath.control.speed.throughput_target import Common, has_crop, ramped, room
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import KMH
from swath.signals import CropAhead, CropEdge, EngineState, FeedReading, Odometry, SpeedCommand
from swath.signals.setup import ControlSetup

KEPT = 200  # places and past moments that are remembered
SPACING = 0.25  # between remembered places [m]
JUDGED_M = 60.0  # way over which it is judged how good a sight is [m]
UNTRIED = 0.04  # square of the relative error of a sight that was not tried yet


@dataclass(frozen=True, kw_only=True)
class Params(Common):
    """sensor_delay_s: from the knife to the throughput sensor; lead_s: how much earlier to act, for the drive
    smooth_m: distance over which what is seen is averaged; learn_m: distance over which the factor is learned
    power: throughput goes with amount^power, above 1 where dense crop hides itself
    """

    sensor_delay_s: Annotated[float, Ge(0), Le(20)] = 2.8
    lead_s: Annotated[float, Ge(0), Le(5)] = 1.2
    smooth_m: Annotated[float, Ge(0), Le(50)] = 2.5
    learn_m: Annotated[float, Gt(0), Le(1000)] = 15.0
    power: Annotated[float, Gt(0), Le(3)] = 1.0


class LookAhead(KeepsState):
    """Feed-forward on the crop ahead, with a factor that is learned."""

    kept: ClassVar[tuple[str, ...]] = (
        "_speed",
        "_distance",
        "_seen_t",
        "_raw",
        "_places",
        "_past",
        "_sums",
        "_miss",
        "_guard",
    )

    inputs: tuple[Port, ...] = (
        Port("odometry", Odometry),
        Port("feed", FeedReading, optional=True),
        Port("engine", EngineState, optional=True),
        Port("ahead", CropAhead, optional=True),
        *GUARD_INPUTS,
    )
    outputs = (Port("command", SpeedCommand),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._p = params
        self._guard = Guards(params, setup.machine)
        self._knife = setup.machine.knife_x

    def reset(self, stream: Stream) -> Outputs:
        """Entry speed, nothing seen, nothing learned."""
        self._guard.reset()
        self._speed = self._p.entry_speed_kmh * KMH
        self._distance, self._seen_t = 0.0, -1
        self._raw: deque[tuple[float, float]] = deque(maxlen=KEPT)  # distance of the knife, amount there
        self._places: deque[tuple[float, float]] = deque(maxlen=KEPT)  # the same, smoothed
        self._past: deque[tuple[int, float]] = deque(maxlen=KEPT)  # time, amount cut per second
        self._sums, self._miss = (0.0, 0.0), UNTRIED
        return {"command": SpeedCommand(0, self._speed)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The next command, valid at t + dt."""
        p, h = self._p, dt / NS
        odometry: Odometry = inputs["odometry"]
        self._distance += odometry.speed * h
        self._look(t + dt, inputs, odometry.speed)
        self._learn(t + dt, odometry.speed, inputs["feed"], h)
        wanted = self._wanted(inputs["feed"], inputs["engine"])
        self._speed = ramped(p, self._speed, wanted, h)
        speed = self._guard.limit(self._speed, inputs, dt)
        return {"command": SpeedCommand(t + dt, speed)}

    def end_reason(self, t: int) -> str:
        """Why the run ends: the machine stopped because it no longer saw the edge."""
        return self._guard.reason

    @property
    def factor(self) -> float:
        """kg/s of throughput per amount cut per second; 0 = nothing learned yet."""
        return self._sums[1] / self._sums[0] if self._sums[0] > 0.0 else 0.0

    def _look(self, now: int, inputs: Inputs, speed: float) -> None:
        """Remember the amount at the place where it was seen, `now` minus its time ago."""
        ahead: CropAhead | None = inputs["ahead"]
        edge: CropEdge | None = inputs["edge"]
        amount = at = float("nan")
        if ahead is not None:
            t, amount, at = ahead.t, ahead.amount, ahead.ahead
        elif edge is not None:
            t, amount, at = edge.t, edge.crop_height, edge.reference_x
        if not isfinite(amount) or t == self._seen_t:
            return
        self._seen_t = t
        place = self._distance - speed * (now - t) / NS + at - self._knife
        if self._raw and place - self._raw[-1][0] < SPACING:
            return
        self._raw.append((place, max(amount, 0.0) ** self._p.power))
        near = [a for s, a in self._raw if s >= place - self._p.smooth_m]
        self._places.append((place - 0.5 * self._p.smooth_m, fsum(near) / len(near)))

    def _learn(self, t: int, speed: float, feed: FeedReading | None, h: float) -> None:
        """Compare what is measured now with what was cut when that crop came in."""
        amount = self._amount_at(self._distance)
        self._past.append((t, amount * speed if isfinite(amount) else float("nan")))
        if feed is None or not has_crop(self._p, feed):
            return
        then = t - round(self._p.sensor_delay_s * NS)
        cut = next((a for at, a in reversed(self._past) if at <= then), float("nan"))
        if isfinite(cut) and cut > 0.0:
            kept = exp(-speed * h / self._p.learn_m)
            if self.factor > 0.0:
                wrong = (self.factor * cut - feed.flow) / self._p.throughput_kg_s
                slow = exp(-speed * h / JUDGED_M)
                self._miss = slow * self._miss + (1.0 - slow) * wrong * wrong
            self._sums = self._sums[0] * kept + cut * cut, self._sums[1] * kept + cut * feed.flow

    def _amount_at(self, distance: float) -> float:
        """Amount at a distance travelled by the knife, the nearest place before it; nan = not seen."""
        return next((a for place, a in reversed(self._places) if place <= distance), float("nan"))

    @property
    def has_learned(self) -> bool:
        """Whether what is seen has a weight."""
        return self.factor > 0.0

    def rates(self, begin: float) -> list[tuple[float, float]]:
        """Way ahead of a distance [m] and throughput there per speed [kg/m], of all that is seen."""
        factor = self.factor
        places = [(0.0, self._amount_at(begin))] + [(s - begin, a) for s, a in self._places if s > begin]
        return [(gap, factor * a) for gap, a in places if isfinite(a) and a > 0.0]

    def _wanted(self, feed: FeedReading | None, engine: EngineState | None) -> float:
        """Speed [m/s] that keeps the throughput now and at every place ahead, slowing down in time."""
        p, entry = self._p, self._p.entry_speed_kmh * KMH
        if not self.has_learned:
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


LEVEL = Level(
    LookAhead,
    Params,
    summary="constant throughput from the crop seen ahead, its mass per sight learned from the feeder",
    cost="about 20 us per step",
    tolerance="in time for what comes, as good as the sight; the factor lags by `learn_m`",
)
