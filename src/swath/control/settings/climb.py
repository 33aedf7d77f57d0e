"""Settings level `climb`: one setting at a time a step up or down, kept where less grain is lost.

Change one, wait until the flow is stable, compare (US patent 6,863,604); where it got worse, back (a trial
takes Rostselmash 20 s). Compared is what was lost, over the feed; of fan and sieve by the shoe, of the others
by drum and rotors. A camera tells what is broken and what is beside the grain in the tank; who has none does
not know: so it stays within a range around its start.
"""

from dataclasses import dataclass
from statistics import fmean
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.control.settings import fixed
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import MM, PERCENT, RPM
from swath.signals import FeedReading, GrainImage, LossReading, OrganSettings, YieldReading
from swath.signals.settings import own_settings
from swath.signals.setup import ControlSetup

Step = Annotated[float, Ge(0), Le(500)]
AIR = "fan", "upper"  # what is judged by the shoe alone


@dataclass(frozen=True)
class Params(fixed.Params):
    """Start and steps. The settings are those it starts with; none = the manual's for `crop`.

    crop: what the driver chose
    settle_s: after a change, until readings count: through the machine and the sensors' lag
    window_s: over which readings are averaged
    pairs: how often a step and the settings before it are compared, one after the other
    feed_exponent: what is lost goes with the feed to this power: a doubled feed doubles its share of the
        grain (wheat, tehqeeqat 33395)
    better_percent: how much less has to be lost for a step to be kept
    broken_weight: grain broken counts as so much of it lost: what its price is less by, an estimate
    foreign_weight: and so does what is beside it in the tank
    range_percent: furthest from the start
    drum_step_rpm: step of the drum; 0 = left as it is (steps of makers' terminals: 50 rpm, 1 and 2 mm)
    concave_step_mm: step of the clearance
    fan_step_rpm: step of the fan
    upper_step_mm: step of the upper sieve
    """

    crop: str = "wheat"
    settle_s: Annotated[float, Ge(0), Le(600)] = 20.0
    window_s: Annotated[float, Gt(0), Le(600)] = 20.0
    pairs: Annotated[int, Ge(1), Le(20)] = 1
    feed_exponent: Annotated[float, Ge(0), Le(10)] = 2.0
    better_percent: Annotated[float, Ge(0), Le(50)] = 3.0
    broken_weight: Annotated[float, Ge(0), Le(1)] = 0.2
    foreign_weight: Annotated[float, Ge(0), Le(1)] = 0.2
    range_percent: Annotated[float, Ge(0), Le(80)] = 40.0
    drum_step_rpm: Step = 0.0
    concave_step_mm: Step = 2.0
    fan_step_rpm: Step = 50.0
    upper_step_mm: Step = 2.0


class Climb(KeepsState):
    """Where it is, the trial that runs, and what was lost without and with it."""

    kept = ("_now", "_signs", "_turn", "_seen", "_tried", "_since", "_sums")
    inputs = (
        *(Port("loss", LossReading), Port("feed", FeedReading)),
        *(Port("grain", YieldReading, optional=True), Port("quality", GrainImage, optional=True)),
    )
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
        self._turn, self._tried = 0, False
        self._seen: list[list[float]] = [[], []]  # without the step, with it
        self._since, self._sums = 0.0, [0.0] * 4
        return {"settings": OrganSettings(0, **self._now)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Take readings in; at the end of a window go on with the trial, or judge it and begin the next."""
        p, h = self._p, dt / NS
        self._since += h
        if self._since > p.settle_s:
            self._take(h, inputs)
        if self._since >= p.settle_s + p.window_s and self._steps:
            *lost, flow, time = self._sums
            if flow > 0.0:
                self._seen[self._tried].append(
                    lost[self._name in AIR] / time * (flow / time) ** -p.feed_exponent
                )
                self._go_on()
            self._since, self._sums = 0.0, [0.0] * 4
        return {"settings": OrganSettings(t + dt, **self._now)}

    def _take(self, h: float, inputs: Inputs) -> None:
        """Add up [kg] what drum and rotors lost and broke, the shoe lost and let through, the feed; time."""
        p, grain, image = self._p, inputs.get("grain"), inputs.get("quality")
        rates = [inputs["loss"].separation, inputs["loss"].cleaning, inputs["feed"].flow, 1.0]
        if grain is not None and image is not None:
            rates[0] += grain.flow * p.broken_weight * image.broken
            rates[1] += grain.flow * p.foreign_weight * image.foreign
        self._sums = [total + h * rate for total, rate in zip(self._sums, rates, strict=True)]

    def _go_on(self) -> None:
        """Back and forth as often as it is to be compared; then it stays or goes."""
        without, tried = self._seen
        if not self._tried or len(tried) < self._p.pairs:
            if self._tried:
                self._move(-1.0)
            else:
                self._try()
            return
        bound = fmean(without) * (1.0 - self._p.better_percent * PERCENT)
        if fmean(tried) > bound:
            self._move(-1.0)
            self._turn_round()
            self._seen = [[], []]  # what is lost without it is measured anew: crop changes
            return
        self._seen, self._tried = [tried[-1:], []], False
        self._try()

    @property
    def _name(self) -> str:
        """The setting whose turn it is."""
        return list(self._steps)[self._turn % len(self._steps)]

    def _turn_round(self) -> None:
        """Next time the other way; the next setting has its turn."""
        self._signs[self._name] *= -1.0
        self._turn += 1

    def _move(self, way: float) -> None:
        self._now[self._name] += way * self._signs[self._name] * self._steps[self._name]
        self._tried = way > 0.0

    def _try(self) -> None:
        """A step of the setting whose turn it is; where the range ends, the other way."""
        name = self._name
        step, start = self._signs[name] * self._steps[name], self._start[name]
        if abs(self._now[name] + step - start) > self._p.range_percent * PERCENT * start:
            self._turn_round()
            self._seen = [[], []]
            return
        self._move(1.0)


LEVEL = Level(
    Climb,
    Params,
    summary="one setting at a time a step, kept where the loss sensors show less",
    cost="10 us per step",
    tolerance="within a step of the least loss in an even crop",
)
