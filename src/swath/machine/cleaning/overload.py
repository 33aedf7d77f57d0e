"""Cleaning level `overload`: a shoe whose losses rise with its load alone, whatever fan and sieves do."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import fsum, hypot
from operator import sub
from typing import Any, ClassVar

from swath.core.component import Inputs, Outputs, Port
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.field.site_setup import SiteSetup
from swath.machine import SLOPES
from swath.machine.drivetrain_sheet import Cleaning, cleaning_of, drivetrain_of
from swath.machine.organ import (
    ENGINE,
    JOINED,
    SHARED,
    Organ,
    crop,
    given,
    in_transport,
    masses,
    moisture,
    ratio_of,
    sent,
)
from swath.machine.transport import Conveyor
from swath.signals import MachineState

RETURNS_MAX = 0.3  # of the shoe's grain


@dataclass(frozen=True)
class Shares:
    """What becomes of what leaves the shoe.

    lost: of the grain, over the rear
    back: of the rest, and of other material, to the returns; of grain in the ear all
    mog: other material in the tank, over its grain
    """

    lost: float
    back: float
    mog: float = 0.0


class Shoe(Organ):
    """Return pan and sieves; some grain goes over the rear with the chaff, some back to the drum."""

    kept: ClassVar[tuple[str, ...]] = ("_shoe",)
    _effort = 1.0  # power over that of the data sheet
    inputs: tuple[Port, ...] = (crop("pan"), crop("more"), Port("state", MachineState), ENGINE)
    outputs = given("clean", "returned", "over")

    def __init__(self, params: Any, setup: SiteSetup) -> None:
        self._c = cleaning_of(setup.machine)
        self._power = drivetrain_of(setup.machine).consumers.cleaning
        self._shoe = Conveyor(self._length(setup), len(SHARED), joined=JOINED)

    def _length(self, setup: SiteSetup) -> float:
        return drivetrain_of(setup.machine).transport.shoe

    def start(self) -> None:
        """Empty it."""
        self._shoe.clear()

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Clean what leaves the sieves within dt."""
        h, came = dt / NS, (*inputs["pan"], *inputs["more"])
        ear, free, broken, straw, short, chaff = self._shoe.advance(masses(came), h * ratio_of(inputs))
        grain, mog = ear + free, straw + short + chaff
        s = self._shares((grain + mog) / h, mog / h, h, inputs)
        if grain <= 0.0:
            s = Shares(0.0, s.back)
        power = self._power * self._effort
        end, wet = t + dt, moisture(came)
        came_in = free, broken, straw, short, chaff
        lost = free * s.lost, broken * s.lost, 0.0, 0.0, 0.0
        rest = [*map(sub, came_in, lost)]
        back = [m * s.back for m in rest]
        rest = [*map(sub, rest, back)]
        light = fsum(rest[2:])
        part = min(s.mog * rest[0] / light, 0.5) if light > 0.0 else 0.0
        dirt = [m * part for m in rest[2:]]
        return {
            "clean": sent(end, h, [0.0, *rest[:2], *dirt], wet),
            "returned": sent(end, h, [ear, *back], wet),
            "over": sent(end, h, [0.0, *lost[:2], *map(sub, rest[2:], dirt)], wet),
            "work": self.work(end, h, grain, mog, power=power, loss_share=s.lost),
        }

    def held(self) -> Sequence[Sequence[float]]:
        """Grain and other material on it [kg]."""
        return [in_transport(self._shoe)]

    def _shares(self, flow: float, mog: float, h: float, inputs: Inputs) -> Shares:
        """At a flow of all and of what is not grain on the sieves [kg/s], h [s] later."""
        load = shoe_load(flow, self._c, inputs["state"])
        return Shares(shoe_loss(load, self._c), min(self._c.returns * load, RETURNS_MAX))


class IdealShoe(Shoe):
    """All grain to the tank, everything else over the rear."""

    def _length(self, setup: SiteSetup) -> float:
        return 0.0

    def _shares(self, flow: float, mog: float, h: float, inputs: Inputs) -> Shares:
        return Shares(0.0, 0.0)


def shoe_load(flow: float, shoe: Cleaning, state: MachineState) -> float:
    """Load of the shoe over its nominal one: grain and chaff [kg/s], heavier on a slope."""
    rise, side, up = map(float, state.pose.numbers[1][2])  # -sin(pitch), tan(roll) * up
    slope = shoe.side_slope * abs(side / up) + shoe.up_slope * max(0.0, rise / hypot(side, up))
    return flow / shoe.flow * (1.0 + slope)


def shoe_loss(load: float, shoe: Cleaning) -> float:
    """Share of the grain on the shoe that goes over the rear."""
    over = min(max(0.0, load - shoe.knee) / shoe.doubling, 30.0)
    return float(min(1.0, shoe.loss * 2.0**over))


LEVEL = Level(
    Shoe,
    None,
    summary="a shoe whose losses and returns rise with its load; it knows no fan and no sieves",
    cost="about 20 us per step",
    tolerance="equal to the closed forms",
    numbers=("transport", "cleaning", "power"),
    checked=SLOPES,
)
PRESETS = {"ideal": Level(IdealShoe, None, "all grain to the tank, all else over the rear", cost="15 us",
                          tolerance="exact")}  # fmt: skip
