"""Motion level `single_track`: side slip, tyre lag and side slopes.

One tyre per axle; lateral speed of the centre of gravity and yaw rate as in the textbooks; forward speed from
the drive's closed loop. Equations, signs and validation: docs/motion.md.
"""

from dataclasses import dataclass
from math import ceil, cos, hypot, sin
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, Outputs, Port, State
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.signals import EngineState, MachineLoad, MachineState, SpeedCommand, SteerState
from swath.core.units import KMH, MS
from swath.field.site import SiteSetup
from swath.machine.attitude import Stance, TerrainFollower
from swath.machine.card import Dynamics, MachineCard, dynamics_of, with_grain
from swath.machine.loops import SpeedLoop, within_drive
from swath.machine.tyre import GRAVITY, brush, creep_damping, slide_slip

ROLLING_SPEED = 0.1  # rolling resistance grows to its full value up to this speed [m/s]
GRAIN_STEP = 1.0  # the mass follows the tank in steps of this [kg]
LEAST_LOAD = 0.02  # an axle keeps this share of the weight: the model does not tip over
KEYS = ("x", "y", "yaw", "side", "turn", "front_slip", "rear_slip", "distance")
Vector = tuple[float, ...]


@dataclass(frozen=True)
class Params:
    """What is left out comes from the machine's card.

    stiffness_per_rad: cornering stiffness over load; friction: largest side force over load;
    rolling_resistance: over load; start_speed_kmh: speed at t = 0; substep_ms: longest integration step
    """

    stiffness_per_rad: Annotated[float, Ge(0.5), Le(20)] | None = None
    friction: Annotated[float, Ge(0.05), Le(1.5)] | None = None
    rolling_resistance: Annotated[float, Ge(0), Le(0.3)] | None = None
    start_speed_kmh: Annotated[float, Ge(0), Le(40)] = 0.0
    substep_ms: Annotated[float, Gt(0), Le(20)] = 5.0


@dataclass(frozen=True)
class Moment:
    """What is held over an integration step.

    steer_cos, steer_sin: of the steering angle; front_load, rear_load [N]; front_pull, rear_pull: gravity
    along the ground to the left [N]
    """

    steer_cos: float
    steer_sin: float
    front_load: float
    rear_load: float
    front_pull: float
    rear_pull: float


class SingleTrack:
    """Rear-steered single-track model on terrain. Steering angle and slopes are held over a step."""

    inputs = (
        Port("steering", SteerState),
        Port("speed", SpeedCommand),
        Port("drive", EngineState, optional=True),
        Port("load", MachineLoad, optional=True),
    )
    outputs = (Port("state", MachineState),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        d = dynamics_of(setup.machine)
        self._params, self._start = params, setup.start
        self._wheelbase, self._track = setup.machine.wheelbase, setup.machine.front_track
        self._machine, self._grain = setup.machine, 0.0
        self._weigh(d)
        self._stiffness = _either(params.stiffness_per_rad, d.stiffness)
        self._friction = _either(params.friction, d.friction)
        self._rolling = _either(params.rolling_resistance, d.rolling_resistance)
        self._slip_max = slide_slip(self._stiffness, self._friction)
        self._follower = TerrainFollower(setup.field, setup.machine)
        self._loop = SpeedLoop(d)

    def reset(self, stream: Stream) -> Outputs:
        """Stand (or roll straight) at the start pose, tyres without slip."""
        self._fill(0.0)
        x, y = float(self._start.position[0]), float(self._start.position[1])
        self._q: Vector = (x, y, self._start.euler()[2], 0.0, 0.0, 0.0, 0.0, 0.0)
        self._speed = self._params.start_speed_kmh * KMH
        self._stance = self._follower.at(*self._q[:3])
        return self._output(0, 0.0)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Integrate over dt in equal substeps."""
        self._carry(inputs.get("load"))
        steer: float = inputs["steering"].angle
        wanted = within_drive(inputs["speed"].speed, inputs.get("drive"))
        count = max(1, ceil(dt / NS / (self._params.substep_ms * MS) - 1e-9))
        h = dt / NS / count
        for _ in range(count):
            middle, _ = self._loop.advance(self._speed, wanted, 0.5 * h)
            end, _ = self._loop.advance(self._speed, wanted, h)
            moment = self._moment(steer, (end - self._speed) / h)
            self._q = self._advance(self._q, h, (self._speed, middle, end), moment)
            self._speed = end
        self._stance = self._follower.at(*self._q[:3])
        return self._output(t + dt, steer)

    def save(self) -> State:
        """Place, heading, lateral speed of the centre of gravity, yaw rate, slips, distance, speed, grain."""
        return {**dict(zip(KEYS, self._q, strict=True)), "speed": self._speed, "grain": self._grain}

    def load(self, state: State) -> None:
        """Back to a saved moment."""
        self._q = tuple(state[k] for k in KEYS)
        self._speed = state["speed"]
        self._fill(state["grain"])
        self._stance = self._follower.at(*self._q[:3])

    def _weigh(self, d: Dynamics) -> None:
        """Take over mass, inertia and centre of gravity."""
        self._d, self._ahead, self._behind = d, d.cg_behind, self._wheelbase - d.cg_behind

    def _carry(self, load: MachineLoad | None) -> None:
        """Follow the tank in steps of GRAIN_STEP; the speed of the fixed axle and the turn rate go on."""
        if load is None:
            return
        grain = max(load.tank_content, 0.0)
        if abs(grain - self._grain) >= GRAIN_STEP:
            before = self._ahead
            self._fill(grain)
            q = list(self._q)
            q[3] += (before - self._ahead) * q[4]
            self._q = tuple(q)

    def _fill(self, grain: float) -> None:
        """Grain [kg] in the tank, for a card that has one."""
        machine = self._machine
        if grain != self._grain and isinstance(machine, MachineCard) and machine.masses is not None:
            self._weigh(dynamics_of(with_grain(machine, grain) if grain > 0.0 else machine))
        self._grain = grain

    def _output(self, t: int, steer: float) -> Outputs:
        x, y, yaw, side, turn, _, _, distance = self._q
        pose = self._stance.pose(x, y, yaw)
        lateral = side + self._ahead * turn
        return {"state": MachineState(t, pose, self._speed, lateral, turn, steer, distance)}

    def _moment(self, steer: float, accel: float) -> Moment:
        front, rear = self._loads(self._stance, accel)
        weight = self._d.mass * GRAVITY * cos(self._stance.pitch) ** 2 * cos(self._stance.roll)
        front_pull = -weight * self._behind / self._wheelbase * self._stance.front_slope
        rear_pull = -weight * self._ahead / self._wheelbase * self._stance.rear_slope
        return Moment(cos(steer), sin(steer), front, rear, front_pull, rear_pull)

    def _loads(self, stance: Stance, accel: float) -> tuple[float, float]:
        """Loads of the front and the rear axle [N], by moments about the contact points.

        Rolling resistance is a load that acts ahead of the wheel's centre by rolling_resistance * radius.
        """
        d, weight = self._d, self._d.mass * GRAVITY
        normal = weight * cos(stance.pitch) * cos(stance.roll)
        lead = self._rolling * _soft_sign(self._speed)
        front_lead, rear_lead = lead * d.front.radius, lead * d.rear.radius
        tilt = d.cg_height * (d.mass * accel - weight * sin(stance.pitch))
        rear = (normal * (self._ahead + front_lead) + tilt) / (self._wheelbase + front_lead - rear_lead)
        least = LEAST_LOAD * normal
        rear = min(max(rear, least), normal - least)
        return normal - rear, rear

    def _rates(self, q: Vector, u: float, m: Moment) -> Vector:
        """Time derivative of the state at forward speed u [m/s]."""
        d, n, mu = self._d, self._stiffness, self._friction
        _, _, yaw, side, turn, front_slip, rear_slip, _ = q
        front_side, rear_side = side + self._ahead * turn, side - self._behind * turn
        rear_along = u * m.steer_cos - rear_side * m.steer_sin
        rear_across = u * m.steer_sin + rear_side * m.steer_cos
        front = brush(front_slip, n, mu) + creep_damping(u, n, d.front.relaxation) * front_side
        rear = brush(rear_slip, n, mu) + creep_damping(rear_along, n, d.rear.relaxation) * rear_across
        drag = self._rolling * _soft_sign(rear_along) * m.rear_load
        front_force = -m.front_load * front
        rear_force = -m.rear_load * rear * m.steer_cos + drag * m.steer_sin
        roll_moment = self._d.cg_height * (front_force + rear_force)
        lifted = 0.5 * m.front_load * self._track
        outer_drag = self._rolling * _soft_sign(u) * min(max(roll_moment, -lifted), lifted)
        force = front_force + rear_force + m.front_pull + m.rear_pull
        torque = self._ahead * (front_force + m.front_pull) - self._behind * (rear_force + m.rear_pull)
        c, s = cos(yaw), sin(yaw)
        return (
            u * c - front_side * s,
            u * s + front_side * c,
            turn,
            force / d.mass - u * turn,
            (torque - outer_drag) / d.yaw_inertia,
            (front_side - abs(u) * front_slip) / d.front.relaxation,
            (rear_across - abs(rear_along) * rear_slip) / d.rear.relaxation,
            hypot(u, front_side),
        )

    def _advance(self, q: Vector, h: float, speeds: tuple[float, float, float], m: Moment) -> Vector:
        """One classical Runge-Kutta step of order 4; the slips end at full sliding."""
        k1 = self._rates(q, speeds[0], m)
        k2 = self._rates(_shift(q, k1, 0.5 * h), speeds[1], m)
        k3 = self._rates(_shift(q, k2, 0.5 * h), speeds[1], m)
        k4 = self._rates(_shift(q, k3, h), speeds[2], m)
        stages = zip(q, k1, k2, k3, k4, strict=True)
        new = [v + h / 6.0 * (a + 2.0 * (b + c) + e) for v, a, b, c, e in stages]
        limit = self._slip_max
        new[5], new[6] = min(max(new[5], -limit), limit), min(max(new[6], -limit), limit)
        return tuple(new)


def _shift(q: Vector, rate: Vector, h: float) -> Vector:
    return tuple([v + h * r for v, r in zip(q, rate, strict=True)])


def _soft_sign(speed: float) -> float:
    return min(max(speed / ROLLING_SPEED, -1.0), 1.0)


def _either(given: float | None, card: float) -> float:
    return card if given is None else given


LEVEL = Level(
    SingleTrack,
    Params,
    summary="side slip, tyre relaxation, rolling resistance, side slopes, on the terrain",
    cost="about 70 us per 5 ms step",
    tolerance="against multibody up to 2.5 m/s: yaw gain within 0.2 %, way aside after 30 deg within 1.6 %",
)
