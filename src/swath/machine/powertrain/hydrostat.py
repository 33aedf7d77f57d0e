"""Powertrain level `hydrostat`: an engine that loses speed under load, and a drive that yields to it.

J dw/dt = T - T_load, lag dT/dt = governed torque - T; belts take torque, the hydrostat takes power. Equations
and sources: docs/explanation/machine.md.
"""

from dataclasses import dataclass
from math import ceil
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, Outputs
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import MS
from swath.field.site_setup import SiteSetup
from swath.machine import DRIVEN, SLOPES
from swath.machine.powertrain.power_balance import (
    Powers,
    Powertrain,
    fuel_rate,
    full_torque,
    governed_speed,
    governed_torque,
    steady,
)
from swath.signals import MachineState

STALL_SHARE = 0.3  # the engine does not fall below this share of rated speed: it would stall [-]
HEADROOM = 0.2  # a drive that yields starts from this much above the present speed [m/s]


@dataclass(frozen=True)
class Params:
    """An engine with a hydrostatic drive.

    recover_m_s2: how fast the ground speed may rise again after an overload
    substep_ms: longest integration step
    rated_power_kw: rated power of another engine in the same machine; none = that of the data sheet
    """

    recover_m_s2: Annotated[float, Gt(0), Le(5)] = 0.2
    substep_ms: Annotated[float, Ge(0.01), Le(50)] = 25.0
    rated_power_kw: Annotated[float, Ge(1), Le(2000)] | None = None


class HydrostatPowertrain(Powertrain):
    """Engine speed and torque as states; the limit of the ground speed as a third."""

    kept = (*Powertrain.kept, "_speed", "_torque", "_limit")

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        super().__init__(params.rated_power_kw, setup)
        self._p = params

    def reset(self, stream: Stream) -> Outputs:
        """Running without crop, as its governor holds it."""
        e, taken = self._drivetrain.engine, self._at_rest()
        self._torque = taken.total / e.rated_speed
        self._speed = governed_speed(self._torque, e)
        self._limit = self._dynamics.max_speed
        return self._sample(0, taken)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Integrate engine and limit over dt; the powers are held."""
        state: MachineState = inputs["state"]
        h, e = dt / NS, self._drivetrain.engine
        taken, force = self._taken(inputs, self._gained(state.speed) / h)
        belts = taken.belts / e.rated_speed
        count = max(1, ceil(h / (self._p.substep_ms * MS) - 1e-9))
        for _ in range(count):
            self._advance(belts, taken.propulsion, h / count)
        self._limit = self._new_limit(state.speed, force, h)
        self._fuel.add(fuel_rate(self._torque * self._speed, self._speed, e) * h)
        return self._sample(t + dt, taken)

    def _rates(self, speed: float, torque: float, belts: float, power: float) -> tuple[float, float]:
        e, k = self._drivetrain.engine, self._drivetrain.consumers.speed_exponent
        if k > 0.0:
            belts *= (speed / e.rated_speed) ** k
        return (
            (torque - belts - power / speed) / e.inertia,
            (governed_torque(speed, e) - torque) / e.torque_lag,
        )

    def _advance(self, belts: float, power: float, h: float) -> None:
        """One classical Runge-Kutta step of order 4; belts ask for a torque whatever their speed [N m], the
        hydrostat for a power [W].
        """
        n, m = self._speed, self._torque
        a = self._rates(n, m, belts, power)
        b = self._rates(n + 0.5 * h * a[0], m + 0.5 * h * a[1], belts, power)
        c = self._rates(n + 0.5 * h * b[0], m + 0.5 * h * b[1], belts, power)
        d = self._rates(n + h * c[0], m + h * c[1], belts, power)
        n += h / 6.0 * (a[0] + 2.0 * (b[0] + c[0]) + d[0])
        m += h / 6.0 * (a[1] + 2.0 * (b[1] + c[1]) + d[1])
        self._speed = max(n, STALL_SHARE * self._drivetrain.engine.rated_speed)
        self._torque = max(m, 0.0)

    def _new_limit(self, ground: float, force: float, h: float) -> float:
        """Largest ground speed [m/s]: pump flow, power and pull of the drive, and what the engine bears."""
        e, d = self._drivetrain.engine, self._drivetrain.hydrostat
        ratio = min(self._speed / e.rated_speed, 1.0)
        limit = self._dynamics.max_speed * ratio
        if force > 0.0:
            limit = min(limit, d.power / force) if force <= d.pull else 0.0
        strength = (self._speed - d.relief_end) / (d.relief_start - d.relief_end)
        strength = min(max(strength, 0.0), 1.0)
        held = self._limit
        if strength < 1.0:
            held = min(held, ground + HEADROOM)
        held += h * (self._p.recover_m_s2 * strength - self._dynamics.decel * (1.0 - strength))
        return max(0.0, min(limit, held))

    def _sample(self, t: int, taken: Powers) -> Outputs:
        e, speed = self._drivetrain.engine, self._speed
        belts = taken.belts * (speed / e.rated_speed) ** self._drivetrain.consumers.speed_exponent
        asked = belts / e.rated_speed + taken.propulsion / speed
        load = asked / full_torque(min(speed, e.rated_speed), e)
        return self._state(t, taken, speed=speed, power=self._torque * speed, load=load, limit=self._limit)


LEVEL = Level(
    HydrostatPowertrain,
    Params,
    summary="torque curve, governor, fuel; the drive slows down when the engine is overloaded",
    cost="about 30 us per step",
    tolerance="steady speeds equal to the torque balance; the powers per consumer are 30 % guesses",
    numbers=("engine", "power", "hydrostat"),
    steady=steady,
    checked=(DRIVEN, SLOPES[1]),
)
