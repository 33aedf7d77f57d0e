"""The level `actuator` as a kernel over worlds."""

import warp as wp

from swath.machine.drive_kernel import approached

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
NS = wp.constant(wp.float64(1.0e9))


@wp.struct
class Servo:
    """What stays. rate [rad/s], lag [s], band: as in `actuator.Params`; dead: dead time [ns]; wheelbase [m].

    most: largest angle [rad]
    """

    rate: wp.float64
    lag: wp.float64
    band: wp.float64
    dead: wp.int64
    wheelbase: wp.float64
    most: wp.float64


@wp.struct
class Wheel:
    """angle, wanted: of the equivalent wheel [rad]; first, count: of the commands that are under way."""

    angle: wp.float64
    wanted: wp.float64
    first: int
    count: int


@wp.func
def turned_to(servo: Servo, wheel: Wheel, duration: wp.int64) -> wp.float64:
    """The angle after a time [ns]."""
    error = wheel.wanted - wheel.angle
    rest = servo.band * servo.lag * servo.rate
    if duration <= wp.int64(0) or (-rest <= error and error <= rest):
        return wheel.angle
    target = wheel.wanted + rest
    if error > wp.float64(0.0):
        target = wheel.wanted - rest
    lag = servo.lag * (wp.float64(1.0) - servo.band)
    angle, _ = approached(wheel.angle, target, wp.float64(duration) / NS, lag, servo.rate)
    return angle


@wp.kernel
def turn_wheels(
    servos: wp.array(dtype=Servo),
    wheels: wp.array(dtype=Wheel),
    arrivals: wp.array2d(dtype=wp.int64),
    curvatures: wp.array2d(dtype=wp.float64),
    engaged: wp.array2d(dtype=wp.bool),
    seen: wp.array(dtype=wp.int64),
    clock: wp.array(dtype=wp.int64),
    needs: wp.array(dtype=int),
    stamp: wp.array(dtype=wp.int64),
    new_curvature: wp.array(dtype=wp.float64),
    new_engaged: wp.array(dtype=wp.bool),
    angles: wp.array(dtype=wp.float64),
    rates: wp.array(dtype=wp.float64),
):
    """arrivals, curvatures, engaged: of the commands under way, a ring for each world; seen: time of the
    last one that was taken [ns]; clock: begin and end of the step; stamp: time of the newest command.
    """
    w = wp.tid()
    servo = servos[w]
    wheel = wheels[w]
    room = arrivals.shape[1]
    if stamp[0] != seen[w]:
        if wheel.count >= room:
            needs[0] = 1
            return
        seen[w] = stamp[0]
        at = (wheel.first + wheel.count) % room
        arrivals[w, at] = stamp[0] + servo.dead
        curvatures[w, at] = new_curvature[w]
        engaged[w, at] = new_engaged[w]
        wheel.count += 1
    now = clock[0]
    end = clock[1]
    while wheel.count > 0 and arrivals[w, wheel.first] < end:
        arrival = arrivals[w, wheel.first]
        wheel.angle = turned_to(servo, wheel, arrival - now)
        now = wp.max(now, arrival)
        angle = wp.atan(servo.wheelbase * curvatures[w, wheel.first])
        if engaged[w, wheel.first] and angle == angle:
            wheel.wanted = wp.min(wp.max(angle, -servo.most), servo.most)
        else:
            wheel.wanted = wheel.angle
        wheel.first = (wheel.first + 1) % room
        wheel.count -= 1
    wheel.angle = turned_to(servo, wheel, end - now)
    opening = (wheel.wanted - wheel.angle) / (servo.lag * servo.rate)
    rate = wp.float64(0.0)
    if not (-servo.band <= opening and opening <= servo.band):
        flow = wp.min(wp.float64(1.0), (wp.abs(opening) - servo.band) / (wp.float64(1.0) - servo.band))
        if opening > wp.float64(0.0):
            rate = servo.rate * flow
        else:
            rate = servo.rate * (wp.float64(0.0) - flow)
    wheels[w] = wheel
    angles[w] = wheel.angle
    rates[w] = rate
