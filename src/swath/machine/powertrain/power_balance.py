"""Who takes how much power, and what the engine can give and burns."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.field.site_setup import SiteSetup
from swath.machine.compensated_sum import Total
from swath.machine.drivetrain_sheet import Drivetrain, Engine, drivetrain_of
from swath.machine.machine_sheet import MachineSheet, dynamics_of
from swath.machine.on_soil import in_field
from swath.machine.traction import pull
from swath.signals import EngineState, MachineLoad, MachineState, OrganLoads


@dataclass(frozen=True)
class Powers:
    """Power taken at rated speed [W]. All but propulsion hang on belts and fall with the engine's speed."""

    header: float
    threshing: float
    separation: float
    cleaning: float
    chopper: float
    unloading: float
    propulsion: float
    auxiliary: float

    @property
    def belts(self) -> float:
        """Power of all consumers but propulsion [W]."""
        crop = self.header + self.threshing + self.separation + self.cleaning + self.chopper
        return crop + self.unloading + self.auxiliary

    @property
    def total(self) -> float:
        """Everything [W], at least 0: what a descent gives beyond what the belts take is braked away."""
        return max(self.belts + self.propulsion, 0.0)


def powers(
    load: MachineLoad,
    propulsion: float,
    width: float,
    drivetrain: Drivetrain,
    organs: OrganLoads | None = None,
) -> Powers:
    """Power at rated speed from the flows of the crop; header width [m], propulsion [W] at the engine.

    organs: what these take themselves
    """
    c = drivetrain.consumers
    chopper = c.chopper + c.chopper_work * load.chopper_flow if load.chopper_flow > 0.0 else 0.0
    header = c.header_width * width + c.header_work * load.header_flow
    threshing, separation = c.drum_work * load.drum_flow, c.separation_work * load.rotor_flow
    cleaning = c.cleaning
    if organs is not None:
        header, threshing = organs.header_power, organs.threshing_power
        separation, cleaning = organs.separation_power, organs.cleaning_power
    return Powers(
        header=header,
        threshing=threshing,
        separation=separation,
        cleaning=cleaning,
        chopper=chopper,
        unloading=c.unloading if load.unload_flow > 0.0 else 0.0,
        propulsion=propulsion,
        auxiliary=c.auxiliary,
    )


def propulsion_power(force: float, speed: float, efficiency: float) -> float:
    """At the engine [W].

    Downhill the wheels turn the pump: what is left of their power, below 0, drives the belts, since a closed
    hydraulic circuit passes power both ways.
    """
    power = force * speed
    return power / efficiency if power > 0.0 else power * efficiency


def full_torque(speed: float, e: Engine) -> float:
    """Largest torque [N m] at an engine speed [rad/s], flat beyond rated speed."""
    rated = e.rated_power / e.rated_speed
    if speed >= e.rated_speed:
        return rated
    if speed >= e.torque_speed:
        return rated * (1.0 + e.torque_rise * (e.rated_speed - speed) / (e.rated_speed - e.torque_speed))
    share = max(speed - e.idle_speed, -0.5 * e.idle_speed) / (e.torque_speed - e.idle_speed)
    return rated * max(e.idle_torque + (1.0 + e.torque_rise - e.idle_torque) * share, 0.0)


def governed_torque(speed: float, e: Engine) -> float:
    """Torque [N m] that the governor asks for: full load at rated speed, none `droop` above it."""
    rated = e.rated_power / e.rated_speed
    wanted = rated * ((1.0 + e.droop) * e.rated_speed - speed) / (e.droop * e.rated_speed)
    return min(max(wanted, 0.0), full_torque(speed, e))


def governed_speed(torque: float, e: Engine) -> float:
    """Speed [rad/s] at which the governor holds a torque [N m] below the rated one."""
    rated = e.rated_power / e.rated_speed
    return e.rated_speed * (1.0 + e.droop * (1.0 - min(max(torque / rated, 0.0), 1.0)))


def with_power(drivetrain: Drivetrain, rated_power: float) -> Drivetrain:
    """The same machine with another engine: rated power [W]; what turning alone burns grows with it."""
    e = drivetrain.engine
    idle = e.fuel_idle * rated_power / e.rated_power
    return replace(drivetrain, engine=replace(e, rated_power=rated_power, fuel_idle=idle))


def fuel_rate(power: float, speed: float, e: Engine) -> float:
    """Fuel [kg/s] by Willans' line: in proportion to the work, and what turning alone burns."""
    return e.fuel_per_work * power + e.fuel_idle * speed / e.rated_speed


def steady(machine: MachineSheet, state: MachineState, load: MachineLoad) -> dict[str, float]:
    """Load of the engine and fuel [kg/s] at rated speed: below full load every level comes to that."""
    drivetrain, width = drivetrain_of(machine), machine.header_width
    force = pull(state, 0.0, load.tank_grain, dynamics_of(machine))
    driving = propulsion_power(force, state.speed, drivetrain.hydrostat.efficiency)
    total, e = powers(load, driving, width, drivetrain).total, drivetrain.engine
    share = total / e.rated_power
    return {"mean_engine_load": share, "peak_engine_load": share,
            "fuel_l_t": fuel_rate(total, e.rated_speed, e)}  # fmt: skip


class Powertrain(KeepsState):
    """What every level has: the sheet of its machine, the fuel used, the ground speed before."""

    inputs = (
        Port("state", MachineState),
        Port("load", MachineLoad),
        Port("organs", OrganLoads, optional=True),
    )
    outputs = (Port("engine", EngineState),)
    kept: ClassVar[tuple[str, ...]] = ("_fuel", "_before")

    def __init__(self, rated_power_kw: float | None, setup: SiteSetup) -> None:
        """rated_power_kw: of the engine, None = that of the data sheet."""
        sheet = drivetrain_of(setup.machine)
        self._drivetrain = sheet if rated_power_kw is None else with_power(sheet, 1e3 * rated_power_kw)
        self._dynamics = dynamics_of(setup.machine)
        self._soil = in_field(setup.field, setup.machine)
        self._width = setup.machine.header_width

    def _at_rest(self) -> Powers:
        """Nothing threshed, nothing burnt; the powers of running empty."""
        self._fuel, self._before = Total(), math.nan
        return powers(MachineLoad(0, *[0.0] * 7), 0.0, self._width, self._drivetrain)

    def _gained(self, speed: float) -> float:
        """Ground speed gained since the last step [m/s], 0 in the first."""
        before, self._before = self._before, speed
        return 0.0 if math.isnan(before) else speed - before

    def _taken(self, inputs: Inputs, accel: float) -> tuple[Powers, float]:
        """Powers at rated speed [W] and the force at the wheels [N] at an acceleration [m/s2]."""
        state, load = inputs["state"], inputs["load"]
        dynamics = self._dynamics
        if self._soil is not None:
            (x, y, _), yaw = state.pose.position.tolist(), state.pose.euler()[2]
            given = self._soil.given(x, y, yaw, self._soil.loads_at_rest(load.tank_grain), 0.0)
            dynamics = replace(dynamics, rolling_resistance=given.drag)
        force = pull(state, accel, load.tank_grain, dynamics)
        driving = propulsion_power(force, state.speed, self._drivetrain.hydrostat.efficiency)
        return powers(load, driving, self._width, self._drivetrain, inputs.get("organs")), force

    def _state(self, t: int, p: Powers, *, speed: float, power: float, load: float, limit: float) -> Outputs:
        """The sample, belts scaled to the speed [rad/s]. power [W]; limit: of the ground speed [m/s]."""
        e, ratio = self._drivetrain.engine, speed / self._drivetrain.engine.rated_speed
        r = ratio ** (1.0 + self._drivetrain.consumers.speed_exponent)
        engine = EngineState(
            t,
            speed=speed,
            speed_ratio=ratio,
            load=load,
            power=power,
            fuel=fuel_rate(power, speed, e),
            fuel_used=self._fuel.value,
            speed_limit=limit,
            propulsion_power=p.propulsion,
            **{f"{name}_power": value * r for name, value in vars(p).items() if name != "propulsion"},
        )
        return {"engine": engine}
