"""Settings level `climb`: learns what is lost over feed and settings; steps to where the least is due.

A window tells four qualities: what drum and rotors lose of the feed, what the shoe does, what of the grain
is broken and what is beside it in the tank. The logarithm of each is a quadratic in the logarithms of the
settings about those it starts with, and goes with feed and grain; `TRENDS` is what is known of it before.
Kalman filters whose levels wander, as crop and sensors do, learn from all windows: recursive least squares
with a prior. Then each setting goes a step up or down where that saves, less what is uncertain of it, and
waits until the flow is stable (US patent 6,863,604). So it keeps to its start where little is to be won. Who
has no camera goes by what the crop is known for.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import log, sqrt
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.control.settings import fixed
from swath.core import portable
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import MM, PERCENT, RPM
from swath.signals import F64, FeedReading, GrainImage, LossReading, OrganSettings, YieldReading
from swath.signals.settings import CROPS, SIEVE_AIR, own_settings
from swath.signals.setup import ControlSetup

Step = Annotated[float, Ge(0), Le(500)]
Percent = Annotated[float, Gt(0), Le(100)]
MOVED = "drum", "concave", "fan", "upper"
TRENDS = np.array([
    [[-2.5, 1.5, 25, 10], [1.5, 1.0, 8, 4], [0, 0.1, 0, 1], [0, 0.1, 0, 0.3]],
    [[0.6, 0.6, 0, 1], [-0.1, 0.2, 0, 0.3], [0, 3, 80, 30], [-1, 0.5, 0, 0.5]],
    [[6.7, 2, 0, 3], [-0.5, 0.25, 0, 0.3], [0, 0.1, 0, 1], [0, 0.1, 0, 0.3]],
    [[0.4, 0.4, 0, 1], [-0.1, 0.2, 0, 0.3], [-4, 1.5, 0, 5], [0, 0.2, 0, 0.3]],
])  # fmt: skip
"""Of each quality over drum, concave, air of the fan, upper sieve: slope, its standard deviation, curvature,
its standard deviation. Signs are those of manuals (John Deere OMDXE11330, New Holland CR, section 6), sizes
those of the laws in docs/explanation/machine.md, estimates.
"""
FEED = ((0.0, 3.0, 3.0), (-3.0, 2.0, 2.0), (-0.25, 0.2, 0.2), (0.5, 0.5, 0.5))
"""Power of the feed with which each goes, its standard deviation, and that of the power of the grain, 0: at
the same feed, more of it is less straw. To the first two `feed_exponent` - 1 is added. Broken: a doubled feed
broke 16 % less wheat (tehqeeqat 33395); the rest are estimates.
"""
WINDOWS = 100  # whose feeds are kept
LEAST = 0.1  # of the manual's setting: below, as with a fan that stands, trends say nothing more


@dataclass(frozen=True)
class Params(fixed.Params):
    """Start and steps. The settings are those it starts with; none = the manual's for `crop`.

    crop: what the driver chose
    settle_s: after a change, until readings count: through the machine and the sensors' lag
    window_s: over which readings are averaged
    pairs: without effect; scenarios that have it stay valid
    feed_exponent: what is lost goes with the feed to about this power, until it is learnt
    feed_lag_s: time constant with which the feed is held against what is lost: its way to the rear
    better_percent: how much less has to be due for a step to be taken
    caution: of its saving, as many of its standard deviations do not count
    wander_percent: how far the same settings' losses wander within a minute, a standard deviation
    broken_weight: grain broken counts as so much of it lost: what its price is less by, an estimate
    foreign_weight: and so does what is beside it in the tank
    range_percent: furthest from the start
    drum_step_rpm: step of the drum; 0 = left as it is (steps are those of a maker's terminal, OMDXE11330)
    concave_step_mm: step of the clearance
    fan_step_rpm: step of the fan
    upper_step_mm: step of the upper sieve
    known_percent: lost by rotors and shoe, and beside the grain, before anything is read: estimates
    noise_percent: a window's standard deviations of rotors, shoe, broken, beside, as crop varies: estimates
    grain_share: of the feed, at straw over grain of 0.65 (DLG)
    least_feed: of the largest feed: less teaches nothing, the machine turns or stands
    """

    crop: str = "wheat"
    settle_s: Annotated[float, Ge(0), Le(600)] = 10.0
    window_s: Annotated[float, Gt(0), Le(600)] = 30.0
    pairs: Annotated[int, Ge(1), Le(20)] = 1
    feed_exponent: Annotated[float, Ge(0), Le(10)] = 5.0
    feed_lag_s: Annotated[float, Ge(0), Le(60)] = 4.0
    better_percent: Annotated[float, Ge(0), Le(50)] = 0.2
    caution: Annotated[float, Ge(0), Le(10)] = 0.3
    wander_percent: Annotated[float, Ge(0), Le(100)] = 7.0
    broken_weight: Annotated[float, Ge(0), Le(1)] = 0.2
    foreign_weight: Annotated[float, Ge(0), Le(1)] = 0.2
    range_percent: Annotated[float, Ge(0), Le(80)] = 40.0
    drum_step_rpm: Step = 10.0
    concave_step_mm: Step = 1.0
    fan_step_rpm: Step = 10.0
    upper_step_mm: Step = 1.0
    known_percent: tuple[Percent, Percent, Percent] = (0.5, 0.2, 0.5)
    noise_percent: tuple[Percent, Percent, Percent, Percent] = (20.0, 15.0, 10.0, 10.0)
    grain_share: Annotated[float, Gt(0), Le(1)] = 0.6
    least_feed: Annotated[float, Ge(0), Le(1)] = 1 / 3


class Climb(KeepsState):
    """Where it is, what it knows of each quality, and sums of the window that runs.

    What is known: level at the first window's feed, powers of feed and grain, slopes, curvatures, (4, 11)
    """

    kept = ("_now", "_known", "_spread", "_feeds", "_first", "_most", "_feed", "_since", "_sums")
    inputs = (
        *(Port("loss", LossReading), Port("feed", FeedReading)),
        *(Port("grain", YieldReading, optional=True), Port("quality", GrainImage, optional=True)),
    )
    outputs = (Port("settings", OrganSettings),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        p = self._p = params
        asked = fixed.Fixed(params, setup).reset(Stream(0, ""))["settings"]
        assert isinstance(asked, OrganSettings)
        works = setup.machine.works
        self._start, self._own = own_settings(works, p.crop, asked), own_settings(works, p.crop)
        steps = {"concave": p.concave_step_mm * MM, "fan": p.fan_step_rpm * RPM,
                 "upper": p.upper_step_mm * MM, "drum": p.drum_step_rpm * RPM}  # fmt: skip
        self._steps = {name: step for name, step in steps.items() if step > 0.0}
        self._prices = np.array([1.0, 1.0, p.grain_share * p.broken_weight, p.grain_share * p.foreign_weight])
        self._noise = [(value * PERCENT) ** 2 for value in p.noise_percent]
        self._origin = self._at(self._start)

    @property
    def notes(self) -> list[str]:
        """Whether it has come to learn."""
        if len(self._feeds):
            return []
        least = self._p.settle_s + self._p.window_s
        return [f"settings: nothing learnt, they stayed: there never were {least:g} s of steady harvest"]

    def reset(self, stream: Stream) -> Outputs:
        """At the start, with what is known before."""
        rotors, shoe, foreign = (value * PERCENT for value in self._p.known_percent)
        level = [rotors, shoe, CROPS.get(self._p.crop, CROPS["wheat"]).broken, foreign]
        slope, slope_sd, bend, bend_sd = TRENDS.transpose(2, 0, 1)
        power, power_sd, grain_sd = np.array(FEED).T
        power[:2] += self._p.feed_exponent - 1.0
        self._known = np.column_stack([[*map(log, level)], power, np.zeros(4), slope, bend])
        sd = np.column_stack([np.ones(4), power_sd, grain_sd, slope_sd, bend_sd])
        self._spread = np.array([np.diag(row) for row in sd**2])
        self._now, self._feeds = dict(self._start), np.zeros((0, 2))
        self._first, self._most, self._feed = (0.0, 0.0), 0.0, 0.0
        self._since, self._sums = 0.0, [0.0] * 7
        return {"settings": OrganSettings(0, **self._now)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Take readings in; at the end of a window learn from it and go on."""
        p, h = self._p, dt / NS
        self._since += h
        self._feed += (inputs["feed"].flow - self._feed) * h / (h + p.feed_lag_s)
        self._most = max(self._most, self._feed)
        if self._since > p.settle_s and self._feed > p.least_feed * self._most:
            self._take(h, inputs)
        *sums, time = self._sums
        if time >= p.window_s:
            self._learn([value / time for value in sums])
            now, self._now = self._now, self._best()
            self._since, self._sums = p.settle_s if now is self._now else 0.0, [0.0] * 7
        return {"settings": OrganSettings(t + dt, **self._now)}

    def _take(self, h: float, inputs: Inputs) -> None:
        """Add up losses [kg], shares broken and beside, the feed to its power, grain [kg]; time."""
        loss, grain, image = inputs["loss"], inputs.get("grain"), inputs.get("quality")
        seen = (0.0, 0.0) if image is None else (image.broken, image.foreign)
        rates = loss.separation, loss.cleaning, *seen, self._feed**self._power
        rates += (0.0 if grain is None else grain.flow), 1.0
        self._sums = [total + h * rate for total, rate in zip(self._sums, rates, strict=True)]

    @property
    def _power(self) -> float:
        """Mean feed is that of what goes with it to this power."""
        return max(self._p.feed_exponent - 1.0, 1.0)

    def _at(self, settings: Mapping[str, float]) -> F64:
        """What trends go with, (8,): logarithms of settings over the manual's, and half their squares."""
        own = self._own
        over = {name: settings[name] / own[name] for name in MOVED}
        over["fan"] *= max(1.0 - SIEVE_AIR * PERCENT / MM * (settings["upper"] - own["upper"]), LEAST)
        x = [log(max(over[name], LEAST)) for name in MOVED]
        return np.array([*x, *(0.5 * value * value for value in x)])

    def _learn(self, means: list[float]) -> None:
        """Each quality's filter goes on by what was seen of it; nothing seen, nothing learnt."""
        p, feed, grain = self._p, means[4] ** (1.0 / self._power), means[5]
        first, first_grain = self._first = self._first if self._first[0] else (feed, grain)
        more = log(grain / first_grain) if grain and first_grain else 0.0
        z = np.array([1.0, log(feed / first), more, *(self._at(self._now) - self._origin)])
        wandered = (p.wander_percent * PERCENT) ** 2 * self._since / 60.0
        known, spread = self._known.copy(), self._spread.copy()
        spread[:, 0, 0] += wandered
        for q, (mean, over) in enumerate(zip(means[:4], (feed, feed, 1.0, 1.0), strict=True)):
            if mean > 0.0:
                along = (spread[q] * z).sum(axis=1)
                gain = along / ((along * z).sum() + self._noise[q])
                known[q] += gain * (log(mean / over) - (known[q] * z).sum())
                spread[q] -= gain[:, None] * along
        self._known, self._spread = known, spread
        self._feeds = np.vstack([self._feeds, z[1:3]])[-WINDOWS:]

    def _best(self) -> dict[str, float]:
        """Where it is, each setting a step further where less is due there; the same where none is."""
        best, limit, share = self._now, self._p.range_percent * PERCENT, self._p.better_percent * PERCENT
        by_feed = (self._known[:, None, 1:3] * self._feeds).sum(axis=2)  # what is lost goes with it: (4, n)
        usual = portable.exp(np.minimum(by_feed + self._known[:, :1], 30.0)).mean(axis=1)
        for name, step in self._steps.items():
            here, least = best[name], self._due(best, usual) * (1.0 - share)
            for value in (here - step, here + step):
                there = {**best, name: value}
                due = self._due(there, usual)
                if abs(value / self._start[name] - 1.0) <= limit and due < least:
                    best, least = there, due
        return best

    def _due(self, settings: Mapping[str, float], usual: F64) -> float:
        """Lost by the feed, with what broken grain and what is beside it are worth less, and its doubt.

        usual: each quality at the start's settings, over the feeds that there were (4,)
        """
        z = self._at(settings) - self._origin
        due = self._prices * usual * portable.exp((self._known[:, 3:] * z).sum(axis=1))
        doubt = (self._spread[:, 3:, 3:] * z * z[:, None]).sum(axis=(1, 2))
        return float(due.sum()) + self._p.caution * sqrt(float((due * due * doubt).sum()))


LEVEL = Level(
    Climb,
    Params,
    summary="learns losses over settings from its sensors, and steps to where least is lost and broken",
    cost="10 us per step",
    tolerance="within a step of the least loss in an even crop",
)
