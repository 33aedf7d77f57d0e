"""Steering level `actuator`: electro-hydraulic angle servo of the steered axle.

Dead time, then a proportional valve with a dead band, a largest oil flow and a first-order approach:

    w = (wanted - angle) / (lag * rate_max)                   wanted valve opening
    rate = rate_max * sat(sign(w) * max(0, |w| - b) / (1 - b))  b = dead band

Solved exactly between the instants at which delayed commands arrive, so the step size does not enter. The
dead band leaves a rest error of b * lag * rate_max (0.12 deg with the numbers of the large combine).
"""

from collections import deque
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le, Lt

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import DEG, PERCENT
from swath.field.site_setup import SiteSetup
from swath.machine.loops import approach
from swath.machine.machine_sheet import dynamics_of
from swath.machine.steering.ideal import wanted_angle
from swath.signals import SteerCommand, SteerState


@dataclass(frozen=True)
class Params:
    """What is left out comes from the machine's sheet.

    rate_deg_s: fastest turn of the equivalent wheel; dead_time_s: from command to first motion; lag_s: time
    constant of the approach; dead_band_percent: of the valve's full opening
    """

    rate_deg_s: Annotated[float, Gt(0), Le(200)] | None = None
    dead_time_s: Annotated[float, Ge(0), Le(5)] | None = None
    lag_s: Annotated[float, Gt(0), Le(5)] | None = None
    dead_band_percent: Annotated[float, Ge(0), Lt(90)] | None = None


class Actuator(KeepsState):
    """Angle servo with a queue of commands that have not arrived yet."""

    kept = ("_angle", "_wanted", "_seen", "_queue")

    inputs = (Port("command", SteerCommand),)
    outputs = (Port("steering", SteerState),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        d = dynamics_of(setup.machine)
        self._machine = setup.machine
        self._rate_max = d.steer_rate if params.rate_deg_s is None else params.rate_deg_s * DEG
        self._lag = d.steer_lag if params.lag_s is None else params.lag_s
        dead_time = d.steer_dead_time if params.dead_time_s is None else params.dead_time_s
        self._dead_time = round(dead_time * NS)
        band = params.dead_band_percent
        self._band = d.steer_dead_band if band is None else band * PERCENT
        self._full = self._lag * self._rate_max  # error at which the valve is fully open [rad]
        self._rest = self._band * self._lag * self._rate_max  # and up to which it stays closed

    def reset(self, stream: Stream) -> Outputs:
        """Wheels straight, nothing under way."""
        self._angle = self._wanted = 0.0
        self._seen = -1
        self._queue: deque[tuple[int, SteerCommand]] = deque()
        return {"steering": SteerState(0, 0.0, 0.0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Turn towards what was wanted a dead time ago, arrival by arrival."""
        command: SteerCommand = inputs["command"]
        if command.t != self._seen:
            self._seen = command.t
            self._queue.append((command.t + self._dead_time, command))
        now, end = t, t + dt
        while self._queue and self._queue[0][0] < end:
            arrival, arrived = self._queue.popleft()
            self._turn(max(0, arrival - now))
            now = max(now, arrival)
            self._wanted = wanted_angle(arrived, self._machine, self._angle)
        self._turn(end - now)
        return {"steering": SteerState(end, self._angle, self._rate())}

    def _turn(self, duration: int) -> None:
        error, rest = self._wanted - self._angle, self._rest
        if duration <= 0 or -rest <= error <= rest:
            return
        target = self._wanted - (rest if error > 0 else -rest)
        lag = self._lag * (1.0 - self._band)
        self._angle, _ = approach(self._angle, target, duration / NS, lag=lag, limit=self._rate_max)

    def _rate(self) -> float:
        opening, band = (self._wanted - self._angle) / self._full, self._band
        if -band <= opening <= band:
            return 0.0
        flow = min(1.0, (abs(opening) - band) / (1.0 - band))
        return self._rate_max * (flow if opening > 0 else 0.0 - flow)


LEVEL = Level(
    Actuator,
    Params,
    summary="dead time, rate limit, first-order lag and valve dead band",
    cost="about 4 us per step",
    tolerance="exact solution of its equations at any step",
)
