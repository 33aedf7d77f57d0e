"""A whole step of `single_track`, compiled: the loop of the drive, the tyres, the ground under them.

The same operations in the same order as `SingleTrack` does them in Python.
"""

import warp as wp

from swath.field.ground.footprint_kernel import Place, Span, mean_height
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
    soft_sign,
)

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
real = wp.float64
BRIXIUS_SLIP, LEAST_FREE = wp.constant(real(7.5)), wp.constant(real(1e-6))


@wp.struct
class Ground:
    """Nodes in memory around a machine, and what its tyres touch, as `Footprint.arguments`."""

    nodes: wp.array2d(dtype=wp.float64)
    first: wp.array(dtype=int)
    points: wp.array2d(dtype=wp.float64)
    span: wp.array(dtype=Span)


@wp.struct
class Loop:
    """The closed loop of the drive, as `machine_sheet.Dynamics`; wheelbase, tracks of the axles [m]: below 0
    where the steered axle is ahead, as in `attitude.TerrainFollower`; sense: of the steering, 1 or -1;
    longest: substep [s].
    """

    lag: wp.float64
    accel: wp.float64
    decel: wp.float64
    fastest: wp.float64
    wheelbase: wp.float64
    front_track: wp.float64
    rear_track: wp.float64
    sense: wp.float64
    longest: wp.float64


@wp.struct
class Stand:
    """Where the machine is after a step.

    is_done: 0 where the ground under it is not in memory or a number is not finite, nothing has changed then;
        speed over ground and of the rims [m/s], slip along; as `attitude.Stance`; rows of its rotation place
        [m], speed to the left [m/s], yaw rate [rad/s], distance [m]
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
def given(
    before: wp.float64, after: wp.float64, grade: wp.float64, asked: wp.float64, dt: wp.float64, car: Car
) -> wp.float64:
    """As `traction.Traction.given`. asked: grade and the resistance of soil."""
    level = ONE / wp.sqrt(ONE + grade * grade)
    most = wp.min(grip(grade, car) * level, car.thrust)
    low = before + dt * (GRAVITY * (-most - asked * level))
    high = before + dt * (GRAVITY * (most - asked * level))
    return wp.min(wp.max(after, low), high)


@wp.func
def slipped(slip: wp.float64, grade: wp.float64, asked: wp.float64, way: wp.float64, car: Car) -> wp.float64:
    """As `traction.Traction.slip_after`; on soil T / T_max = 1 - exp(-7.5 s), as `soil.Brixius`."""
    gone = -expm1(-way / car.along_relaxation)
    free = ONE - wp.abs(asked) / grip(grade, car)
    x = ONE
    if free > real(0.0):
        x = ONE - cbrt(free)
    steady = wp.copysign(THREE * car.along_friction / car.along_stiffness * x, asked)
    if car.drag > real(0.0):
        steady = wp.copysign(wp.min(-wp.log(wp.max(free, LEAST_FREE)) / BRIXIUS_SLIP, ONE), asked)
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
def weigh(
    tank_grain: wp.array(dtype=wp.float64),
    carried: wp.array(dtype=wp.float64),
    step: wp.float64,
    needs: wp.array(dtype=int),
):
    """needs: 1 where the grain [kg] in a tank is no longer what a machine carries, but for a step."""
    w = wp.tid()
    if wp.abs(wp.max(tank_grain[w], real(0.0)) - carried[w]) >= step:
        needs[0] = 1


@wp.func
def tell(states: wp.array2d(dtype=wp.float64), w: int, a: Stand, steer: wp.float64):
    """As the columns of a `MachineState`."""
    states[w, 0] = a.x
    states[w, 1] = a.y
    states[w, 2] = a.z
    states[w, 3] = a.xx
    states[w, 4] = a.xy
    states[w, 5] = a.xz
    states[w, 6] = a.yx
    states[w, 7] = a.yy
    states[w, 8] = a.yz
    states[w, 9] = a.zx
    states[w, 10] = a.zy
    states[w, 11] = a.zz
    states[w, 12] = a.speed
    states[w, 13] = a.lateral
    states[w, 14] = a.turn
    states[w, 15] = steer
    states[w, 16] = a.distance


@wp.kernel
def stand_cars(
    grounds: wp.array(dtype=Ground),
    cars: wp.array(dtype=Car),
    loops: wp.array(dtype=Loop),
    tracks: wp.array(dtype=Track),
    stands: wp.array(dtype=Stand),
    states: wp.array2d(dtype=wp.float64),
):
    """Where the tracks are, wheels straight."""
    w = wp.tid()
    g = grounds[w]
    old = stands[w]
    a = stood(g.nodes, g.first, g.points, g.span[0], tracks[w], loops[w])
    if a.is_done == ONE:
        a = turned(a, tracks[w], cars[w])
        a.is_done = ONE
    a.speed = old.speed
    a.rim = old.rim
    a.slip = old.slip
    stands[w] = a
    tell(states, w, a, real(0.0))


@wp.kernel
def drive(
    grounds: wp.array(dtype=Ground),
    cars: wp.array(dtype=Car),
    loops: wp.array(dtype=Loop),
    steering: wp.array(dtype=wp.float64),
    speeds: wp.array(dtype=wp.float64),
    limits: wp.array(dtype=wp.float64),
    clock: wp.array(dtype=wp.int64),
    needs: wp.array(dtype=int),
    again: wp.array(dtype=int),
    sought: wp.array2d(dtype=wp.float64),
    moments: wp.array(dtype=Moment),
    tracks: wp.array(dtype=Track),
    stands: wp.array(dtype=Stand),
    states: wp.array2d(dtype=wp.float64),
):
    """One step of the machines in place, in equal substeps: drive, tyres, ground.

    steering: angle of the steered wheel [rad]; speeds: wanted [m/s]; limits: what the drive can [m/s]; clock:
    begin, end, length of the step [ns]; needs: 1 where the ground under a machine is not in memory or a
    speed is no number: nothing has changed then; again: 1 = only those for which that was so;
    sought: where that ground is, and the heading there
    """
    w = wp.tid()
    a = stands[w]
    if again[0] == 1 and a.is_done == ONE:
        return
    g = grounds[w]
    loop = loops[w]
    car = cars[w]
    q = tracks[w]
    m = moments[w]
    wanted = speeds[w]
    is_done = wp.isfinite(wanted)
    if wp.isfinite(limits[w]):
        wanted = wp.min(wp.max(wanted, -limits[w]), limits[w])
    seconds = real(clock[2]) / real(1.0e9)
    count = wp.max(real(1.0), wp.ceil(seconds / loop.longest - real(1.0e-9)))
    h = seconds / count
    speed = a.speed
    rim = a.rim
    slip = a.slip
    d = Drive()
    d.h = h
    d.steer = loop.sense * steering[w]
    for _ in range(int(count)):
        if is_done:
            grade = -wp.sin(a.pitch) / wp.cos(a.pitch)
            before = slip
            asked = grade
            if car.drag > real(0.0):
                asked += car.drag * soft_sign(speed)
            slip = slipped(slip, grade, asked, wp.abs(speed) * h, car)
            d.start = speed
            d.middle = driven(rim, wanted, HALF * h, loop) / (ONE + HALF * (before + slip))
            rim = driven(rim, wanted, h, loop)
            free = rim / (ONE + slip)
            d.end = given(speed, free, grade, asked, h, car)
            if d.end != free:
                rim = d.end * (ONE + slip)
                d.middle = HALF * (speed + d.end)
            d.roll = a.roll
            d.pitch = a.pitch
            d.front_slope = a.front_slope
            d.rear_slope = a.rear_slope
            m = held(car, d)
            q = integrated(q, d, car, m)
            a = stood(g.nodes, g.first, g.points, g.span[0], q, loop)
            speed = d.end
            is_done = a.is_done == ONE
            if not is_done:
                sought[w, 0] = q.x
                sought[w, 1] = q.y
                sought[w, 2] = q.yaw
    if is_done:
        a = turned(a, q, car)
        a.is_done = ONE
        a.speed = speed
        a.rim = rim
        a.slip = slip
        stands[w] = a
        tracks[w] = q
        moments[w] = m
        tell(states, w, a, steering[w])
    else:
        a = stands[w]
        a.is_done = real(0.0)
        stands[w] = a
        needs[0] = 1
