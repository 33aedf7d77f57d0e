"""A drive, a header and a late throughput sensor: the test bench of the speed laws, with closed forms."""

from collections import deque

import numpy as np

from swath.core.random import Stream
from swath.core.schedule import NS
from swath.signals import CropAhead, EngineState, FeedReading, FieldMap, Odometry
from tests.control.closed_loop import setup_of

H = 0.1
STEP = round(H * NS)
KNIFE = 4.0  # ahead of the fixed axle [m], as in closed_loop


def engine_at(load, t=0):
    return EngineState(t, 199.0, 1.0, load, *[0.0] * 12)


class Bench:
    """crop: kg/m2 at x of the knife; the sensor sees what was cut `delay` ago, smoothed over 0.5 s.

    sight: how far ahead of the knife crop is seen [m], in units of `seen` per kg/m2; 0 = blind
    strength: throughput at which the engine is fully loaded [kg/s]
    chart: what a map says of the crop, kg/m2 at x; None = no map
    scatter: of what is seen ahead, one sigma relative
    """

    def __init__(
        self,
        law,
        params,
        crop,
        *,
        delay=2.3,
        sight=0.0,
        seen=3.0,
        strength=1e9,
        noise=None,
        chart=None,
        scatter=0.0,
    ):
        self.law = law(params, setup_of(period=H))
        self.crop, self.sight, self.seen, self.strength, self.noise = crop, sight, seen, strength, noise
        self.chart, self.scatter = chart, scatter
        self.speed = self.law.reset(Stream(1, "speed"))["command"].speed
        self.line = deque([0.0] * round(delay / H))
        self.x = self.reading = self.t = 0.0
        self.rows = []

    def run(self, seconds):
        for _ in range(round(seconds / H)):
            self.step()
        return self.rows

    def step(self):
        t = round(self.t * NS)
        cut = self.crop(self.x) * 12.0 * self.speed
        self.line.append(cut)
        self.reading += (self.line.popleft() - self.reading) * H / 0.5
        factor = 1.0 if self.noise is None else 1.0 + 0.02 * self.noise.standard_normal()
        feed = FeedReading(t, self.reading * factor)
        ahead = None
        if self.sight > 0.0:
            amount = self.seen * self.crop(self.x + self.sight)
            if self.noise is not None and self.scatter:
                amount *= max(1.0 + self.scatter * self.noise.standard_normal(), 0.05)
            ahead = CropAhead(t, KNIFE + self.sight, 1.0, amount)
        chart = None
        if self.chart is not None:
            places = np.arange(2.0, 2.0 * self.sight + 1e-9, 2.0)
            grain, sure = np.array([self.chart(self.x + place) for place in places]), np.zeros(len(places))
            chart = FieldMap(t, KNIFE + places, grain, sure, sure, float("nan"))
        inputs = {
            "map": chart,
            "feed": feed,
            "engine": engine_at(self.reading / self.strength),
            "odometry": Odometry(t, self.speed, 0.0, 0.0),
            "ahead": ahead,
            "edge": None,
        }
        wanted = self.law.step(t, STEP, inputs)["command"].speed
        change = (wanted - self.speed) * H / (1.0 + H)  # the drive's loop, 1 s
        self.speed += min(max(change, -0.8 * H), 0.5 * H)
        self.x += self.speed * H
        self.t += H
        self.rows.append((self.t, self.x, self.speed, wanted, cut, self.reading))
