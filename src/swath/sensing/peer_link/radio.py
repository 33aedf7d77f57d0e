"""Peer link level `radio`: messages that come late, get lost, end with the range, and carry position errors.

The rate of the slot (`rate_hz`) is that of the messages.
"""

from collections import deque
from dataclasses import dataclass
from math import exp, hypot, sqrt
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, Outputs
from swath.core.frozen import changed
from swath.core.random import Normals, Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.field.site_setup import SiteSetup
from swath.sensing.peer_link.ideal import IdealLink, silence
from swath.signals import PeerState


@dataclass(frozen=True)
class Params:
    """A radio between two machines.

    delay_ms: time from that for which a message is valid to its arrival
    loss_percent: share of the messages that are lost
    range_m: distance beyond which nothing arrives
    position_sd_cm: standard deviation of the relative position, each axis
    correlation_s: time over which the error of the position changes
    ahead_error_m: calibration error of antennas and box, along the machine
    left_error_m: calibration error of antennas and box, leftward
    silent_from_s: begin of a time in which nothing arrives, to try it out
    silent_for_s: duration of that time
    """

    delay_ms: Annotated[float, Ge(0), Le(5000)] = 100.0
    loss_percent: Annotated[float, Ge(0), Le(100)] = 0.0
    range_m: Annotated[float, Gt(0), Le(1e5)] = 500.0
    position_sd_cm: Annotated[float, Ge(0), Le(1000)] = 1.5
    correlation_s: Annotated[float, Gt(0), Le(1e4)] = 60.0
    ahead_error_m: Annotated[float, Ge(-5), Le(5)] = 0.0
    left_error_m: Annotated[float, Ge(-5), Le(5)] = 0.0
    silent_from_s: Annotated[float, Ge(0)] | None = None
    silent_for_s: Annotated[float, Ge(0)] = 1e9


class RadioLink(IdealLink):
    """A queue of messages under way."""

    kept = ("_last", "_queue", "_newest", "_error")

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        super().__init__(params, setup)
        self._p = params
        self._share = exp(-setup.period / params.correlation_s)

    def reset(self, stream: Stream) -> Outputs:
        """Nothing under way."""
        self._normals = Normals(stream)
        self._queue: deque[tuple[int, PeerState]] = deque()
        self._newest: PeerState | None = None
        sd = self._p.position_sd_cm * 0.01
        ex, ey = self._normals.at(0, 2).tolist()
        self._error = (sd * ex, sd * ey)
        return super().reset(stream)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Send the message of now, if it gets through, and hand over the newest that has arrived."""
        now = t + dt
        ex, ey = self._normals.at(now, 2).tolist()
        message = self._with_error(self.message(now, inputs), ex, ey)
        if self._gets_through(now, message, self._normals.then_uniform()):
            self._queue.append((now + round(self._p.delay_ms * 1e6), message))
        while self._queue and self._queue[0][0] <= now:
            _, self._newest = self._queue.popleft()
        if self._newest is None:
            return {"peer": silence(now)}
        age = self._newest.age + (now - self._newest.t) / NS
        return {"peer": changed(self._newest, t=now, age=age)}

    def _gets_through(self, now: int, message: PeerState, draw: float) -> bool:
        p, lost = self._p, draw * 100.0 < self._p.loss_percent
        since = -1.0 if p.silent_from_s is None else now / NS - p.silent_from_s
        is_silent = p.silent_from_s is not None and 0.0 <= since < p.silent_for_s
        return not lost and not is_silent and hypot(message.x, message.y) <= p.range_m

    def _with_error(self, message: PeerState, dx: float, dy: float) -> PeerState:
        """First-order Gauss-Markov errors on top of those of calibration."""
        p, keep = self._p, self._share
        fresh = p.position_sd_cm * 0.01 * sqrt(1.0 - keep * keep)
        ex, ey = keep * self._error[0] + fresh * dx, keep * self._error[1] + fresh * dy
        self._error = ex, ey
        return changed(message, x=message.x + ex + p.ahead_error_m, y=message.y + ey + p.left_error_m)


LEVEL = Level(
    RadioLink,
    Params,
    summary="rate, delay, loss and range of a radio, errors of position and calibration",
    cost="0.1 ms per message",
    tolerance="equal to ideal with every number at 0",
)
