"""Threshing level `model`: drum and concave as two coupled exponentials over their length.

Grain in the ear u and free grain in the straw f over the length x:

    du/dx = -lambda u,   df/dx = lambda u - beta f,   separated = 1 - u - f

(Miu, Combine Harvesters, 2015; separation alone: Boettinger, Beck and Kutzbach). Both rates fall with the
layer.
"""

from dataclasses import dataclass
from math import exp, expm1
from typing import Annotated

from annotated_types import Ge, Le

from swath.core.component import Inputs, Outputs
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.field.site_setup import SiteSetup
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.organ import ENGINE, Organ, crop, given, moisture, ratio_of
from swath.signals import CropStream

Threshability = Annotated[float, Ge(0.2), Le(3)]


def coupled(ear: float, free: float, threshing: float, separation: float) -> tuple[float, float]:
    """(grain in the ear, free grain) after a length, from those before it; both rates times the length.

    Exact for any two rates, equal ones too.
    """
    gap = separation - threshing
    grown = 1.0 + 0.5 * gap if abs(gap) < 1e-6 else expm1(gap) / gap
    left = exp(-separation)
    return ear * exp(-threshing), free * left + ear * threshing * left * grown


@dataclass(frozen=True)
class Params:
    """Drum and concave.

    threshability: factor on threshing and separation [1]; 1 = dry wheat
    """

    threshability: Threshability = 1.0


class Drum(Organ):
    """Threshes what comes from feeder and returns; all of their grain counts as unthreshed."""

    inputs = (crop("fed"), crop("back"), ENGINE)
    outputs = given("over", "through")

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        drivetrain = drivetrain_of(setup.machine)
        self._p, self._d = params, drivetrain.threshing
        self._work = drivetrain.consumers.drum_work

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Thresh what came within dt; nothing stays in it."""
        h, came = dt / NS, (*inputs["fed"], *inputs["back"])
        grain, mog = 0.0, 0.0
        for stream in came:
            grain, mog = grain + stream.grain, mog + stream.mog
        ear, free = self._left(grain, mog / h, ratio_of(inputs))
        chaff = mog * self._d.chaff
        wet = moisture(inputs["fed"])
        return {
            "over": CropStream(t + dt, ear, free, straw=mog - chaff, dt=h, **wet),
            "through": CropStream(t + dt, free=grain - ear - free, chaff=chaff, dt=h, **wet),
            "work": self.work(t + dt, h, grain, mog, power=self._work * ((grain + mog) / h)),
        }

    def _left(self, grain: float, flow: float, ratio: float) -> tuple[float, float]:
        """Grain in the ear and free grain in the straw behind the concave [kg]; flow: of straw [kg/s]."""
        d, threshability = self._d, self._p.threshability * ratio
        layer = flow / d.straw / max(ratio, 0.05)
        scale = threshability * max(layer, 1e-3) ** -d.drum_exponent
        return coupled(grain, 0.0, d.drum_threshing * scale, d.drum_separation * scale)


class IdealDrum(Drum):
    """All grain is threshed and falls through the concave."""

    def _left(self, grain: float, flow: float, ratio: float) -> tuple[float, float]:
        return 0.0, 0.0


LEVEL = Level(
    Drum,
    Params,
    summary="drum and concave: threshing and separation as coupled exponentials of the layer",
    cost="about 15 us per step",
    tolerance="equal to the closed forms",
    numbers=("threshing", "power"),
)
PRESETS = {
    "ideal": LEVEL.preset("all grain is threshed and falls through", "10 us", IdealDrum, threshability=1.0)
}
