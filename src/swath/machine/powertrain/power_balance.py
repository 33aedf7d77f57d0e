"""Who takes how much power, and what the engine can give and burns."""

from dataclasses import dataclass

from swath.machine.drivetrain_sheet import Drivetrain, Engine
from swath.machine.machine_sheet import Dynamics
from swath.machine.tyre import GRAVITY
from swath.signals import EngineState, MachineLoad, MachineState

FIRM_SPEED = 0.1  # rolling resistance grows to its full value up to this speed [m/s]


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
        """All but propulsion [W]."""
        crop = self.header + self.threshing + self.separation + self.cleaning + self.chopper
        return crop + self.unloading + self.auxiliary

    @property
    def total(self) -> float:
        """Everything [W]."""
        return self.belts + self.propulsion


def powers(load: MachineLoad, propulsion: float, width: float, drivetrain: Drivetrain) -> Powers:
    """Power at rated speed from the flows of the crop; header width [m], propulsion [W] at the engine."""
    c = drivetrain.consumers
    chopper = c.chopper + c.chopper_work * load.chopper_flow if load.chopper_flow > 0.0 else 0.0
    return Powers(
        header=c.header_width * width + c.header_work * load.header_flow,
        threshing=c.drum_work * load.drum_flow,
        separation=c.separation_work * load.rotor_flow,
        cleaning=c.cleaning,
        chopper=chopper,
        unloading=c.unloading if load.unload_flow > 0.0 else 0.0,
        propulsion=propulsion,
        auxiliary=c.auxiliary,
    )


def pull(state: MachineState, accel: float, grain: float, dynamics: Dynamics) -> float:
    """Force at the wheels [N]: rolling resistance, grade, acceleration [m/s2]; grain in the tank [kg]."""
    mass = dynamics.mass + grain
    rise = float(state.pose.rotation[2, 0])  # of the forward axis, -sin(pitch)
    rolling = dynamics.rolling_resistance * min(max(state.speed / FIRM_SPEED, -1.0), 1.0)
    return mass * (GRAVITY * (rolling + rise) + accel)


def propulsion_power(force: float, speed: float, efficiency: float) -> float:
    """At the engine [W]; braking gives nothing back."""
    return max(force * speed, 0.0) / efficiency


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


def fuel_rate(power: float, speed: float, e: Engine) -> float:
    """Fuel [kg/s] by Willans' line: in proportion to the work, and what turning alone burns."""
    return e.fuel_per_work * power + e.fuel_idle * speed / e.rated_speed


def engine_state(
    t: int,
    p: Powers,
    speed: float,
    power: float,
    load: float,
    used: float,
    limit: float,
    drivetrain: Drivetrain,
) -> EngineState:
    """The sample: belts scaled to the engine's speed."""
    e = drivetrain.engine
    ratio = speed / e.rated_speed
    r = ratio ** (1.0 + drivetrain.consumers.speed_exponent)
    return EngineState(
        t,
        speed=speed,
        speed_ratio=ratio,
        load=load,
        power=power,
        fuel=fuel_rate(power, speed, e),
        fuel_used=used,
        header_power=p.header * r,
        threshing_power=p.threshing * r,
        separation_power=p.separation * r,
        cleaning_power=p.cleaning * r,
        chopper_power=p.chopper * r,
        unloading_power=p.unloading * r,
        propulsion_power=p.propulsion,
        auxiliary_power=p.auxiliary * r,
        speed_limit=limit,
    )
