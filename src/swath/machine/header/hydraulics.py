"""Sensors, control law and cylinders of the header: each exact over a step for an input held over it."""

from collections import deque
from copy import copy
from math import exp

import numpy as np

from swath.core.component import KeepsState
from swath.core.frames import Array
from swath.core.schedule import NS


class Delayed(KeepsState):
    """Readings, (n,), through a first-order smoothing and a delay.

    lag [s]; delay [ns]; between samples the smoothed values are taken as straight lines
    """

    kept = ("_past", "_smooth")

    def __init__(self, start: Array, lag: float, delay: int) -> None:
        self._lag, self._delay = lag, delay
        self._smooth = np.array(start, dtype=float)
        self._past: deque[tuple[int, Array]] = deque([(0, self._smooth)])

    def read(self, t: int, dt: int, values: Array) -> Array:
        """The reading at t [ns], dt after the last one, from the true values at t."""
        kept = exp(-dt / NS / self._lag) if self._lag > 0.0 else 0.0
        self._smooth = values + (self._smooth - values) * kept
        past, then = self._past, t - self._delay
        past.append((t, self._smooth))
        while len(past) > 1 and past[1][0] <= then:
            past.popleft()
        (t0, first), (t1, second) = past[0], past[min(1, len(past) - 1)]
        if then <= t0 or t1 == t0:
            return first
        return np.asarray(first + (second - first) * ((then - t0) / (t1 - t0)))


class Feelers(Delayed):
    """Heights [m], (n,), through a limited range, then as `Delayed`."""

    def __init__(self, start: Array, lag: float, delay: int, range_max: float) -> None:
        super().__init__(np.clip(start, 0.0, range_max), lag, delay)
        self._range = range_max

    def read(self, t: int, dt: int, values: Array) -> Array:
        """As `Delayed.read`."""
        return super().read(t, dt, np.clip(values, 0.0, self._range))


class Controller(KeepsState):
    """PI with a dead band: rate of a cylinder from an error.

    gain [1/s]; integral [1/s2]; the integral fades within the dead band and rests while the rate is limited
    """

    kept = ("sum",)

    def __init__(
        self, gain: float, integral: float, dead_band: float, limits: tuple[float, float], period: float
    ) -> None:
        self._gain, self._integral, self._band, self._limits = gain, integral, dead_band, limits
        self._fade = exp(-gain * period)
        self._period, self.sum = period, 0.0

    def rate(self, error: float) -> float:
        """Wanted rate, within the limits (lowest, highest)."""
        over = max(abs(error) - self._band, 0.0)
        error = over if error > 0.0 else -over
        total = self.sum + self._integral * error * self._period
        wanted = self._gain * error + total
        rate = min(max(wanted, self._limits[0]), self._limits[1])
        if over == 0.0:
            self.sum *= self._fade
        elif rate == wanted or wanted * error < 0.0:
            self.sum = total
        return rate


class Cylinder(KeepsState):
    """A cylinder behind a valve: dead time [ns], then the rate follows within a lag [s], up to a stop."""

    kept = ("place", "_rate", "_wanted", "_queue")

    def __init__(self, dead_time: int, lag: float, stroke: tuple[float, float]) -> None:
        self._dead_time, self._lag, self._stroke = dead_time, lag, stroke
        self.place = self._rate = self._wanted = 0.0
        self._queue: deque[tuple[int, float]] = deque()

    def command(self, t: int, rate: float) -> None:
        """Want a rate from t [ns] on."""
        self._queue.append((t + self._dead_time, rate))

    def advance(self, t: int, dt: int) -> float:
        """Move from t to t + dt [ns]; the place there."""
        now, end = t, t + dt
        while self._queue and self._queue[0][0] < end:
            arrival, wanted = self._queue.popleft()
            self._move(max(0, arrival - now))
            now, self._wanted = max(now, arrival), wanted
        self._move(end - now)
        return self.place

    def later(self, t: int, duration: int) -> float:
        """The place `duration` after t [ns] if nothing else is commanded."""
        twin = copy(self)
        twin._queue = self._queue.copy()
        return twin.advance(t, duration)

    def _move(self, duration: int) -> None:
        h = duration / NS
        if h <= 0.0:
            return
        kept = exp(-h / self._lag) if self._lag > 0.0 else 0.0
        place = self.place + self._wanted * h + (self._rate - self._wanted) * self._lag * (1.0 - kept)
        self._rate = self._wanted + (self._rate - self._wanted) * kept
        self.place = min(max(place, self._stroke[0]), self._stroke[1])
        if self.place != place:
            self._rate = 0.0
