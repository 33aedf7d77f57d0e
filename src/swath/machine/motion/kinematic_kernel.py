"""The level `kinematic` as kernels over worlds: each machine drives its arc, then stands on the ground."""

from pathlib import Path

import warp as wp

from swath.kernels import exact_code
from swath.machine.motion.single_track_kernel import HALF, ONE, Car, Track
from swath.machine.motion.single_track_step_kernel import (
    Ground,
    Loop,
    Stand,
    driven,
    expm1,
    given,
    slipped,
    stood,
    tell,
    turned,
)

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
real = wp.float64
_HERE = Path(__file__).parent


@wp.func_native(exact_code(_HERE / "length_of_two.cpp"))
def length_of(x: wp.float64, y: wp.float64) -> wp.float64: ...


@wp.struct
class Vehicle:
    """What stays. along, across: the wheels as `traction.Traction` has them, in `Car`; wheelbase [m], below 0
    where the steered axle is ahead; rear_share: of the slope under the rear axle.
    """

    along: Car
    across: Car
    loop: Loop
    wheelbase: wp.float64
    rear_share: wp.float64


@wp.func
def way_of(speed: wp.float64, wanted: wp.float64, dt: wp.float64, loop: Loop) -> wp.float64:
    """The distance of `loops.SpeedLoop.advance`."""
    target = wp.clamp(wanted, -loop.fastest, loop.fastest)
    limit = loop.decel
    if wp.abs(target) > wp.abs(speed) and target * speed >= real(0.0):
        limit = loop.accel
    error = target - speed
    if error == real(0.0):
        return speed * dt
    ramp = wp.abs(error) / limit - loop.lag
    reached = speed
    area = real(0.0)
    if ramp > real(0.0):
        ramp = wp.min(dt, ramp)
        slope = wp.copysign(limit, error)
        reached = speed + slope * ramp
        area = (speed + HALF * slope * ramp) * ramp
    else:
        ramp = real(0.0)
    rest = dt - ramp
    if rest > real(0.0):
        gap = target - reached
        gone = -gap * expm1(-rest / loop.lag)
        area += target * rest - loop.lag * gone
    return area


@wp.kernel
def drive_arcs(
    vehicles: wp.array(dtype=Vehicle),
    steering: wp.array(dtype=wp.float64),
    speeds: wp.array(dtype=wp.float64),
    limits: wp.array(dtype=wp.float64),
    clock: wp.array(dtype=wp.int64),
    needs: wp.array(dtype=int),
    tracks: wp.array(dtype=Track),
    stands: wp.array(dtype=Stand),
    steered: wp.array(dtype=wp.float64),
):
    """steering: angle of the steered axle [rad], and `steered` what it was; speeds: wanted [m/s].

    limits: what the
    drive can [m/s]; clock: begin, end, length of the step [ns]; needs: 1 where a speed is no number

    `side` of a track is the drift.
    """
    w = wp.tid()
    v = vehicles[w]
    q = tracks[w]
    a = stands[w]
    steer = steering[w]
    wanted = speeds[w]
    if not wp.isfinite(wanted):
        needs[0] = 1
    if wp.isfinite(limits[w]):
        wanted = wp.min(wp.max(wanted, -limits[w]), limits[w])
    dt = real(clock[2]) / real(1.0e9)
    grade = -wp.sin(a.pitch) / wp.cos(a.pitch)
    before = a.speed
    slip = slipped(a.slip, grade, grade, wp.abs(before) * dt, v.along)
    rim = driven(a.rim, wanted, dt, v.loop)
    way = way_of(a.rim, wanted, dt, v.loop)
    mean = ONE + HALF * (a.slip + slip)
    free = rim / (ONE + slip)
    speed = given(before, free, grade, grade, dt, v.along)
    travel = way / mean
    if speed != free:
        rim = speed * (ONE + slip)
        travel = HALF * (before + speed) * dt
    slope = a.front_slope + v.rear_share * (a.rear_slope - a.front_slope)
    drift = slipped(q.side, -slope, -slope, wp.abs(travel), v.across)
    turn = travel * wp.tan(steer) / v.wheelbase
    half = HALF * turn
    chord = travel
    if wp.abs(half) > real(1.0e-8):
        chord = travel * (wp.sin(half) / half)
    aside = HALF * chord * (q.side + drift)
    c = wp.cos(q.yaw + half)
    s = wp.sin(q.yaw + half)
    q.x += chord * c - aside * s
    q.y += chord * s + aside * c
    q.yaw += turn
    q.distance += length_of(travel, aside)
    q.side = drift
    a.speed = speed
    a.rim = rim
    a.slip = slip
    tracks[w] = q
    stands[w] = a
    steered[w] = steer


@wp.kernel
def stand_on(
    grounds: wp.array(dtype=Ground),
    vehicles: wp.array(dtype=Vehicle),
    tracks: wp.array(dtype=Track),
    stands: wp.array(dtype=Stand),
    steered: wp.array(dtype=wp.float64),
    states: wp.array2d(dtype=wp.float64),
    needs: wp.array(dtype=int),
):
    """states: pose (12), speed, lateral speed, yaw rate, angle of the steered axle, distance. is_done of a
    stand is 0, and `needs` 1, where the ground under a machine is not in memory: then nothing else has
    changed.
    """
    w = wp.tid()
    v = vehicles[w]
    q = tracks[w]
    old = stands[w]
    g = grounds[w]
    a = stood(g.nodes, g.first, g.points, g.span[0], q, v.loop)
    if a.is_done == ONE:
        a = turned(a, q, v.along)
        a.is_done = ONE
        a.speed = old.speed
        a.rim = old.rim
        a.slip = old.slip
        stands[w] = a
        a.lateral = a.speed * q.side
        a.turn = a.speed * wp.tan(steered[w]) / v.wheelbase
        tell(states, w, a, steered[w])
    else:
        old.is_done = real(0.0)
        stands[w] = old
        needs[0] = 1
