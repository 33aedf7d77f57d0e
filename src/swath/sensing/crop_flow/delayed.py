"""Crop flow level `delayed`: each sensor with its own delay, smoothing, scale error and noise."""

from collections import deque
from dataclasses import dataclass
from math import exp
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le

from swath.core.component import Inputs, Outputs, Port, State
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import PERCENT
from swath.field.site_setup import SiteSetup
from swath.signals import FeedReading, LossReading, MachineLoad, YieldReading

Share = Annotated[float, Ge(0), Le(100)]
Seconds = Annotated[float, Ge(0), Le(60)]
READINGS = ("feed", "yield", "moisture", "tank", "separation", "cleaning")


@dataclass(frozen=True)
class Params:
    """Of every sensor: its dead time, time constant of its smoothing, sd of its scale error (drawn once per
    run) and sd of its noise per sample, both in percent of the reading. All are estimates, but for the time
    constants of yield sensors, 2-5 s with the elevator (uncited).

    feed_delay_s, feed_lag_s, feed_scale_percent, feed_noise_percent: layer in the feeder house
    yield_delay_s, yield_lag_s, yield_scale_percent, yield_noise_percent: impact plate on the elevator
    moisture_percent: water in the grain; moisture_delay_s, moisture_lag_s, moisture_scale_percent,
    moisture_noise_percent: its sensor, a chamber that fills and empties
    tank_lag_s, tank_noise_percent: level, noise in percent of the full tank
    loss_delay_s, loss_lag_s, loss_scale_percent, loss_noise_percent: impact plates behind rotors and shoe
    """

    feed_delay_s: Seconds = 0.1
    feed_lag_s: Seconds = 0.5
    feed_scale_percent: Share = 3.0
    feed_noise_percent: Share = 2.0
    yield_delay_s: Seconds = 0.5
    yield_lag_s: Seconds = 1.0
    yield_scale_percent: Share = 2.0
    yield_noise_percent: Share = 2.0
    moisture_percent: Annotated[float, Ge(0), Le(50)] = 14.0
    moisture_delay_s: Seconds = 10.0
    moisture_lag_s: Seconds = 15.0
    moisture_scale_percent: Share = 2.0
    moisture_noise_percent: Share = 0.5
    tank_lag_s: Seconds = 5.0
    tank_noise_percent: Share = 0.5
    loss_delay_s: Seconds = 0.2
    loss_lag_s: Seconds = 2.0
    loss_scale_percent: Share = 20.0
    loss_noise_percent: Share = 10.0


class DelayedCropFlow:
    """Six sensors, one beside the other."""

    inputs = (Port("load", MachineLoad),)
    outputs = (Port("feed", FeedReading), Port("grain", YieldReading), Port("loss", LossReading))

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        p = params
        self._moisture = p.moisture_percent * PERCENT
        loss = (p.loss_delay_s, p.loss_lag_s)
        self._delay, self._lag = np.array(
            [
                (p.feed_delay_s, p.feed_lag_s),
                (p.yield_delay_s, p.yield_lag_s),
                (p.moisture_delay_s, p.moisture_lag_s),
                (0.0, p.tank_lag_s),
                loss,
                loss,
            ]
        ).T
        self._scale_sd, self._noise_sd = (
            PERCENT
            * np.array(
                [
                    (p.feed_scale_percent, p.feed_noise_percent),
                    (p.yield_scale_percent, p.yield_noise_percent),
                    (p.moisture_scale_percent, p.moisture_noise_percent),
                    (0.0, p.tank_noise_percent),
                    (p.loss_scale_percent, p.loss_noise_percent),
                    (p.loss_scale_percent, p.loss_noise_percent),
                ]
            ).T
        )
        self._counts = [round(d / setup.period) for d in self._delay.tolist()]

    def reset(self, stream: Stream) -> Outputs:
        """Draw the scale errors; nothing flows."""
        self._stream = stream
        self._scale = 1.0 + self._scale_sd * stream.at(0).standard_normal(len(READINGS))
        start = self._truth(MachineLoad(0, *[0.0] * 7))
        self._lines = [deque([v] * n) for v, n in zip(start.tolist(), self._counts, strict=True)]
        self._smooth = start
        return self._readings(0, self._smooth)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Readings at t + dt; a delay is rounded to whole steps."""
        now = self._truth(inputs["load"]).tolist()
        arrived = []
        for line, value in zip(self._lines, now, strict=True):
            line.append(value)
            arrived.append(line.popleft())
        h = dt / NS
        kept = np.array([exp(-h / lag) if lag > 0.0 else 0.0 for lag in self._lag.tolist()])
        self._smooth = np.array(arrived) + (self._smooth - arrived) * kept
        noise = self._noise_sd * self._stream.at(t + dt).standard_normal(len(READINGS))
        read = self._smooth * self._scale * (1.0 + noise)
        read[3] = self._smooth[3] + noise[3]
        return self._readings(t + dt, np.maximum(read, 0.0))

    def save(self) -> State:
        """What is on its way, and the smoothed values."""
        return {"lines": [np.array(line) for line in self._lines], "smooth": self._smooth.copy()}

    def load(self, state: State) -> None:
        """Back to a saved moment."""
        self._lines = [deque(line.tolist()) for line in state["lines"]]
        self._smooth = np.array(state["smooth"])

    def _truth(self, load: MachineLoad) -> np.ndarray:
        rotors = load.threshing_loss + load.separation_loss
        flows = (load.feeder_flow, load.grain_flow, self._moisture, load.tank_level)
        return np.array([*flows, rotors, load.cleaning_loss])

    def _readings(self, t: int, read: np.ndarray) -> Outputs:
        feed, grain, moisture, tank, separation, cleaning = read.tolist()
        return {
            "feed": FeedReading(t, feed),
            "grain": YieldReading(t, grain, moisture, tank),
            "loss": LossReading(t, separation, cleaning),
        }


LEVEL = Level(
    DelayedCropFlow,
    Params,
    summary="each sensor with its delay, smoothing, scale error and noise",
    cost="60 us per sample",
    tolerance="equal to ideal with every number at 0",
)
