"""The equations of `single_track`, compiled: one classical Runge-Kutta step of order 4.

Derived in docs/explanation/machine.md.
"""

from math import pi

import warp as wp

from swath.machine import tyre
from swath.machine.attitude_kernel import Track
from swath.machine.drive_kernel import GRAVITY, HALF, LEAST_LOAD, ONE, THREE, soft_sign

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
real = wp.float64
CREEP_SPEED = wp.constant(real(tyre.CREEP_SPEED))
CREEP_DAMPING = wp.constant(real(tyre.CREEP_DAMPING))
PI = wp.constant(real(pi))
TWO, SIX = wp.constant(real(2.0)), wp.constant(real(6.0))


@wp.struct
class Car:
    """What stays. ahead, behind: of the centre of gravity to the fixed axle (front) and of the steered one
    (rear) to it [m], both below 0 where the steered axle is ahead; sense: of the steering, 1 or -1;
    longest: substep [s]; SI.
    """

    ahead: wp.float64
    behind: wp.float64
    mass: wp.float64
    inertia: wp.float64
    cg_height: wp.float64
    track: wp.float64
    front_radius: wp.float64
    rear_radius: wp.float64
    front_relaxation: wp.float64
    rear_relaxation: wp.float64
    front_stiffness: wp.float64
    rear_stiffness: wp.float64
    friction: wp.float64
    rolling: wp.float64
    sense: wp.float64
    longest: wp.float64


@wp.struct
class Drive:
    """Length of the step [s]; forward speed at its start, middle and end [m/s]; angle of the steered
    wheel to the right [rad]; how the machine stands, as `attitude.Stance`.
    """

    h: wp.float64
    start: wp.float64
    middle: wp.float64
    end: wp.float64
    steer: wp.float64
    roll: wp.float64
    pitch: wp.float64
    front_slope: wp.float64
    rear_slope: wp.float64


@wp.struct
class Moment:
    """What is held over a step: cosine and sine of the steering angle, loads of the axles [N], gravity along
    the ground to the left at them [N].
    """

    steer_cos: wp.float64
    steer_sin: wp.float64
    front_load: wp.float64
    rear_load: wp.float64
    front_pull: wp.float64
    rear_pull: wp.float64


@wp.func
def held(car: Car, d: Drive) -> Moment:
    """Loads by moments about the contact points: rolling resistance is a load that acts ahead of the wheel's
    centre by rolling * radius.
    """
    weight = car.mass * GRAVITY
    normal = weight * wp.cos(d.pitch) * wp.cos(d.roll)
    shift = car.rolling * soft_sign(d.start)
    tilt = car.cg_height * (car.mass * ((d.end - d.start) / d.h) - weight * wp.sin(d.pitch))
    wheelbase = car.ahead + car.behind
    rear = normal * (car.ahead + shift * car.front_radius) + tilt
    rear = rear / (wheelbase + shift * car.front_radius - shift * car.rear_radius)
    pull = -normal * wp.cos(d.pitch) / wheelbase
    m = Moment()
    m.steer_cos = wp.cos(d.steer)
    m.steer_sin = wp.sin(d.steer)
    m.rear_load = wp.clamp(rear, LEAST_LOAD * normal, (ONE - LEAST_LOAD) * normal)
    m.front_load = normal - m.rear_load
    m.front_pull = pull * car.behind * d.front_slope
    m.rear_pull = pull * car.ahead * d.rear_slope
    return m


@wp.func
def side_force(
    slip: wp.float64,
    along: wp.float64,
    across: wp.float64,
    relaxation: wp.float64,
    stiffness: wp.float64,
    friction: wp.float64,
) -> wp.float64:
    """Side force over load against the slip: the brush of tyre.py, and at a crawl `tyre.creep_damping`."""
    x = wp.min(stiffness * wp.abs(slip) / (THREE * friction), ONE)
    force = wp.sign(slip) * friction * x * (THREE - x * (THREE - x))
    if wp.abs(along) < CREEP_SPEED:
        at_rest = TWO * CREEP_DAMPING * wp.sqrt(stiffness / (relaxation * GRAVITY))
        force += at_rest * HALF * (ONE + wp.cos(PI * along / CREEP_SPEED)) * across
    return force


@wp.func
def rates(q: Track, u: wp.float64, car: Car, m: Moment) -> Track:
    """Time derivative of the state at forward speed u [m/s]."""
    front_side = q.side + car.ahead * q.turn
    rear_side = q.side - car.behind * q.turn
    rear_along = u * m.steer_cos - rear_side * m.steer_sin
    rear_across = u * m.steer_sin + rear_side * m.steer_cos
    front = side_force(q.front_slip, u, front_side, car.front_relaxation, car.front_stiffness, car.friction)
    rear = side_force(
        q.rear_slip, rear_along, rear_across, car.rear_relaxation, car.rear_stiffness, car.friction
    )
    drag = car.rolling * soft_sign(rear_along) * m.rear_load
    front_force = -m.front_load * front
    rear_force = drag * m.steer_sin - m.rear_load * rear * m.steer_cos
    lifted = HALF * m.front_load * car.track
    roll_moment = wp.clamp(car.cg_height * (front_force + rear_force), -lifted, lifted)
    torque = car.ahead * (front_force + m.front_pull) - car.behind * (rear_force + m.rear_pull)
    c = wp.cos(q.yaw)
    s = wp.sin(q.yaw)
    d = Track()
    d.x = u * c - front_side * s
    d.y = u * s + front_side * c
    d.yaw = q.turn
    d.side = (front_force + rear_force + m.front_pull + m.rear_pull) / car.mass - u * q.turn
    d.turn = (torque - car.rolling * soft_sign(u) * roll_moment) / car.inertia
    d.front_slip = (front_side - wp.abs(u) * q.front_slip) / car.front_relaxation
    d.rear_slip = (rear_across - wp.abs(rear_along) * q.rear_slip) / car.rear_relaxation
    d.distance = wp.sqrt(u * u + front_side * front_side)
    return d


@wp.func
def moved(q: Track, d: Track, h: wp.float64) -> Track:
    """The state after h [s] at steady rates."""
    n = Track()
    n.x = q.x + h * d.x
    n.y = q.y + h * d.y
    n.yaw = q.yaw + h * d.yaw
    n.side = q.side + h * d.side
    n.turn = q.turn + h * d.turn
    n.front_slip = q.front_slip + h * d.front_slip
    n.rear_slip = q.rear_slip + h * d.rear_slip
    n.distance = q.distance + h * d.distance
    return n


@wp.func
def integrated(q: Track, d: Drive, car: Car, m: Moment) -> Track:
    """The state after one step; the slips end at full sliding."""
    k1 = rates(q, d.start, car, m)
    k2 = rates(moved(q, k1, HALF * d.h), d.middle, car, m)
    k3 = rates(moved(q, k2, HALF * d.h), d.middle, car, m)
    k4 = rates(moved(q, k3, d.h), d.end, car, m)
    q = moved(moved(moved(moved(q, k1, d.h / SIX), k2, d.h / THREE), k3, d.h / THREE), k4, d.h / SIX)
    most = THREE * car.friction / car.front_stiffness
    q.front_slip = wp.clamp(q.front_slip, -most, most)
    most = THREE * car.friction / car.rear_stiffness
    q.rear_slip = wp.clamp(q.rear_slip, -most, most)
    return q
