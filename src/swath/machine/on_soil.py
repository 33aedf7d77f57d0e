"""The four tyres of a machine on soil that gives way: what it takes from them, the ruts that they leave."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import cos, hypot, nan, sin
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Le

from swath.core.component import KeepsState
from swath.core.errors import InputError
from swath.core.units import KPA
from swath.field.field import Field
from swath.field.ground.soil import Soil, Strip
from swath.machine.machine_sheet import Axle, MachineSheet, dynamics_of, loaded, masses_of
from swath.machine.soil import Brixius, Grip
from swath.machine.tyre import GRAVITY
from swath.signals import F64, MachineState
from swath.signals.setup import MachineGeometry

DEFAULT_KPA = 1200.0  # of `soil: brixius` where neither motion nor field say more
EVERY = 0.125  # ruts are laid each time the machine has gone so far: a node of the ground [m]


@dataclass(frozen=True)
class OnTyres:
    """What of tyres and soil is not as the machine's sheet has it.

    stiffness_per_rad: cornering stiffness over load
    understeer_deg_per_g: > 0 where the front axle gives way more than the rear one, < 0 where less
    friction: largest side force over load [1]
    rolling_resistance: rolling resistance over load, on firm soil [1]
    soil: `firm`, or `brixius`: wheels slip and are held, of `multibody` sink in, too, by the soil's cone
        index (ASABE D497); default: as `field.soil` says
    cone_index_kpa: strength of the soil under `brixius`: 450 soft, 900 tilled, 1200 firm, 1800 hard; default:
        that of `field.soil`, else 1200
    """

    stiffness_per_rad: Annotated[float, Ge(0.5), Le(20)] | None = None
    understeer_deg_per_g: Annotated[float, Ge(-20), Le(20)] | None = None
    friction: Annotated[float, Ge(0.05), Le(1.5)] | None = None
    rolling_resistance: Annotated[float, Ge(0), Le(0.3)] | None = None
    soil: Literal["firm", "brixius"] | None = None
    cone_index_kpa: Annotated[float, Ge(100), Le(10000)] | None = None


class Given(NamedTuple):
    """What soil gives a machine: grips of its two axles, resistance of all wheels over its weight."""

    front: Grip
    rear: Grip
    drag: float


class OnSoil(KeepsState):
    """Tyres in the order front left, front right, rear left, rear right. soil: what they roll on."""

    kept = ("_last",)

    def __init__(self, field: Field, machine: MachineGeometry, index_kpa: float | None = None) -> None:
        self._field, self._machine = field, machine
        soil = field.soil if index_kpa is None else None
        index = KPA * (DEFAULT_KPA if index_kpa is None else index_kpa)
        self.soil = soil or Soil(index, None, np.zeros((0, 4)), 3.0, has_ruts=False)
        self.tyres = [replace(tyre, cone_index=self.soil.index) for tyre in tyres_of(machine)]
        back, front, rear = machine.steered_x, 0.5 * machine.front_track, 0.5 * machine.rear_track
        self._wheels = (0.0, front), (0.0, -front), (back, rear), (back, -rear)
        self._last: F64 | None = None
        self._under = [self.tyres[axle] for axle in (0, 0, 1, 1)]

    def places(self, x: float, y: float, yaw: float) -> F64:
        """World places (4, 2) [m] of the wheels of a machine."""
        c, s = cos(yaw), sin(yaw)
        return np.array([(x + c * a - s * b, y + s * a + c * b) for a, b in self._wheels])

    def under(self, x: float, y: float, yaw: float) -> list[Brixius]:
        """The tyres on the soil that is under each."""
        found = self.soil.at(*self.places(x, y, yaw).T).tolist()
        if found != [tyre.cone_index for tyre in self._under]:
            pairs = zip(self._under, found, strict=True)
            self._under = [replace(tyre, cone_index=index) for tyre, index in pairs]
        return self._under

    def given(self, x: float, y: float, yaw: float, loads: tuple[float, float], slip: float) -> Given:
        """What the soil gives. loads: of the axles [N]; slip: of the driven wheels, in front."""
        tyres = self.under(x, y, yaw)
        front = _mean(*(t.at(0.5 * loads[0], slip) for t in tyres[:2]))
        rear = _mean(*(t.at(0.5 * loads[1], 0.0) for t in tyres[2:]))
        return Given(front, rear, (loads[0] * front.drag + loads[1] * rear.drag) / (loads[0] + loads[1]))

    def loads_at_rest(self, grain: float = 0.0) -> tuple[float, float]:
        """Loads of the axles [N] on level ground with grain [kg] in the tank."""
        d = dynamics_of(self._machine)
        d = loaded(d, masses_of(self._machine).tank, grain) if grain > 0.0 else d
        rear = d.mass * GRAVITY * d.cg_behind / -self._machine.steered_x
        return d.mass * GRAVITY - rear, rear

    def number(self, x: float, y: float, yaw: float, grain: float) -> float:
        """Mobility number of the front wheel that has the least: behind a differential it decides."""
        load = 0.5 * self.loads_at_rest(grain)[0]
        return min(tyre.number(load) for tyre in self.under(x, y, yaw)[:2])

    def roll(self, x: float, y: float, yaw: float, loads: tuple[float, float]) -> None:
        """Leave ruts, once the machine has gone on far enough. loads: of the axles [N]."""
        if not self.soil.has_ruts:
            return
        now = self.places(x, y, yaw)
        if self._last is None:
            self._last = now
        if hypot(*(now[0] - self._last[0]).tolist()) < EVERY:
            return
        rows = zip(
            self._last.tolist(),
            now.tolist(),
            self.under(x, y, yaw),
            np.repeat(loads, 2).tolist(),
            strict=True,
        )
        self._field.press(
            [
                Strip((a, b), (c, d), t.width, t.rut(0.5 * load))
                for (a, b), (c, d), t, load in rows
                if (a, b) != (c, d)
            ]
        )
        self._last = now


def met_by(soil: OnSoil | None, state: MachineState) -> Mapping[str, Any]:
    """What a motion level meets: the strength of the soil under the fixed axle, nan = firm."""
    x, y, _ = state.pose.point(0.0, 0.0, 0.0)
    return {"cone_index_kpa": nan if soil is None else float(soil.soil.at(x, y)) / KPA}


def in_field(field: Any, machine: MachineGeometry) -> OnSoil | None:
    """A machine on the soil of its field; None on firm ground, and where its sheet lacks what it takes."""
    return OnSoil(field, machine) if field.soil is not None and has_tyres(machine) else None


def has_tyres(machine: MachineGeometry) -> bool:
    """Whether a sheet says what soil asks of tyres: a combine's with the section `bodies`."""
    return isinstance(machine, MachineSheet) and machine.masses is not None and not machine.steers_ahead


def soil_of(field: Field, machine: MachineGeometry, params: Any) -> OnSoil | None:
    """Soil for the keys `soil` and `cone_index_kpa` of a motion level; None on firm ground. InputError for a
    machine whose sheet lacks what it takes.
    """
    if params.soil == "firm" or (params.soil is None and field.soil is None):
        return None
    if not has_tyres(machine):
        what = "expected firm, or a combine whose data sheet has the section bodies"
        raise InputError("soil", params.soil or "field.soil", what)
    return OnSoil(field, machine, params.cone_index_kpa)


def tyres_of(machine: MachineGeometry) -> tuple[Brixius, Brixius]:
    """Tyres of the front and the rear axle, with the grip of the sheet and no cone index."""
    d, m = dynamics_of(machine), masses_of(machine)
    share = d.cg_behind / -machine.steered_x
    weight = 0.5 * d.mass * GRAVITY

    def tyre(axle: Axle, deflection: float, section: float, load: float) -> Brixius:
        grip = Grip(d.stiffness, m.stiffness_along, d.friction, m.friction_along, d.rolling_resistance)
        diameter = 2.0 * (axle.radius + deflection)
        return Brixius(grip, 0.0, diameter, axle.patch_width, section, deflection, load)

    return (
        tyre(d.front, m.front_deflection, m.front_section, weight * (1.0 - share)),
        tyre(d.rear, m.rear_deflection, m.rear_section, weight * share),
    )


def _mean(left: Grip, right: Grip) -> Grip:
    return Grip(*(0.5 * (a + b) for a, b in zip(left, right, strict=True)))
