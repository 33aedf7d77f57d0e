"""What the driven wheels pull, and how far they slip for it."""

from swath.core.errors import InputError
from swath.machine.machine_sheet import Dynamics, MachineSheet
from swath.machine.tyre import GRAVITY
from swath.signals import MachineState, WheelState
from swath.signals.setup import MachineGeometry

FIRM_SPEED = 0.1  # rolling resistance grows to its full value up to this speed [m/s]


def pull(state: MachineState, accel: float, grain: float, dynamics: Dynamics) -> float:
    """Force at the wheels [N]: rolling resistance, grade, acceleration [m/s2]; grain in the tank [kg]."""
    mass = dynamics.mass + grain
    rise = float(state.pose.rotation[2, 0])  # of the forward axis, -sin(pitch)
    rolling = dynamics.rolling_resistance * min(max(state.speed / FIRM_SPEED, -1.0), 1.0)
    return mass * (GRAVITY * (rolling + rise) + accel)


def stiffness_of(machine: MachineGeometry) -> float:
    """Longitudinal slip stiffness over load. InputError for a sheet without the section `bodies`."""
    if not isinstance(machine, MachineSheet) or machine.masses is None:
        raise InputError("wheel_slip", True, "expected a machine whose data sheet has the section bodies")
    return machine.masses.stiffness_along


def wheels_of(t: int, speed: float, traction: float, load: float, stiffness: float) -> WheelState:
    """The driven wheels. traction: of all of them, load: on them [N]; slip: traction / (stiffness load), the
    start of the traction curve of the brush tyre (Pacejka 2012, section 3.2.1) and of ASAE D497
    """
    slip = traction / (stiffness * max(load, 1.0))
    return WheelState(t, speed * (1.0 + slip), slip, traction, load)
