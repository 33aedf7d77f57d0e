"""What the driven wheels pull, how far they slip for it, and what a slope leaves them."""

from dataclasses import dataclass
from math import cbrt, copysign, cos, expm1, inf, sin, sqrt

from swath.core.component import KeepsState
from swath.core.errors import InputError
from swath.machine.loops import SpeedLoop
from swath.machine.machine_sheet import Dynamics, MachineSheet, dynamics_of
from swath.machine.tyre import GRAVITY
from swath.signals import MachineState, WheelState
from swath.signals.setup import MachineGeometry

FIRM_SPEED = 0.1  # rolling resistance grows to its full value up to this speed [m/s]
LEAST_LOAD = 0.02  # an axle keeps this share of the weight: it does not tip over


@dataclass(frozen=True)
class Traction:
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

    def grip(self, grade: float) -> float:
        """Largest force, over what presses the machine on the ground."""
        share = self.level_share - self.grade_share * grade
        return self.friction * min(max(share, LEAST_LOAD), 1.0)

    def slip_of(self, force: float, grip: float) -> float:
        """Steady slip at a force along the ground: the brush formula turned round, full sliding at most."""
        free = 1.0 - abs(force) / grip
        x = 1.0 - cbrt(free) if free > 0.0 else 1.0
        return copysign(3.0 * self.friction / self.stiffness * x, force)

    def slip_after(self, slip: float, grade: float, way: float) -> float:
        """The slip on a slope after a way [m]: it lags by the relaxation length (Pacejka 2012, 7.2)."""
        gone = -expm1(-way / self.relaxation)
        return slip + (self.slip_of(grade, self.grip(grade)) - slip) * gone

    def given(self, before: float, after: float, grade: float, dt: float) -> float:
        """The ground speed [m/s] nearest to `after` that the wheels can give on a slope within dt [s]."""
        level = 1.0 / sqrt(1.0 + grade * grade)
        most = min(self.grip(grade) * level, self.thrust)
        low = before + dt * (GRAVITY * (-most - grade * level))
        high = before + dt * (GRAVITY * (most - grade * level))
        return min(max(after, low), high)


class DrivenWheels(KeepsState):
    """Forward motion: the loop of the drive turns the rims, the slip on a slope makes the ground speed of it.

    speed: over ground; rim [m/s]; slip
    """

    kept = ("speed", "rim", "slip")

    def __init__(self, loop: SpeedLoop) -> None:
        self._loop = loop
        self.reset(0.0)

    def reset(self, speed: float) -> None:
        """Roll at a speed [m/s] without slip."""
        self.speed, self.rim, self.slip = speed, speed, 0.0

    def advance(self, wanted: float, dt: float, pitch: float, traction: Traction) -> tuple[float, float]:
        """Drive on for dt [s] at a wanted speed [m/s]; pitch [rad] is held over it.

        Returns the speed in the middle of the time [m/s] and the way [m].
        """
        grade, before, slip = grade_of(pitch), self.speed, self.slip
        half, _ = self._loop.advance(self.rim, wanted, 0.5 * dt)
        self.rim, travel = self._loop.advance(self.rim, wanted, dt)
        self.slip = traction.slip_after(slip, grade, abs(before) * dt)
        mean = 1.0 + 0.5 * (slip + self.slip)
        free = self.rim / (1.0 + self.slip)
        self.speed = traction.given(before, free, grade, dt)
        if self.speed == free:
            return half / mean, travel / mean
        self.rim = self.speed * (1.0 + self.slip)
        middle = 0.5 * (before + self.speed)
        return middle, middle * dt


def grade_of(pitch: float) -> float:
    """Rise of the ground ahead [m/m] under a machine that is nose down by `pitch` [rad]."""
    return -sin(pitch) / cos(pitch)


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


def wheels_of(t: int, speed: float, force: float, load: float, traction: Traction) -> WheelState:
    """The driven wheels. force: of all of them, load: on them [N]."""
    slip = traction.slip_of(force / max(load, 1.0), traction.friction)
    return WheelState(t, speed * (1.0 + slip), slip, force, load)
