"""What the driven wheels pull, how far they slip for it, and what a slope leaves them."""

from math import inf
from typing import NamedTuple

import numpy as np

from swath.core.component import KeepsState
from swath.core.errors import InputError
from swath.kernels import Row, Rows, repeatable, shared
from swath.machine.loops import loop_of
from swath.machine.machine_sheet import Dynamics, MachineSheet, dynamics_of
from swath.machine.tyre import GRAVITY
from swath.signals import MachineState
from swath.signals.setup import MachineGeometry

FIRM_SPEED = 0.1  # rolling resistance grows to its full value up to this speed [m/s]


class Traction(NamedTuple):
    """The driven wheels on a slope: brush tyres along (Pacejka 2012, section 3.2.1) under a drive that holds
    their rim speed, as in `multibody`. Forces are over the weight, `grade` is the rise of the ground ahead
    [m/m], slip is (rim speed - ground speed) / ground speed.

    stiffness, friction: along, over load
    relaxation: length of the slip along [m]
    thrust: of the drive
    level_share, grade_share: what they carry of the weight is level_share - grade_share * grade
    """

    stiffness: float
    friction: float
    relaxation: float
    thrust: float
    level_share: float
    grade_share: float


class DrivenWheels(KeepsState):
    """Forward motion, compiled: see `drive_kernel.rolled`. speed: over ground; rim [m/s]; slip."""

    kept = ("speed", "rim", "slip")

    def __init__(self, dynamics: Dynamics) -> None:
        from swath.machine import drive_kernel as kernel

        loops, self._asked = Rows(kernel.Loop, 1, [loop_of(dynamics)]), np.zeros(3)
        self._traction, self._wheels = Row(kernel.Traction), Row(kernel.Wheels)
        given = loops.array, self._traction.array, shared(self._asked), self._wheels.array
        self._roll = repeatable(kernel.roll_wheels, [*given]).launch
        self.reset(0.0)

    def reset(self, speed: float) -> None:
        """Roll at a speed [m/s] without slip."""
        self.speed, self.rim, self.slip = speed, speed, 0.0

    def advance(self, wanted: float, dt: float, pitch: float, traction: Traction) -> tuple[float, float]:
        """Drive on for dt [s] at a wanted speed [m/s]; pitch [rad] is held over it.

        Returns the speed in the middle of the time [m/s] and the way [m].
        """
        self._wheels.write(self.speed, self.rim, self.slip, 0.0, 0.0)
        self._traction.write(*traction, 0.0)
        self._asked[:] = wanted, dt, pitch
        self._roll()
        self.speed, self.rim, self.slip, middle, way = self._wheels.read()
        return middle, way


def traction_of(machine: MachineGeometry, dynamics: Dynamics | None = None, towed: float = 0.0) -> Traction:
    """Of a machine. dynamics: with what is in its tank; towed: mass of a trailer whose weight it pulls [kg].

    A combine drives with its fixed axle, a machine that steers ahead with all wheels. Where its sheet has no
    longitudinal values, the tread is as stiff and grips as well along as across.
    """
    d = dynamics or dynamics_of(machine)
    masses = machine.masses if isinstance(machine, MachineSheet) else None
    stiffness = d.stiffness if masses is None else masses.stiffness_along
    friction = d.friction if masses is None else masses.friction_along
    relaxation = d.front.relaxation * (stiffness / d.stiffness) * (d.friction / friction) ** 2
    thrust = inf if masses is None else masses.thrust / (d.mass * GRAVITY)
    level, grade = 1.0, 0.0
    if not machine.steers_ahead:
        level, grade = 1.0 - d.cg_behind / machine.wheelbase, d.cg_height / machine.wheelbase
    own = d.mass / (d.mass + towed)
    return Traction(stiffness, friction, relaxation, thrust, level * own, grade * own)


def across_of(machine: MachineGeometry) -> Traction:
    """Traction of all wheels against a side slope."""
    d = dynamics_of(machine)
    return Traction(d.stiffness, d.friction, d.front.relaxation, inf, 1.0, 0.0)


def pull(state: MachineState, accel: float, grain: float, dynamics: Dynamics) -> float:
    """Force at the wheels [N]: rolling resistance, grade, acceleration [m/s2]; grain in the tank [kg]."""
    mass = dynamics.mass + grain
    rise = float(state.pose.rotation[2, 0])  # of the forward axis, -sin(pitch)
    rolling = dynamics.rolling_resistance * min(max(state.speed / FIRM_SPEED, -1.0), 1.0)
    return mass * (GRAVITY * (rolling + rise) + accel)


def check_wheel_slip(machine: MachineGeometry) -> None:
    """InputError for a sheet without the section `bodies`."""
    if not isinstance(machine, MachineSheet) or machine.masses is None:
        raise InputError("wheel_slip", True, "expected a machine whose data sheet has the section bodies")
