"""Separation level `model`: rotors, in which what is left in the ear is threshed and free grain separated.

The laws are those of the drum (`threshing.model`), parcel by parcel; docs/explanation/machine.md.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.field.site_setup import SiteSetup
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.organ import ENGINE, Organ, added, crop, given, masses, moisture, ratio_of
from swath.machine.threshing.model import Params
from swath.signals import CropStream, OrganWork

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
        if abs(separation - threshing) < 1e-6 * threshing:
            separation = threshing * (1.0 + 1e-6)  # two rates that are never equal need no limit
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
    ) -> tuple[float, list[float]]:
        """Take in a step's crop [kg] and move everything on by dt [s].

        crop: grain in the ear, free grain, straw, and the grain it had before the drum [kg]
        layer: thickness of what enters, 1 = nominal; ratio: rotor speed over nominal; threshability: factor
        on both rates. Returns the grain separated [kg] and what leaves [kg], four as `crop`
        """
        path = dt * ratio / self._passage
        if any(crop):
            scale = max(layer, 1e-3) ** -self._exponent
            new = np.array([[0.0], [path], *([m] for m in crop), [scale]])
            self._parcels = np.concatenate([self._parcels, new], axis=1)
        p = self._parcels
        if p.shape[1] == 0:
            return 0.0, [0.0] * 4
        front = p[FRONT] + path
        done = (np.minimum(front, 1.0) - p[FRONT]) * p[SCALE]
        threshing, separation = self._rates
        still, kept = portable.exp(
            done * np.array([[-threshability * threshing], [-threshability * separation]])
        )
        ear = p[EAR] * still
        free = p[FREE] * kept + p[EAR] * (still - kept) * (threshing / (separation - threshing))
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


class Rotors(Organ):
    """The layer in them is that of the drum: `drum` is its work."""

    kept = ("_rotor", "_loss_share")
    inputs = (crop("fed"), Port("drum", OrganWork, history=True), ENGINE)
    outputs = given("over", "through")

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        drivetrain = drivetrain_of(setup.machine)
        d = self._d = drivetrain.threshing
        self._threshability, self._work = params.threshability, drivetrain.consumers.separation_work
        self._rotor = Rotor(
            d.rotor_threshing, d.rotor_separation, d.rotor_exponent, drivetrain.transport.rotor
        )

    def start(self) -> None:
        """Empty it."""
        self._rotor.clear()
        self._loss_share = 0.0

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Separate for dt."""
        h, ratio, came = dt / NS, ratio_of(inputs), inputs["fed"]
        drum, entering = added(inputs["drum"]), added(came)
        layer = drum.mog / h / self._d.straw / max(ratio, 0.05)
        fed = (entering.unthreshed, entering.free, entering.mog, drum.grain)
        threshability = self._threshability * ratio
        through, out = self._rotor.advance(fed, layer=layer, dt=h, ratio=ratio, threshability=threshability)
        unthreshed, lost, dropped, leaving = out
        if leaving > 0.0:
            self._loss_share = (unthreshed + lost) / leaving
        wet = moisture(came)
        power = self._work * (drum.mog / h)
        return {
            "over": CropStream(t + dt, unthreshed, lost, straw=dropped, dt=h, **wet),
            "through": CropStream(t + dt, free=through, dt=h, **wet),
            "work": self.work(t + dt, h, drum.grain, drum.mog, power=power, loss_share=self._loss_share),
        }

    def held(self) -> Sequence[Sequence[float]]:
        """Grain and straw in them [kg]."""
        return [self._rotor.held()]


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
            "over": CropStream(t + dt, straw=straw, short=short, chaff=chaff, dt=h, **wet),
            "through": CropStream(t + dt, free=ear + free, broken=broken, dt=h, **wet),
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
