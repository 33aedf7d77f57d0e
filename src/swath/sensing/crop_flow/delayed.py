"""Crop flow level `delayed`: each sensor with its own delay, smoothing, scale error and noise."""

from collections import deque
from dataclasses import dataclass
from math import exp
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.estimate import Estimate
from swath.core.random import Normals, Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import PERCENT
from swath.field.moisture import Moisture
from swath.field.site_setup import SiteSetup
from swath.signals import (
    FeedReading,
    GrainImage,
    LossReading,
    MachineLoad,
    OrganLoads,
    ReturnsReading,
    YieldReading,
)

Share = Annotated[float, Ge(0), Le(100)]
Seconds = Annotated[float, Ge(0), Le(60)]
SENSORS = ("feed", "yield", "moisture", "tank", "loss", "loss")  # in the order of `truth`


@dataclass(frozen=True)
class Params:
    """Sensors of throughput, yield, moisture, tank level and losses.

    Each has a dead time, a time constant of its smoothing, a scale error drawn once per run and noise per
    sample. All numbers are estimates, but for the time constants of yield sensors, 2-5 s with the elevator
    (uncited).

    feed_delay_s: dead time of the layer sensor in the feeder house
    feed_lag_s: its time constant
    feed_scale_percent: standard deviation of its scale error
    feed_noise_percent: standard deviation of its noise, of the reading
    yield_delay_s: dead time of the impact plate on the elevator
    yield_lag_s: its time constant
    yield_scale_percent: standard deviation of its scale error
    yield_noise_percent: standard deviation of its noise, of the reading
    moisture_percent: water in the grain, share of the wet mass; none = the stand's
    moisture_delay_s: dead time of the moisture sensor, a chamber that fills and empties
    moisture_lag_s: its time constant
    moisture_scale_percent: standard deviation of its scale error
    moisture_noise_percent: standard deviation of its noise, of the reading
    tank_lag_s: time constant of the tank's level sensor
    tank_noise_percent: standard deviation of its noise, of the full tank
    loss_delay_s: dead time of the impact plates behind rotors and shoe
    loss_lag_s: their time constant
    loss_scale_percent: standard deviation of their scale error
    loss_noise_percent: standard deviation of their noise, of the reading
    """

    feed_delay_s: Seconds = 0.1
    feed_lag_s: Seconds = 0.5
    feed_scale_percent: Share = 3.0
    feed_noise_percent: Share = 2.0
    yield_delay_s: Seconds = 0.5
    yield_lag_s: Seconds = 1.0
    yield_scale_percent: Share = 2.0
    yield_noise_percent: Share = 2.0
    moisture_percent: Annotated[float, Ge(0), Le(50)] | None = None
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


class DelayedCropFlow(KeepsState):
    """Six sensors, one beside the other."""

    kept = ("_lines", "_smooth")
    sensors: tuple[str, ...] = SENSORS
    inputs: tuple[Port, ...] = (Port("load", MachineLoad),)
    outputs: tuple[Port, ...] = (
        *(Port("feed", FeedReading), Port("grain", YieldReading), Port("loss", LossReading)),
    )

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        own = params.moisture_percent
        stand = setup.field.moisture
        self._moisture = stand if own is None else Moisture(grain_moisture_percent=own)
        given = vars(params)
        self._delay, self._lag, scale, noise = (
            np.array([given.get(f"{sensor}_{what}", 0.0) for sensor in self.sensors])
            for what in ("delay_s", "lag_s", "scale_percent", "noise_percent")
        )
        self._scale_sd, self._noise_sd = PERCENT * scale, PERCENT * noise
        self._counts = [round(d / setup.period) for d in self._delay.tolist()]

    def reset(self, stream: Stream) -> Outputs:
        """Draw the scale errors; nothing flows."""
        self._normals = Normals(stream)
        self._scale = 1.0 + self._scale_sd * stream.at(0).standard_normal(len(self.sensors))
        start = self.truth(0, 1.0, {"load": MachineLoad(0, *[0.0] * 7)})
        self._lines = [deque([v] * n) for v, n in zip(start, self._counts, strict=True)]
        self._smooth = np.array(start)
        return self.readings(0, start)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Readings at t + dt; a delay is rounded to whole steps."""
        h = dt / NS
        now = self.truth(t, h, inputs)
        arrived = []
        for line, value in zip(self._lines, now, strict=True):
            line.append(value)
            arrived.append(line.popleft())
        kept = np.array([exp(-h / lag) if lag > 0.0 else 0.0 for lag in self._lag.tolist()])
        self._smooth = np.array(arrived) + (self._smooth - arrived) * kept
        noise = self._noise_sd * self._normals.at(t + dt, len(self.sensors))
        read = self._smooth * self._scale * (1.0 + noise)
        read[3] = self._smooth[3] + noise[3]
        return self.readings(t + dt, np.maximum(read, 0.0).tolist())

    def truth(self, t: int, h: float, inputs: Inputs) -> list[float]:
        """Feed, grain [kg/s], moisture, tank level, losses of separation and of cleaning [kg/s], now.

        t [ns], h [s]: of the step
        """
        load: MachineLoad = inputs["load"]
        rotors = load.threshing_loss + load.separation_loss
        moisture = self._moisture.of_grain(load.t)
        return [
            *(load.feeder_flow, load.grain_flow, moisture, load.tank_level),
            *(rotors, load.cleaning_loss),
        ]

    def readings(self, t: int, values: list[float]) -> Outputs:
        """The samples of values in the order of `truth`."""
        feed, grain, moisture, tank, separation, cleaning = values[:6]
        return {
            "feed": FeedReading(t, feed),
            "grain": YieldReading(t, grain, moisture, tank),
            "loss": LossReading(t, separation, cleaning),
        }


@dataclass(frozen=True)
class CountedParams(Params):
    """As `delayed`, with loss plates that count what hits them, a sensor of the returns and a grain camera.

    All are estimates.

    loss_scale_percent: standard deviation of the plates' gain where they are calibrated for crop and day; 60
        where they are not
    loss_hits_per_kg: grains that hit a plate per kilogram lost, a twentieth of wheat's 23,000; their number
        scatters (Poisson); 0 = it does not
    loss_straw_percent: of the straw, taken for grain by each plate: a tenth of the hits at a loss of 1 %
    returns_delay_s: dead time of the sensor in the returns elevator
    returns_lag_s: its time constant
    returns_scale_percent: standard deviation of its scale error
    returns_noise_percent: standard deviation of its noise, of the reading
    camera_delay_s: dead time of the camera in the grain elevator, with its computing
    camera_lag_s: time over which it averages its images, as a time constant
    camera_scale_percent: standard deviation of its scale error, of broken and of foreign each
    camera_noise_percent: standard deviation of its noise, of the reading
    camera_floor_percent: least share that it tells
    """

    loss_scale_percent: Annotated[Share, Estimate(15, 35)] = 25.0
    loss_hits_per_kg: Annotated[float, Ge(0), Le(1e6)] = 1150.0
    loss_straw_percent: Annotated[Share, Estimate(0.04, 0.16)] = 0.08
    returns_delay_s: Seconds = 0.5
    returns_lag_s: Seconds = 1.0
    returns_scale_percent: Share = 15.0
    returns_noise_percent: Share = 10.0
    camera_delay_s: Seconds = 2.0
    camera_lag_s: Annotated[Seconds, Estimate(10, 30)] = 20.0
    camera_scale_percent: Share = 20.0
    camera_noise_percent: Share = 20.0
    camera_floor_percent: Share = 0.2


class CountedCropFlow(DelayedCropFlow):
    """Loss plates that count grain and some straw; returns; broken and foreign in the grain."""

    sensors = (*SENSORS, "returns", "camera", "camera")
    inputs = (*DelayedCropFlow.inputs, Port("organs", OrganLoads))
    outputs = (*DelayedCropFlow.outputs, Port("returns", ReturnsReading), Port("quality", GrainImage))

    def __init__(self, params: CountedParams, setup: SiteSetup) -> None:
        super().__init__(params, setup)
        self._p = params

    def reset(self, stream: Stream) -> Outputs:
        """Draw the scale errors; nothing flows."""
        self._hits = stream.child("hits")
        return super().reset(stream)

    def truth(self, t: int, h: float, inputs: Inputs) -> list[float]:
        """As of all, but losses as hits tell them; returns [kg/s], broken and foreign besides."""
        *other, rotors, shoe = super().truth(t, h, inputs)
        load, per_kg = inputs["load"], self._p.loss_hits_per_kg * h
        heard = load.straw_flow * self._p.loss_straw_percent * PERCENT
        losses = [rotors + heard, shoe + heard]
        if per_kg > 0.0:
            losses = (
                self._hits.at(t).poisson([max(loss, 0.0) * per_kg for loss in losses]) / per_kg
            ).tolist()
        organs = inputs.get("organs") or OrganLoads(0)
        return [*other, *losses, load.return_flow, organs.broken_share, organs.mog_share]

    def readings(self, t: int, values: list[float]) -> Outputs:
        """The samples of values in the order of `truth`."""
        returns, *shares = values[6:]
        seen = [min(max(share, self._p.camera_floor_percent * PERCENT), 1.0) for share in shares]
        more = {"returns": ReturnsReading(t, returns), "quality": GrainImage(t, *seen)}
        return {**super().readings(t, values), **more}


LEVEL = Level(
    DelayedCropFlow,
    Params,
    summary="each sensor with its delay, smoothing, scale error and noise",
    cost="25 us per sample",
    tolerance="equal to ideal with every number at 0",
)
EXACT = [key for key in Params.__dataclass_fields__ if key != "moisture_percent"]
PRESETS = {
    "ideal": LEVEL.preset(
        "flows, moisture, tank level and losses as they are", "25 us per sample", **dict.fromkeys(EXACT, 0.0)
    ),
    "counted": Level(
        CountedCropFlow,
        CountedParams,
        summary="loss plates that count hits, of straw too; returns, and a camera for broken and foreign",
        cost="60 us per sample; needs `process: organs`",
        tolerance="equal to ideal with every number at 0",
    ),
}
