"""Motion level `articulated`: a tractor and its trailer as two bodies on slipping tyres, joined at the pin.

The tractor is the single track of `single_track`; the trailer has one axle with the same tyre. Its load grows
while grain falls in: mass, yaw inertia, centre of gravity, axle and drawbar loads.
Equations: docs/explanation/machine.md.
"""

from dataclasses import dataclass
from math import ceil, cos, hypot, sin
from typing import Annotated

from annotated_types import Ge, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Checked, Level
from swath.core.schedule import NS
from swath.core.units import KMH, MS
from swath.field.site_setup import SiteSetup
from swath.machine.attitude import TerrainFollower
from swath.machine.loops import within_drive
from swath.machine.machine_sheet import dynamics_of
from swath.machine.motion import FIRM, TESTS
from swath.machine.towing import DRIVEN, ports_of, refuse_reverse, towed_by
from swath.machine.traction import DrivenWheels, traction_of
from swath.machine.tyre import GRAVITY, ROLLING_SPEED, axle_stiffness, creep_damping
from swath.signals import HeapState, MachineState

State = tuple[float, ...]  # x, y, yaw, lateral speed, yaw rate, trailer yaw, its rate, three slips


@dataclass(frozen=True)
class Params:
    """A tractor with a trailer.

    start_speed_kmh: speed at t = 0
    substep_ms: longest integration step
    """

    start_speed_kmh: Annotated[float, Ge(0), Le(40)] = 0.0
    substep_ms: Annotated[float, Ge(0.01), Le(20)] = 10.0


@dataclass(frozen=True)
class _Moment:
    """What is held over a step: speed and its rate, steering angle to the left, loads of the three axles [N],
    side pull of slopes on the two bodies [N], mass, yaw inertia and centre of gravity of the trailer.
    """

    speed: float
    rate: float
    steer: float
    front: float
    rear: float
    axle: float
    pin: float
    pull: float
    trailer_pull: float
    mass: float
    inertia: float
    behind: float  # centre of gravity behind the pin


class Articulated(KeepsState):
    """Tractor and trailer. Lateral speed and yaw rate are those of the tractor's centre of gravity."""

    kept = ("_q", "_wheels", "_distance", "_towed", "_drawbar_pull")
    inputs = (*DRIVEN, Port("cargo", HeapState, optional=True))

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        towed = towed_by(setup)
        if towed is None or not setup.machine.steers_ahead:
            expected = "expected a tractor with a trailer; a machine without one drives with `single_track`"
            raise InputError("level", "articulated", expected)
        self._params, self._start, self._towed = params, setup.start, towed
        self._d, self._machine = dynamics_of(setup.machine), setup.machine
        self._follower = TerrainFollower(setup.field, setup.machine)
        self._wheels = DrivenWheels(self._d)
        self._cg = self._d.cg_behind  # ahead of the fixed axle: the steered one is ahead
        self._stiffness = axle_stiffness(self._d.stiffness, self._d.understeer, steers_ahead=True)
        self._to_pin = self._cg - towed.sheet.hitch_x
        self.outputs = ports_of(towed)

    def reset(self, stream: Stream) -> Outputs:
        """Straight, at the start pose."""
        x, y = float(self._start.position[0]), float(self._start.position[1])
        yaw = self._start.euler()[2]
        self._q: State = (x, y, yaw, 0.0, 0.0, yaw, 0.0, 0.0, 0.0, 0.0)
        self._wheels.reset(self._params.start_speed_kmh * KMH)
        self._distance = 0.0
        self._drawbar_pull = 0.0
        self._towed.place(x, y, yaw)
        self._follower.at(x, y, yaw)
        return self._output(0, 0.0)

    def load(self, state: dict[str, object]) -> None:
        """Take on a state that `save` gave."""
        super().load(state)
        self._follower.at(*self._q[:3])

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Integrate over dt in equal substeps."""
        wanted = within_drive(inputs["speed"].speed, inputs.get("drive"))
        refuse_reverse(wanted)
        self._towed.carry(inputs.get("cargo"))
        steer: float = inputs["steering"].angle
        count = max(1, ceil(dt / NS / (self._params.substep_ms * MS) - 1e-9))
        h = dt / NS / count
        traction = traction_of(self._machine, towed=self._towed.mass)
        for _ in range(count):
            before = self._wheels.speed
            _, travel = self._wheels.advance(wanted, h, self._follower.stance.pitch, traction)
            self._advance(self._moment(steer, (self._wheels.speed - before) / h, travel / h), h)
            self._follower.at(*self._q[:3])
        return self._output(t + dt, steer)

    def _advance(self, m: _Moment, h: float) -> None:
        """Take one classical Runge-Kutta step of order 4."""
        q = self._q
        k1, _ = self._rates(q, m)
        k2, _ = self._rates(_moved(q, k1, 0.5 * h), m)
        k3, _ = self._rates(_moved(q, k2, 0.5 * h), m)
        k4, self._drawbar_pull = self._rates(_moved(q, k3, h), m)
        slope = tuple((a + 2.0 * b + 2.0 * c + d) / 6.0 for a, b, c, d in zip(k1, k2, k3, k4, strict=True))
        self._q = _moved(q, slope, h)
        side = self._q[3] - self._cg * self._q[4]
        self._distance += h * hypot(m.speed, side)
        self._towed.yaw = self._q[5]

    def _moment(self, steer: float, rate: float, speed: float) -> _Moment:
        """Loads by moments about the contact points. rate: of the speed [m/s2]."""
        d, w, stance = self._d, self._towed, self._follower.stance
        long, cg = w.sheet.drawbar, w.cg_ahead
        own = w.sheet.empty * ((w.sheet.length**2 + w.sheet.width**2) / 12.0)
        box = self._machine.box
        cargo = 0.0 if box is None else w.grain * (box.length**2 + box.width**2) / 12.0
        apart = w.sheet.empty * (w.sheet.cg_ahead - cg) ** 2 + w.grain * (w.grain_x - cg) ** 2
        pin = w.mass * GRAVITY * cg / long
        base, weight = self._machine.wheelbase, d.mass * GRAVITY
        tilt = d.cg_height * (d.mass * rate - weight * sin(stance.pitch))
        front = max((weight * self._cg - tilt + pin * w.sheet.hitch_x) / base, 0.02 * weight)
        return _Moment(
            speed, rate, steer, front, weight + pin - front, w.mass * GRAVITY - pin, pin,
            -weight * cos(stance.pitch) * stance.front_slope, -w.mass * GRAVITY * stance.front_slope,
            w.mass, own + cargo + apart, long - cg,
        )  # fmt: skip

    def _rates(self, q: State, m: _Moment) -> tuple[State, float]:
        """Time derivative of the state, and the pull along the drawbar [N]."""
        _, _, yaw, side, turn, trailer_yaw, swing, front_slip, rear_slip, axle_slip = q
        d, s, u = self._d, self._towed.sheet, m.speed
        ahead, e, c = self._machine.wheelbase - self._cg, self._to_pin, m.behind
        cs, ss = cos(m.steer), sin(m.steer)
        front_side, rear_side = side + ahead * turn, side - self._cg * turn
        along, across = u * cs + front_side * ss, front_side * cs - u * ss
        angle = trailer_yaw - yaw
        ca, sa = cos(angle), sin(angle)
        pin_side = side - e * turn
        axle_along, axle_side = u * ca + pin_side * sa, pin_side * ca - u * sa - s.drawbar * swing
        front = -m.front * self._tyre(front_slip, along, across, d.rear.relaxation, self._stiffness[1])
        rear = -m.rear * self._tyre(rear_slip, u, rear_side, d.front.relaxation, self._stiffness[0])
        axle = -m.axle * self._tyre(axle_slip, axle_along, axle_side, s.relaxation, s.stiffness)
        drag = d.rolling_resistance * min(max(u / ROLLING_SPEED, -1.0), 1.0)
        front_across = front * cs - drag * m.front * ss
        # accelerations of the pin are linear in those of the tractor: ax, ay = known + rates of side and turn
        px = m.rate - side * turn + e * turn * turn
        py = u * turn
        # trailer along its drawbar: pull = mass (px ca + (py + side' - e turn') sa + c swing^2) + drag
        # across: hitch = mass (-px sa + (py + side' - e turn') ca - c swing') - axle - slope
        far = s.drawbar - c
        load, inertia = m.mass, m.inertia
        # swing' = (c hitch - far axle) / inertia, so hitch = reduced (bracket) + rest
        reduced = load / (1.0 + load * c * c / inertia)
        rest = (load * c * far * axle / inertia - axle - m.trailer_pull) / (1.0 + load * c * c / inertia)
        known_along = load * (px * ca + py * sa + c * swing * swing) + drag * m.axle
        known_across = reduced * (-px * sa + py * ca) + rest
        # side force of the pin on the tractor: -(pull sa + hitch ca) = -(known + heavy (side' - e turn'))
        known = known_along * sa + known_across * ca
        heavy = load * sa * sa + reduced * ca * ca
        force = front_across + rear + m.pull - known - d.mass * u * turn
        torque = ahead * front_across - self._cg * rear + e * known
        a11, a12 = d.mass + heavy, -heavy * e
        a22 = d.yaw_inertia + heavy * e * e
        det = a11 * a22 - a12 * a12
        side_rate = (force * a22 - a12 * torque) / det
        turn_rate = (a11 * torque - a12 * force) / det
        extra = side_rate - e * turn_rate
        hitch = known_across + reduced * ca * extra
        pull = known_along + load * sa * extra
        rates = (
            u * cos(yaw) - rear_side * sin(yaw),
            u * sin(yaw) + rear_side * cos(yaw),
            turn,
            side_rate,
            turn_rate,
            swing,
            (c * hitch - far * axle) / inertia,
            (across - abs(along) * front_slip) / d.rear.relaxation,
            (rear_side - abs(u) * rear_slip) / d.front.relaxation,
            (axle_side - abs(axle_along) * axle_slip) / s.relaxation,
        )
        return rates, pull

    def _tyre(self, slip: float, along: float, across: float, relaxation: float, stiffness: float) -> float:
        """Side force over load against the slip: the brush of tyre.py, damped at a crawl."""
        friction = self._d.friction
        x = min(stiffness * abs(slip) / (3.0 * friction), 1.0)
        force = friction * x * (3.0 - x * (3.0 - x))
        damped = creep_damping(along, stiffness, relaxation) * across
        return (force if slip >= 0.0 else -force) + damped

    def _output(self, t: int, steer: float) -> Outputs:
        _, _, yaw, side, turn, *_ = self._q
        pose = self._follower.pose()
        state = MachineState(t, pose, self._wheels.speed, side - self._cg * turn, turn, steer, self._distance)
        w = self._towed
        pin = w.mass * GRAVITY * w.cg_ahead / w.sheet.drawbar
        loads = w.mass * GRAVITY - pin, pin, self._drawbar_pull
        return {"state": state, "trailer": w.state(t, pose, yaw, loads)}


def _moved(q: State, rates: State, h: float) -> State:
    return tuple(a + h * b for a, b in zip(q, rates, strict=True))


LEVEL = Level(
    Articulated,
    Params,
    summary="tractor and trailer on slipping tyres, joined at the pin; the load grows while it fills",
    cost="about 90 us per step",
    tolerance="trailer within 5 cm of kinematic in a slow turn of 15 m",
    checked=(
        Checked("ground_speed_kmh", 0.0, 11.5, TESTS, "sibling"),
        Checked("slope_along_percent", -18.0, 18.0, TESTS, "closed form"),
        FIRM,
    ),
)
