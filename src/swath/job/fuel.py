"""Fuel of a job's machines [kg/s].

A combine's is Willans' line of its data sheet over the powers of its consumers (`machine.powertrain`). A
tractor's sheet has no engine: 230 g/kWh over the power at the wheels at 75 % efficiency, and 2.5 kg/h for the
running engine; both are estimates.
"""

from swath.job.states import CartState, CombineState
from swath.machine.machine_sheet import MachineSheet, dynamics_of
from swath.machine.powertrain.power_balance import fuel_rate, powers, propulsion_power
from swath.machine.tyre import GRAVITY
from swath.signals import MachineLoad

STRAW = 0.65  # per grain: the reference of the DLG
TRACTOR_PER_WORK = 230.0 / 3.6e9  # kg/J
TRACTOR_IDLE = 2.5 / 3600.0  # kg/s
TRACTOR_EFFICIENCY = 0.75
DIESEL = 0.835  # kg/l


def combine_fuel(c: CombineState, cutting: float) -> float:
    """Of a combine that cuts so many metres of its pass per second."""
    if c.phase == "done":
        return 0.0
    grain = cutting * c.per_metre
    straw = STRAW * grain
    flow = grain + straw
    load = MachineLoad(
        0, c.tank, 0.0, 0.0, 0.0, 0.0, grain, straw, header_flow=flow, feeder_flow=flow, drum_flow=flow,
        rotor_flow=straw, shoe_flow=grain, chopper_flow=straw,
        unload_flow=c.spec.auger if c.is_pouring else 0.0,
    )  # fmt: skip
    dynamics = dynamics_of(c.spec.sheet)
    force = dynamics.rolling_resistance * (dynamics.mass + c.tank) * GRAVITY
    drive = propulsion_power(force, max(c.speed, 0.0), c.spec.drivetrain.hydrostat.efficiency)
    taken = powers(load, drive, c.spec.sheet.header_width if cutting > 0.0 else 0.0, c.spec.drivetrain)
    engine = c.spec.drivetrain.engine
    total = taken.total if cutting > 0.0 else taken.total - taken.cleaning
    return fuel_rate(total, engine.rated_speed, engine)


def tractor_fuel(k: CartState) -> float:
    """Of a tractor with its cart."""
    return fuel_of_tractor(k.spec.sheet, k.grain, k.speed)


def fuel_of_tractor(sheet: MachineSheet, grain: float, speed: float) -> float:
    """Of a tractor whose cart holds so much grain [kg], at a speed [m/s]."""
    dynamics, trailer = dynamics_of(sheet), sheet.trailer
    mass = dynamics.mass + grain + (trailer.empty if trailer else 0.0)
    power = dynamics.rolling_resistance * mass * GRAVITY * max(speed, 0.0) / TRACTOR_EFFICIENCY
    return TRACTOR_IDLE + TRACTOR_PER_WORK * power
