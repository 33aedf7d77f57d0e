"""Settings level `climb`: one setting at a time a step up or down, kept where less grain is lost.

Change one, wait until the flow is stable, compare (US patent 6,863,604); where it got worse, back (a trial
takes Rostselmash 20 s). It does not know what it cannot sense, broken grain and straw in the tank: so it
stays within a range around its start.
"""

from dataclasses import dataclass
from math import isnan, nan
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.control.settings import fixed
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import MM, PERCENT, RPM
from swath.signals import FeedReading, LossReading, OrganSettings
from swath.signals.settings import own_settings
from swath.signals.setup import ControlSetup

Step = Annotated[float, Ge(0), Le(500)]


@dataclass(frozen=True)
class Params(fixed.Params):
    """Start and steps. The settings are those it starts with; none = the manual's for `crop`.

    crop: what the driver chose
    settle_s: after a change, until readings count: through the machine and the sensors' lag
    window_s: over which readings are averaged
    better_percent: how much less has to be lost for a step to be kept
    range_percent: furthest from the start
    drum_step_rpm: step of the drum; 0 = left as it is (steps of makers' terminals: 50 rpm, 1 and 2 mm)
    concave_step_mm: step of the clearance
    fan_step_rpm: step of the fan
    upper_step_mm: step of the upper sieve
    """

    crop: str = "wheat"
    settle_s: Annotated[float, Ge(0), Le(600)] = 20.0
    window_s: Annotated[float, Gt(0), Le(600)] = 20.0
    better_percent: Annotated[float, Ge(0), Le(50)] = 3.0
    range_percent: Annotated[float, Ge(0), Le(80)] = 40.0
    drum_step_rpm: Step = 0.0
    concave_step_mm: Step = 2.0
    fan_step_rpm: Step = 50.0
    upper_step_mm: Step = 2.0


class Climb(KeepsState):
    """Where it is, the trial that runs, and the loss before it."""

    kept = ("_now", "_signs", "_turn", "_best", "_tried", "_since", "_sums")
    inputs = (Port("loss", LossReading), Port("feed", FeedReading))
    outputs = (Port("settings", OrganSettings),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        p = self._p = params
        asked = fixed.Fixed(params, setup).reset(Stream(0, ""))["settings"]
        assert isinstance(asked, OrganSettings)
        self._start = own_settings(setup.machine.works, p.crop, asked)
        steps = {"concave": p.concave_step_mm * MM, "fan": p.fan_step_rpm * RPM,
                 "upper": p.upper_step_mm * MM, "drum": p.drum_step_rpm * RPM}  # fmt: skip
        self._steps = {name: step for name, step in steps.items() if step > 0.0}

    def reset(self, stream: Stream) -> Outputs:
        """At the start; nothing known."""
        self._now, self._signs = dict(self._start), dict.fromkeys(self._steps, 1.0)
        self._turn, self._best, self._tried = 0, nan, False
        self._since, self._sums = 0.0, [0.0, 0.0]
        return {"settings": OrganSettings(0, **self._now)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Take readings in; at the end of a window judge the trial and begin the next."""
        p, h = self._p, dt / NS
        self._since += h
        if self._since > p.settle_s:
            self._sums[0] += h * (inputs["loss"].separation + inputs["loss"].cleaning)
            self._sums[1] += h * inputs["feed"].flow
        if self._since >= p.settle_s + p.window_s and self._steps:
            if self._sums[1] > 0.0:
                self._judge(self._sums[0] / self._sums[1])
            self._since, self._sums = 0.0, [0.0, 0.0]
        return {"settings": OrganSettings(t + dt, **self._now)}

    def _judge(self, loss: float) -> None:
        """Keep the trial or go back, and on to the next one. loss: over the feed."""
        name = self._name
        if self._tried and loss > self._best * (1.0 - self._p.better_percent * PERCENT):
            self._now[name] -= self._signs[name] * self._steps[name]
            self._signs[name] *= -1.0
            self._turn += 1
            self._tried, self._best = False, nan  # what is lost without it is measured anew: crop changes
            return
        if self._tried or isnan(self._best):
            self._best = loss
        self._try()

    @property
    def _name(self) -> str:
        """The setting whose turn it is."""
        return list(self._steps)[self._turn % len(self._steps)]

    def _try(self) -> None:
        """A step of the setting whose turn it is; where the range ends, the other way."""
        name = self._name
        step, start = self._signs[name] * self._steps[name], self._start[name]
        if abs(self._now[name] + step - start) > self._p.range_percent * PERCENT * start:
            self._signs[name] *= -1.0
            self._turn += 1
            self._tried = False
            return
        self._now[name] += step
        self._tried = True


LEVEL = Level(
    Climb,
    Params,
    summary="one setting at a time a step, kept where the loss sensors show less",
    cost="10 us per step",
    tolerance="within a step of the least loss in an even crop",
)
