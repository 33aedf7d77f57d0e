"""Separation level `model`: rotors, in which what is left in the ear is threshed and free grain separated.

The laws are those of the drum (`threshing.model`), parcel by parcel; docs/explanation/machine.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from swath.core import portable
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.estimate import Estimate
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import DEG, MM, PERCENT, RPM
from swath.field.site_setup import SiteSetup
from swath.machine.drivetrain_sheet import drivetrain_of, threshing_of
from swath.machine.organ import (
    ENGINE,
    SETTINGS,
    Organ,
    Setting,
    added,
    crop,
    given,
    masses,
    moisture,
    ratio_of,
    sent,
)
from swath.machine.threshing.model import Params as DrumParams
from swath.machine.threshing.model import Power, rate_factors
from swath.signals import OrganWork

Array = NDArray[np.float64]
FRONT, WIDTH, EAR, FREE, STRAW, FED, SCALE = range(
    7
)  # rows: front and width of the length, kg, factor on rates


class Rotor(KeepsState):
    """Parcels of crop that pass through the rotors; each parcel of one step is exact on its own.

    A parcel has a front and a width; it is threshed until its front comes to the end, then leaves bit by bit.
    threshing, separation: rates over the whole length at the nominal layer; exponent: both go with
    layer^-exponent; passage: time through it at nominal speed [s]
    """

    kept = ("_parcels",)

    def __init__(self, threshing: float, separation: float, exponent: float, passage: float) -> None:
        self._rates, self._exponent, self._passage = (threshing, separation), exponent, passage
        self.clear()

    def clear(self) -> None:
        """Empty it."""
        self._parcels = np.zeros((7, 0))

    def advance(
        self,
        crop: tuple[float, float, float, float],
        *,
        layer: float,
        dt: float,
        ratio: float,
        threshability: float,
        factors: tuple[float, float] = (1.0, 1.0),
        pace: float = 1.0,
    ) -> tuple[float, list[float]]:
        """Take in a step's crop [kg] and move everything on by dt [s].

        crop: grain in the ear, free grain, straw, and the grain it had before the drum [kg]
        layer: thickness of what enters, 1 = nominal; ratio: rotor speed over nominal; threshability: factor
        on both rates; factors: on threshing and on separation besides; pace: how much sooner crop leaves.
        Returns the grain separated [kg] and what leaves [kg], four as `crop`
        """
        path = dt * ratio / self._passage * pace
        if any(crop):
            scale = max(layer, 1e-3) ** -self._exponent
            new = np.array([[0.0], [path], *([m] for m in crop), [scale]])
            self._parcels = np.concatenate([self._parcels, new], axis=1)
        p = self._parcels
        if p.shape[1] == 0:
            return 0.0, [0.0] * 4
        front = p[FRONT] + path
        done = (np.minimum(front, 1.0) - p[FRONT]) * p[SCALE]
        threshing, separation = (rate * f for rate, f in zip(self._rates, factors, strict=True))
        if abs(separation - threshing) < 1e-6 * threshing:
            separation = threshing * (1.0 + 1e-6)  # two rates that are never equal need no limit
        still, kept = portable.exp(
            done * np.array([[-threshability * threshing], [-threshability * separation]])
        )
        ear = p[EAR] * still
        grown = threshing / (separation - threshing) if threshing else 0.0
        free = p[FREE] * kept + p[EAR] * (still - kept) * grown
        separated = float((p[EAR] + p[FREE] - ear - free).sum())
        p[FRONT], p[EAR], p[FREE] = front, ear, free
        return separated, self._leave()

    def held(self) -> tuple[float, float]:
        """Grain and straw in it [kg]."""
        total = self._parcels.sum(axis=1)
        return float(total[EAR] + total[FREE]), float(total[STRAW])

    def _leave(self) -> list[float]:
        """Take out what is beyond the end; the first parcels first."""
        p, out, whole = self._parcels, np.zeros(4), 0
        for i in range(p.shape[1]):
            over = float(p[FRONT, i]) - 1.0
            if over <= 0.0:
                break
            if over >= float(p[WIDTH, i]) - 1e-12:
                out += p[EAR:SCALE, i]
                whole += 1
                continue
            gone = p[EAR:SCALE, i] * (over / float(p[WIDTH, i]))
            p[EAR:SCALE, i] -= gone
            p[WIDTH, i] -= over
            p[FRONT, i] = 1.0
            out += gone
        self._parcels = p[:, whole:]
        result: list[float] = out.tolist()
        return result


@dataclass(frozen=True)
class Params(DrumParams):
    """Rotors: as the drum, at the same relative speed and clearance.

    short_percent: of the straw that comes in, falls through as short straw at the manual's settings
    vane_power: steeper vanes carry the straw out sooner; short straw, breakage and power go with the time in
        the rotor to this power
    vane_deg_s: how fast the vanes are set
    """

    short_percent: Annotated[float, Ge(0), Le(50), Estimate(1, 4)] = 2.0
    vane_power: Annotated[Power, Estimate(0.25, 1)] = 0.5
    vane_deg_s: Annotated[float, Gt(0), Le(1e3), Estimate(0.5, 2)] = 1.0


@dataclass(frozen=True)
class Passage:
    """How crop goes through in a step: factors on rates, breakage and power, and a share.

    pace: how much sooner it leaves
    short: share of the straw that falls through as short straw
    """

    threshing: float
    separation: float
    pace: float = 1.0
    short: float = 0.0
    broken: float = 1.0
    power: float = 1.0


class Rotors(Organ):
    """The layer in them is that of the drum: `drum` is its work."""

    kept = ("_rotor", "_loss_share", "_broken", "_set")
    inputs: tuple[Port, ...] = (crop("fed"), Port("drum", OrganWork, history=True), ENGINE, SETTINGS)
    outputs = given("over", "through")

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        drivetrain, p = drivetrain_of(setup.machine), params
        d = self._d = threshing_of(setup.machine)
        self._p, self._work = p, drivetrain.consumers.separation_work
        self._set = Setting(
            setup, drum=p.speed_rpm_s * RPM, concave=p.opening_mm_s * MM, vane=p.vane_deg_s * DEG
        )
        self._rotor = Rotor(
            d.rotor_threshing, d.rotor_separation, d.rotor_exponent, drivetrain.transport.rotor
        )

    def start(self) -> None:
        """Empty it."""
        self._rotor.clear()
        self._set.clear()
        self._loss_share = self._broken = 0.0

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Separate for dt."""
        h, ratio, came = dt / NS, ratio_of(inputs), inputs["fed"]
        wet = moisture(came)
        p = self._passage(inputs, h, wet[1])
        drum, entering = added(inputs["drum"]), added(came)
        layer = drum.mog / h / self._d.straw / max(ratio, 0.05)
        short = entering.mog * p.short
        through, out = self._rotor.advance(
            (entering.unthreshed, entering.free, entering.mog - short, drum.grain),
            layer=layer,
            dt=h,
            ratio=ratio,
            threshability=self._p.threshability * ratio,
            factors=(p.threshing, p.separation),
            pace=p.pace,
        )
        unthreshed, lost, dropped, leaving = out
        if leaving > 0.0:
            self._loss_share = min(
                max((unthreshed + lost) / leaving, 0.0), 1.0
            )  # drum and stream may not agree
        if entering.free > 0.0:
            self._broken = entering.broken / entering.free
        broken = min(self._broken * p.broken, 1.0)
        power = self._work * (drum.mog / h) * p.power
        return {
            "over": sent(t + dt, h, [unthreshed, lost, lost * broken, dropped, 0.0, 0.0], wet),
            "through": sent(t + dt, h, [0.0, through, through * broken, 0.0, short, 0.0], wet),
            "work": self.work(t + dt, h, drum.grain, drum.mog, power=power, loss_share=self._loss_share),
        }

    def held(self) -> Sequence[Sequence[float]]:
        """Grain and straw in them [kg]."""
        return [self._rotor.held()]

    def _passage(self, inputs: Inputs, h: float, straw_moisture: float) -> Passage:
        """At the settings after h [s]."""
        p, s = self._p, self._set.over_own(inputs, h)
        v, c, pace = s["drum"], 1.0 / s["concave"], s["vane"]
        harder = self._set.crop.rotors
        threshing, separation = (harder * f for f in rate_factors(p, v, c, straw_moisture))
        late = pace**-p.vane_power
        short = p.short_percent * PERCENT * (v**p.short_speed * c**p.short_clearance * late)
        return Passage(threshing / pace, separation / pace, pace, min(short, 1.0), late, v * late)


class IdealSeparation(Organ):
    """All grain falls through at once."""

    inputs = (crop("fed"),)
    outputs = given("over", "through")

    def __init__(self, params: None, setup: SiteSetup) -> None:
        self._work = drivetrain_of(setup.machine).consumers.separation_work

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Take the grain out of what came."""
        h, came = dt / NS, inputs["fed"]
        ear, free, broken, straw, short, chaff = masses(came)
        wet = moisture(came)
        mog = straw + short + chaff
        return {
            "over": sent(t + dt, h, [0.0, 0.0, 0.0, straw, short, chaff], wet),
            "through": sent(t + dt, h, [0.0, ear + free, broken, 0.0, 0.0, 0.0], wet),
            "work": self.work(t + dt, h, ear + free, mog, power=self._work * (mog / h)),
        }


LEVEL = Level(
    Rotors,
    Params,
    summary="rotors: the laws of the drum, parcel by parcel, at the layer that entered",
    cost="about 35 us per step",
    tolerance="equal to the closed forms",
    numbers=("transport", "threshing", "power"),
)
PRESETS = {"ideal": Level(IdealSeparation, None, "all grain falls through at once", cost="10 us",
                          tolerance="exact")}  # fmt: skip
