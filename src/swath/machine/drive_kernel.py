"""The drive of a machine, compiled: the closed loop that turns its rims, and how far its wheels slip for it.

A loop is first order with a limited rate, solved exactly: no step size enters. Wheels: see `traction`.
"""

import warp as wp

from swath.kernels import constants
from swath.machine import tyre

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
real = wp.float64
Numbers = wp.array(dtype=wp.float64)
GRAVITY, LEAST_LOAD = constants(tyre.GRAVITY, tyre.LEAST_LOAD)
ROLLING_SPEED = constants(tyre.ROLLING_SPEED)[0]
BRIXIUS_SLIP, LEAST_FREE = constants(7.5, 1e-6)
ZERO, HALF, ONE, THREE = constants(0.0, 0.5, 1.0, 3.0)


@wp.struct
class Loop:
    """The closed loop of the drive, as `machine_sheet.Dynamics`: a hydrostat under a governor."""

    lag: wp.float64
    accel: wp.float64
    decel: wp.float64
    fastest: wp.float64


@wp.struct
class Traction:
    """As `traction.Traction`; drag: resistance of soil over the weight, 0 on firm ground."""

    stiffness: wp.float64
    friction: wp.float64
    relaxation: wp.float64
    thrust: wp.float64
    level_share: wp.float64
    grade_share: wp.float64
    drag: wp.float64


@wp.struct
class Wheels:
    """Driven wheels after a step: speed over ground, of the rims [m/s], slip; speed in its middle [m/s], way
    in it [m].
    """

    speed: wp.float64
    rim: wp.float64
    slip: wp.float64
    middle: wp.float64
    way: wp.float64


@wp.func_native("return __builtin_expm1(x);")
def expm1(x: wp.float64) -> wp.float64: ...


@wp.func_native("return __builtin_cbrt(x);")
def cbrt(x: wp.float64) -> wp.float64: ...


@wp.func
def soft_sign(speed: wp.float64) -> wp.float64:
    return wp.clamp(speed / ROLLING_SPEED, -ONE, ONE)


@wp.func
def approached(value: real, target: real, dt: real, lag: real, limit: real):
    """Solve dv/dt = clip((target - v) / lag, -limit, limit) over dt [s]: v(dt), integral of v over dt.

    lag > 0 [s]; limit > 0 [units of v per s]. Outside limit * lag of the target v is a ramp, inside an
    exponential.
    """
    error = target - value
    ramp = wp.abs(error) / limit - lag
    reached = value
    area = ZERO
    if ramp > ZERO:
        ramp = wp.min(dt, ramp)
        slope = wp.copysign(limit, error)
        reached = value + slope * ramp
        area = (value + HALF * slope * ramp) * ramp
    else:
        ramp = ZERO
    rest = dt - ramp
    if rest > ZERO:
        gone = -(target - reached) * expm1(-rest / lag)
        area += target * rest - lag * gone
        reached += gone
    if error == ZERO:
        reached = value
        area = value * dt
    return reached, area


@wp.func
def driven(speed: real, wanted: real, dt: real, loop: Loop):
    """The speed after dt [s], the way in it [m]; speeds [m/s], < 0 backwards. Slowing uses `decel`."""
    target = wp.clamp(wanted, -loop.fastest, loop.fastest)
    limit = loop.decel
    if wp.abs(target) > wp.abs(speed) and target * speed >= ZERO:
        limit = loop.accel
    reached, way = approached(speed, target, dt, loop.lag, limit)
    return reached, way


@wp.func
def grip(grade: wp.float64, t: Traction) -> wp.float64:
    """Largest force, over what presses the machine on the ground."""
    share = t.level_share - t.grade_share * grade
    return t.friction * wp.min(wp.max(share, LEAST_LOAD), ONE)


@wp.func
def given(before: real, after: real, grade: real, asked: real, dt: real, t: Traction) -> wp.float64:
    """The ground speed [m/s] nearest to `after` that the wheels can give on a slope within dt [s].

    asked: grade and the resistance of soil
    """
    level = ONE / wp.sqrt(ONE + grade * grade)
    most = wp.min(grip(grade, t) * level, t.thrust)
    low = before + dt * (GRAVITY * (-most - asked * level))
    high = before + dt * (GRAVITY * (most - asked * level))
    return wp.min(wp.max(after, low), high)


@wp.func
def steady_slip(force: wp.float64, top: wp.float64, t: Traction) -> wp.float64:
    """Slip at a force along the ground, where `top` is the largest: the brush formula turned round, full
    sliding at most; on soil T / T_max = 1 - exp(-7.5 s), as `soil.Brixius`.
    """
    free = ONE - wp.abs(force) / top
    if t.drag > ZERO:
        return wp.copysign(wp.min(-wp.log(wp.max(free, LEAST_FREE)) / BRIXIUS_SLIP, ONE), force)
    x = ONE
    if free > ZERO:
        x = ONE - cbrt(free)
    return wp.copysign(THREE * t.friction / t.stiffness * x, force)


@wp.func
def slipped(slip: real, grade: real, asked: real, way: real, t: Traction) -> wp.float64:
    """The slip on a slope after a way [m]: it lags by the relaxation length (Pacejka 2012, 7.2)."""
    gone = -expm1(-way / t.relaxation)
    return slip + (steady_slip(asked, grip(grade, t), t) - slip) * gone


@wp.func
def rolled(w: Wheels, wanted: real, dt: real, pitch: real, t: Traction, loop: Loop) -> Wheels:
    """Wheels after dt [s] at a wanted speed [m/s]; pitch [rad] is held over it.

    The loop of the drive turns the rims, the slip on a slope makes the ground speed of it.
    """
    grade = -wp.sin(pitch) / wp.cos(pitch)
    asked = grade
    if t.drag > ZERO:
        asked += t.drag * soft_sign(w.speed)
    n = Wheels()
    n.slip = slipped(w.slip, grade, asked, wp.abs(w.speed) * dt, t)
    half, _ = driven(w.rim, wanted, HALF * dt, loop)
    rim, way = driven(w.rim, wanted, dt, loop)
    mean = ONE + HALF * (w.slip + n.slip)
    free = rim / (ONE + n.slip)
    n.rim = rim
    n.speed = given(w.speed, free, grade, asked, dt, t)
    n.middle = half / mean
    n.way = way / mean
    if n.speed != free:
        n.rim = n.speed * (ONE + n.slip)
        n.middle = HALF * (w.speed + n.speed)
        n.way = n.middle * dt
    return n


@wp.kernel
def follow_wanted(loops: wp.array(dtype=Loop), asked: Numbers):
    """asked: speed, wanted speed [m/s], time [s]; then speed after it and way [m]."""
    reached, way = driven(asked[0], asked[1], asked[2], loops[0])
    asked[3] = reached
    asked[4] = way


@wp.kernel
def roll_wheels(
    loops: wp.array(dtype=Loop),
    tractions: wp.array(dtype=Traction),
    asked: Numbers,
    wheels: wp.array(dtype=Wheels),
):
    """asked: wanted speed [m/s], time [s], pitch [rad]."""
    wheels[0] = rolled(wheels[0], asked[0], asked[1], asked[2], tractions[0], loops[0])


@wp.kernel
def slip_under(forces: Numbers, tractions: wp.array(dtype=Traction), slips: Numbers):
    """Steady slips of wheels under forces, over the load on them."""
    w = wp.tid()
    slips[w] = steady_slip(forces[w], tractions[w].friction, tractions[w])
