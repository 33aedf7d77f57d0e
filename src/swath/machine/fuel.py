"""Fuel of machines whose engines are not simulated [kg/s].

A combine's is Willans' line of its data sheet over the powers of its consumers (`machine.powertrain`). A
tractor's sheet has no engine: 230 g/kWh over the power at the wheels at 75 % efficiency, and 2.5 kg/h for the
running engine; both are estimates.
"""

from swath.machine.drivetrain_sheet import Drivetrain
from swath.machine.machine_sheet import MachineSheet, dynamics_of
from swath.machine.powertrain.power_balance import fuel_rate, powers, propulsion_power
from swath.machine.tyre import GRAVITY
from swath.signals import MachineLoad

STRAW = 0.65  # per grain: the reference of the DLG
TRACTOR_PER_WORK = 230.0 / 3.6e9  # kg/J
TRACTOR_IDLE = 2.5 / 3600.0  # kg/s
TRACTOR_EFFICIENCY = 0.75
DIESEL = 0.835  # kg/l


def combine_fuel(
    sheet: MachineSheet, train: Drivetrain, *, tank: float, speed: float, grain: float, cuts: bool, out: float
) -> float:
    """Of a combine with so much grain in its tank [kg], at a speed [m/s], with grain coming in and going out
    [kg/s]; cuts: whether its header turns.
    """
    straw = STRAW * grain
    flow = grain + straw
    load = MachineLoad(
        0, tank, 0.0, 0.0, 0.0, 0.0, grain, straw, header_flow=flow, feeder_flow=flow, drum_flow=flow,
        rotor_flow=straw, shoe_flow=grain, chopper_flow=straw, unload_flow=out,
    )  # fmt: skip
    dynamics = dynamics_of(sheet)
    force = dynamics.rolling_resistance * (dynamics.mass + tank) * GRAVITY
    drive = propulsion_power(force, max(speed, 0.0), train.hydrostat.efficiency)
    taken = powers(load, drive, sheet.header_width if cuts else 0.0, train)
    total = taken.total if cuts else taken.total - taken.cleaning
    return fuel_rate(total, train.engine.rated_speed, train.engine)


def tractor_fuel(sheet: MachineSheet, grain: float, speed: float) -> float:
    """Of a tractor whose cart holds so much grain [kg], at a speed [m/s]."""
    dynamics, trailer = dynamics_of(sheet), sheet.trailer
    mass = dynamics.mass + grain + (trailer.empty if trailer else 0.0)
    power = dynamics.rolling_resistance * mass * GRAVITY * max(speed, 0.0) / TRACTOR_EFFICIENCY
    return TRACTOR_IDLE + TRACTOR_PER_WORK * power
