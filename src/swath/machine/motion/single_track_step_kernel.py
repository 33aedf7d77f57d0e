"""A whole step of `single_track`, compiled: the loop of the drive, the tyres, the ground under them.

The same operations in the same order as `SingleTrack` does them in Python.
"""

import warp as wp

from swath.field.footprint_kernel import Place, Span, mean_height
from swath.machine.motion.single_track_kernel import (
    GRAVITY,
    HALF,
    LEAST_LOAD,
    ONE,
    THREE,
    Car,
    Drive,
    Moment,
    Track,
    held,
    integrated,
)

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
real = wp.float64


@wp.struct
class Loop:
    """The closed loop of the drive, as `machine_sheet.Dynamics`; wheelbase, tracks of the axles [m]: below 0
    where the steered axle is ahead, as in `attitude.TerrainFollower`; sense: of the steering, 1 or -1.
    """

    lag: wp.float64
    accel: wp.float64
    decel: wp.float64
    fastest: wp.float64
    wheelbase: wp.float64
    front_track: wp.float64
    rear_track: wp.float64
    sense: wp.float64


@wp.struct
class Asked:
    """What is held over a step: number and length [s] of its substeps, angle of the steered wheel [rad],
    wanted speed [m/s].
    """

    count: wp.float64
    h: wp.float64
    steer: wp.float64
    wanted: wp.float64


@wp.struct
class Stand:
    """Where the machine is after a step. is_done: 0 where the ground under it is not in memory or a number is
    not finite, nothing has changed then; speed over ground and of the rims [m/s], slip along; as
    `attitude.Stance`; rows of its rotation
    place [m], speed to the left [m/s], yaw rate [rad/s], distance [m]
    """

    is_done: wp.float64
    speed: wp.float64
    rim: wp.float64
    slip: wp.float64
    z: wp.float64
    roll: wp.float64
    pitch: wp.float64
    front_slope: wp.float64
    rear_slope: wp.float64
    xx: wp.float64
    xy: wp.float64
    xz: wp.float64
    yx: wp.float64
    yy: wp.float64
    yz: wp.float64
    zx: wp.float64
    zy: wp.float64
    zz: wp.float64
    x: wp.float64
    y: wp.float64
    lateral: wp.float64
    turn: wp.float64
    distance: wp.float64


@wp.func_native("return __builtin_expm1(x);")
def expm1(x: wp.float64) -> wp.float64: ...


@wp.func_native("return __builtin_cbrt(x);")
def cbrt(x: wp.float64) -> wp.float64: ...


@wp.func
def approached(
    value: wp.float64, target: wp.float64, dt: wp.float64, lag: wp.float64, limit: wp.float64
) -> wp.float64:
    """As `loops.approach`."""
    error = target - value
    if error == real(0.0):
        return value
    ramp = wp.abs(error) / limit - lag
    reached = value
    if ramp > real(0.0):
        ramp = wp.min(dt, ramp)
        reached = value + wp.copysign(limit, error) * ramp
    else:
        ramp = real(0.0)
    rest = dt - ramp
    if rest > real(0.0):
        reached += -(target - reached) * expm1(-rest / lag)
    return reached


@wp.func
def grip(grade: wp.float64, car: Car) -> wp.float64:
    """As `traction.Traction.grip`."""
    share = car.level_share - car.grade_share * grade
    return car.along_friction * wp.min(wp.max(share, LEAST_LOAD), ONE)


@wp.func
def given(before: wp.float64, after: wp.float64, grade: wp.float64, dt: wp.float64, car: Car) -> wp.float64:
    """As `traction.Traction.given`."""
    level = ONE / wp.sqrt(ONE + grade * grade)
    most = wp.min(grip(grade, car) * level, car.thrust)
    low = before + dt * (GRAVITY * (-most - grade * level))
    high = before + dt * (GRAVITY * (most - grade * level))
    return wp.min(wp.max(after, low), high)


@wp.func
def slipped(slip: wp.float64, grade: wp.float64, way: wp.float64, car: Car) -> wp.float64:
    """As `traction.Traction.slip_after`."""
    gone = -expm1(-way / car.along_relaxation)
    free = ONE - wp.abs(grade) / grip(grade, car)
    x = ONE
    if free > real(0.0):
        x = ONE - cbrt(free)
    steady = wp.copysign(THREE * car.along_friction / car.along_stiffness * x, grade)
    return slip + (steady - slip) * gone


@wp.func
def driven(speed: wp.float64, wanted: wp.float64, dt: wp.float64, loop: Loop) -> wp.float64:
    """As `loops.SpeedLoop.advance`."""
    target = wp.clamp(wanted, -loop.fastest, loop.fastest)
    limit = loop.decel
    if wp.abs(target) > wp.abs(speed) and target * speed >= real(0.0):
        limit = loop.accel
    return approached(speed, target, dt, loop.lag, limit)


@wp.func
def stood(
    nodes: wp.array2d(dtype=wp.float64),
    first: wp.array(dtype=int),
    points: wp.array2d(dtype=wp.float64),
    span: Span,
    q: Track,
    loop: Loop,
) -> Stand:
    """As `attitude.TerrainFollower.at`; is_done 0 where the ground there is not in `nodes`."""
    cy = wp.cos(q.yaw)
    sy = wp.sin(q.yaw)
    p = Place()
    p.u = (span.c * q.x + span.s * q.y) * span.per_m
    p.v = (span.c * q.y - span.s * q.x) * span.per_m
    p.c = span.c * cy + span.s * sy
    p.s = span.c * sy - span.s * cy
    a = Stand()
    is_inside = span.low_u <= p.u and p.u <= span.high_u and span.low_v <= p.v and p.v <= span.high_v
    if is_inside and wp.isfinite(q.yaw):  # neither is what is not a number
        a.is_done = ONE
        left = mean_height(nodes, first, points, p, 0, 4)
        right = mean_height(nodes, first, points, p, 1, 4)
        rear_left = mean_height(nodes, first, points, p, 2, 4)
        rear_right = mean_height(nodes, first, points, p, 3, 4)
        a.z = HALF * (left + right)
        fall = HALF * (rear_left + rear_right) - a.z
        a.pitch = wp.atan2(wp.copysign(ONE, loop.wheelbase) * fall, wp.abs(loop.wheelbase))
        a.front_slope = (left - right) / loop.front_track
        a.roll = wp.atan(a.front_slope * wp.cos(a.pitch))
        a.rear_slope = (rear_left - rear_right) / loop.rear_track
    return a


@wp.func
def turned(a: Stand, q: Track, car: Car) -> Stand:
    """With the rows of the rotation, as `frames.rotation_rows`, and what else a sample says."""
    cr = wp.cos(a.roll)
    sr = wp.sin(a.roll)
    cp = wp.cos(a.pitch)
    sp = wp.sin(a.pitch)
    cy = wp.cos(q.yaw)
    sy = wp.sin(q.yaw)
    a.xx = cy * cp
    a.xy = cy * sp * sr - sy * cr
    a.xz = cy * sp * cr + sy * sr
    a.yx = sy * cp
    a.yy = sy * sp * sr + cy * cr
    a.yz = sy * sp * cr - cy * sr
    a.zx = -sp
    a.zy = cp * sr
    a.zz = cp * cr
    a.x = q.x
    a.y = q.y
    a.lateral = q.side + car.ahead * q.turn
    a.turn = q.turn
    a.distance = q.distance
    return a


@wp.kernel
def drive(
    nodes: wp.array2d(dtype=wp.float64),
    first: wp.array(dtype=int),
    points: wp.array2d(dtype=wp.float64),
    spans: wp.array(dtype=Span),
    cars: wp.array(dtype=Car),
    loops: wp.array(dtype=Loop),
    asked: wp.array(dtype=Asked),
    moments: wp.array(dtype=Moment),
    tracks: wp.array(dtype=Track),
    stands: wp.array(dtype=Stand),
):
    """One step of the machine in place, by the substeps of `single_track.SingleTrack`: drive, tyres, ground.

    nodes, first, points: as in `footprint_kernel.mean_heights`
    """
    ask = asked[0]
    loop = loops[0]
    car = cars[0]
    q = tracks[0]
    a = stands[0]
    m = moments[0]
    speed = a.speed
    rim = a.rim
    slip = a.slip
    d = Drive()
    d.h = ask.h
    d.steer = loop.sense * ask.steer
    is_done = wp.isfinite(ask.wanted)
    for _ in range(int(ask.count)):
        if is_done:
            grade = -wp.sin(a.pitch) / wp.cos(a.pitch)
            before = slip
            slip = slipped(slip, grade, wp.abs(speed) * ask.h, car)
            d.start = speed
            d.middle = driven(rim, ask.wanted, HALF * ask.h, loop) / (ONE + HALF * (before + slip))
            rim = driven(rim, ask.wanted, ask.h, loop)
            free = rim / (ONE + slip)
            d.end = given(speed, free, grade, ask.h, car)
            if d.end != free:
                rim = d.end * (ONE + slip)
                d.middle = HALF * (speed + d.end)
            d.roll = a.roll
            d.pitch = a.pitch
            d.front_slope = a.front_slope
            d.rear_slope = a.rear_slope
            m = held(car, d)
            q = integrated(q, d, car, m)
            a = stood(nodes, first, points, spans[0], q, loop)
            speed = d.end
            is_done = a.is_done == ONE
    if is_done:
        a = turned(a, q, car)
        a.is_done = ONE
        a.speed = speed
        a.rim = rim
        a.slip = slip
        stands[0] = a
        tracks[0] = q
        moments[0] = m
    else:
        a = stands[0]
        a.is_done = real(0.0)
        stands[0] = a
