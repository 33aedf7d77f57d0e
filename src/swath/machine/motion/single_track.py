"""Motion level `single_track`: side slip, tyre lag and side slopes.

One tyre per axle; lateral speed of the centre of gravity and yaw rate as in the textbooks; forward speed from
the drive's closed loop. Equations, signs and validation: docs/motion.md.
"""

from dataclasses import dataclass
from math import ceil, cos, hypot, sin
from typing import Annotated, NamedTuple

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, Outputs, Port, State
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.signals import EngineState, MachineLoad, MachineState, SpeedCommand, SteerState
from swath.core.units import KMH, MS
from swath.field.site import SiteSetup
from swath.machine.attitude import Stance, TerrainFollower
from swath.machine.card import Dynamics, MachineCard, dynamics_of, loaded
from swath.machine.loops import SpeedLoop, within_drive
from swath.machine.tyre import CREEP_SPEED, GRAVITY, creep_damping, slide_slip

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
    substep_ms: Annotated[float, Gt(0), Le(20)] = 20.0


class Moment(NamedTuple):
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
        sigmas = d.front.relaxation, d.rear.relaxation
        self._body = (self._ahead, self._behind, d.mass, d.yaw_inertia, d.cg_height, *sigmas)

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
            d = dynamics_of(machine)
            self._weigh(loaded(d, machine.masses.tank, grain) if grain > 0.0 else d)
        self._grain = grain

    def _output(self, t: int, steer: float) -> Outputs:
        x, y, yaw, side, turn, _, _, distance = self._q
        pose = self._stance.pose(x, y, yaw)
        lateral = side + self._ahead * turn
        return {"state": MachineState(t, pose, self._speed, lateral, turn, steer, distance)}

    def _moment(self, steer: float, accel: float) -> Moment:
        front, rear = self._loads(self._stance, accel)
        stance, weight = self._stance, self._d.mass * GRAVITY
        pull = -weight * cos(stance.pitch) ** 2 * cos(stance.roll) / self._wheelbase
        front_pull, rear_pull = (
            pull * self._behind * stance.front_slope,
            pull * self._ahead * stance.rear_slope,
        )
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

    def _rates(
        self, yaw: float, side: float, turn: float, front_slip: float, rear_slip: float, u: float, m: Moment
    ) -> Vector:
        """Time derivative of the state at forward speed u [m/s]. Written out: it runs often.

        The side forces are those of `tyre.brush`.
        """
        c_ahead, c_behind, mass, inertia, cg_height, front_sigma, rear_sigma = self._body
        steer_cos, steer_sin, front_load, rear_load, front_pull, rear_pull = m
        n, mu, rolling = self._stiffness, self._friction, self._rolling
        front_side, rear_side = side + c_ahead * turn, side - c_behind * turn
        rear_along = u * steer_cos - rear_side * steer_sin
        rear_across = u * steer_sin + rear_side * steer_cos
        speed, rear_speed = abs(u), abs(rear_along)
        x = n * abs(front_slip) / (3.0 * mu)
        front = mu if x >= 1.0 else mu * x * (3.0 - x * (3.0 - x))
        if front_slip < 0.0:
            front = -front
        x = n * abs(rear_slip) / (3.0 * mu)
        rear = mu if x >= 1.0 else mu * x * (3.0 - x * (3.0 - x))
        if rear_slip < 0.0:
            rear = -rear
        if speed < CREEP_SPEED:
            front += creep_damping(u, n, front_sigma) * front_side
        if rear_speed < CREEP_SPEED:
            rear += creep_damping(rear_along, n, rear_sigma) * rear_across
        front_force = -front_load * front
        rear_force = rolling * _soft_sign(rear_along) * rear_load * steer_sin - rear_load * rear * steer_cos
        lifted = 0.5 * front_load * self._track
        roll_moment = cg_height * (front_force + rear_force)
        if not -lifted <= roll_moment <= lifted:
            roll_moment = lifted if roll_moment > 0.0 else -lifted
        torque = c_ahead * (front_force + front_pull) - c_behind * (rear_force + rear_pull)
        c, s = cos(yaw), sin(yaw)
        return (
            u * c - front_side * s,
            u * s + front_side * c,
            turn,
            (front_force + rear_force + front_pull + rear_pull) / mass - u * turn,
            (torque - rolling * _soft_sign(u) * roll_moment) / inertia,
            (front_side - speed * front_slip) / front_sigma,
            (rear_across - rear_speed * rear_slip) / rear_sigma,
            hypot(u, front_side),
        )

    def _advance(self, q: Vector, h: float, speeds: tuple[float, float, float], m: Moment) -> Vector:
        """One classical Runge-Kutta step of order 4; the slips end at full sliding."""
        rates, start, middle, end = self._rates, *speeds
        x, y, yaw, w, r, f, b, way = q
        g, k = 0.5 * h, h / 6.0
        x1, y1, a1, w1, r1, f1, b1, v1 = rates(yaw, w, r, f, b, start, m)
        x2, y2, a2, w2, r2, f2, b2, v2 = rates(
            yaw + g * a1, w + g * w1, r + g * r1, f + g * f1, b + g * b1, middle, m
        )
        x3, y3, a3, w3, r3, f3, b3, v3 = rates(
            yaw + g * a2, w + g * w2, r + g * r2, f + g * f2, b + g * b2, middle, m
        )
        x4, y4, a4, w4, r4, f4, b4, v4 = rates(
            yaw + h * a3, w + h * w3, r + h * r3, f + h * f3, b + h * b3, end, m
        )
        limit = self._slip_max
        f += k * (f1 + 2.0 * (f2 + f3) + f4)
        b += k * (b1 + 2.0 * (b2 + b3) + b4)
        return (
            x + k * (x1 + 2.0 * (x2 + x3) + x4),
            y + k * (y1 + 2.0 * (y2 + y3) + y4),
            yaw + k * (a1 + 2.0 * (a2 + a3) + a4),
            w + k * (w1 + 2.0 * (w2 + w3) + w4),
            r + k * (r1 + 2.0 * (r2 + r3) + r4),
            f if -limit <= f <= limit else (limit if f > 0.0 else -limit),
            b if -limit <= b <= limit else (limit if b > 0.0 else -limit),
            way + k * (v1 + 2.0 * (v2 + v3) + v4),
        )


def _soft_sign(speed: float) -> float:
    if -ROLLING_SPEED < speed < ROLLING_SPEED:
        return speed / ROLLING_SPEED
    return 1.0 if speed > 0.0 else -1.0


def _either(given: float | None, card: float) -> float:
    return card if given is None else given


LEVEL = Level(
    SingleTrack,
    Params,
    summary="side slip, tyre relaxation, rolling resistance, side slopes, on the terrain",
    cost="about 20 us per step",
    tolerance="against multibody up to 2.5 m/s: yaw gain within 0.2 %, way aside after 30 deg within 1.6 %",
)
