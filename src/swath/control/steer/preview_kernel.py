"""The levels `preview`, `stanley` and `pure_pursuit` as a kernel over worlds."""

import warp as wp

from swath.control import inclination, yaw_rate
from swath.control.inertial_kernel import incline, turn
from swath.control.steer import plant_model
from swath.kernels import constants

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

real = wp.float64
Numbers = wp.array(dtype=wp.float64)
ZERO, HALF, ONE, TWO, NS, INF = constants(0.0, 0.5, 1.0, 2.0, 1e9, float("inf"))
GRAVITY, CRAWL, BETTER, FORGET = constants(
    inclination.GRAVITY, plant_model.CRAWL, plant_model.BETTER, plant_model.FORGET_M
)
SURE = constants(plant_model.SURE)[0]
BIAS = wp.constant(yaw_rate.BIAS)
STEEPEST, SLIP_LIMIT = constants(plant_model.STEEPEST, plant_model.SLIP_LIMIT)
STANLEY_LAW, PURSUIT_LAW = constants(plant_model.STANLEY, plant_model.PURE_PURSUIT)


@wp.struct
class Law:
    """What stays: numbers of `preview.Params` in SI, and of the machine. x, y: of the header end [m].

    law: which one of `preview.py` aims it
    share, period, more, learnt: of `ActuatorModel`, pending: commands on their way
    pole, pole_squared, clip: of `SlipObserver`
    """

    law: wp.float64
    x: wp.float64
    y: wp.float64
    outward: wp.float64
    wheelbase: wp.float64
    limit: wp.float64
    rate: wp.float64
    lookahead: wp.float64
    lookahead_s: wp.float64
    steepest: wp.float64
    crab: wp.float64
    hold: wp.float64
    engage: wp.float64
    share: wp.float64
    period: wp.float64
    pending: wp.float64
    more: wp.float64
    learnt: wp.float64
    pole: wp.float64
    pole_squared: wp.float64
    clip: wp.float64


@wp.struct
class State:
    """command, held: curvature wanted now, and while the edge is lost [1/m]; engaged, lost: since when [s].

    slip: direction of travel to the left of what the steering explains [rad]
    curvature, deficit, model: of `ActuatorModel`
    observed, error, sd: of `SlipObserver`, error nan = none
    """

    command: wp.float64
    held: wp.float64
    engaged: wp.float64
    lost: wp.float64
    slip: wp.float64
    curvature: wp.float64
    deficit: wp.float64
    model: wp.float64
    observed: wp.float64
    error: wp.float64
    sd: wp.float64


@wp.struct
class Place:
    """The numbers of `plant_model.Place`."""

    x: wp.float64
    y: wp.float64
    heading: wp.float64


@wp.struct
class Edge:
    """The numbers of a `CropEdge`, reference_x and offset_sd as reference and sd."""

    offset: wp.float64
    heading: wp.float64
    curvature: wp.float64
    reference: wp.float64
    confidence: wp.float64
    sd: wp.float64


@wp.struct
class Target:
    """error: lateral, > 0 to the left [m]; angle [rad]."""

    error: wp.float64
    angle: wp.float64


@wp.func
def between(value: wp.float64, low: wp.float64, high: wp.float64) -> wp.float64:
    return wp.min(wp.max(value, low), high)


@wp.func
def chained(first: Place, then: Place) -> Place:
    c = wp.cos(first.heading)
    s = wp.sin(first.heading)
    found = Place()
    found.x = first.x + c * then.x - s * then.y
    found.y = first.y + s * then.x + c * then.y
    found.heading = first.heading + then.heading
    return found


@wp.func
def target_of(law: Law, edge: Edge, place: Place, x: wp.float64, y: wp.float64) -> Target:
    """The edge, moved out of the crop by the overlap, from a point of the machine at `place`."""
    point = Place()
    point.x = x
    point.y = y
    end = chained(place, point)
    slope = wp.tan(edge.heading)
    bend = edge.curvature / wp.pow(wp.cos(edge.heading), real(3.0))
    ahead = end.x - edge.reference
    angle = wp.atan(slope + bend * ahead)
    lateral = edge.offset + ahead * (slope + HALF * bend * ahead) - end.y
    found = Target()
    found.error = lateral * wp.cos(angle) + law.outward
    found.angle = angle - place.heading
    return found


@wp.func
def ahead_of(law: Law, state: State, pending: Numbers, speed: wp.float64) -> Place:
    """As `ActuatorModel.ahead`."""
    found = Place()
    curvature = state.curvature
    last = int(law.pending) - 1
    for k in range(int(law.pending) + int(law.more)):
        curvature += law.share * (pending[wp.min(k, last)] - state.deficit - curvature)
        bend = speed * law.period * curvature
        found.x += speed * law.period
        found.y += speed * law.period * (found.heading + HALF * bend + state.slip)
        found.heading += bend
    return found


@wp.func
def curvature_for(law: Law, direction: wp.float64) -> wp.float64:
    slope = wp.tan(between(direction, -STEEPEST, STEEPEST))
    if law.x + law.y * slope < real(0.1) * wp.abs(law.x):
        if slope > ZERO:
            return law.limit
        return -law.limit
    return slope / (law.x + law.y * slope)


@wp.func
def approach_of(law: Law, error: wp.float64, preview_m: wp.float64) -> wp.float64:
    """Angle to the target [rad] at which an error [m] is driven off."""
    return between(wp.atan(error / preview_m), -law.steepest, law.steepest)


@wp.func
def aim(law: Law, edge: Edge, place: Place, slip: wp.float64, preview_m: wp.float64) -> wp.float64:
    """The curvature to drive from `place` on: the law itself."""
    target = target_of(law, edge, place, law.x, law.y)
    if law.law == STANLEY_LAW:
        angle = target_of(law, edge, place, law.wheelbase, law.y).angle
        x = law.wheelbase - law.y * wp.sin(angle)  # on the target's normal through the axle's image
        target = target_of(law, edge, place, x, law.y * wp.cos(angle))
        wheel = target.angle + approach_of(law, target.error, preview_m) - slip
        return wp.tan(between(wheel, real(-1.2), real(1.2))) / law.wheelbase
    approach = approach_of(law, target.error, preview_m)
    if law.law == PURSUIT_LAW:
        steepest = wp.sin(approach) * preview_m  # a far edge is not approached more steeply
        x = law.x + preview_m
        y = steepest + preview_m * wp.tan(target.angle - slip)
        return TWO * y / (x * x + y * y)
    return curvature_for(law, target.angle + approach - slip)


@wp.func
def observe(
    state: State, law: Law, error: wp.float64, drift: wp.float64, travel: wp.float64, weight: wp.float64,
    sd: wp.float64,
) -> State:  # fmt: skip
    """As `SlipObserver.update`."""
    found = state
    if found.error != found.error or law.pole == ZERO or found.sd * found.sd - sd * sd > BETTER * BETTER:
        found.error = error
        found.sd = sd
        return found
    found.sd += wp.min(ONE, travel / FORGET) * wp.max(sd - found.sd, ZERO)
    found.error += (drift - found.observed) * travel
    missed = between(error - found.error, -law.clip, law.clip)
    found.error += missed * wp.min(ONE, TWO * law.pole * weight * travel)
    found.observed -= missed * law.pole_squared * weight * travel
    found.observed = between(found.observed, -SLIP_LIMIT, SLIP_LIMIT)
    if wp.abs(error - found.error) > real(3.0) * law.clip:
        found.error = error
    return found


@wp.kernel
def gather(
    clock: wp.array(dtype=wp.int64),
    stamp: wp.array(dtype=wp.int64),
    offset: wp.array(dtype=wp.float64),
    heading: wp.array(dtype=wp.float64),
    curvature: wp.array(dtype=wp.float64),
    reference: wp.array(dtype=wp.float64),
    confidence: wp.array(dtype=wp.float64),
    sd: wp.array(dtype=wp.float64),
    speed: wp.array(dtype=wp.float64),
    yaw_rate: wp.array(dtype=wp.float64),
    angle: wp.array(dtype=wp.float64),
    asked: wp.array(dtype=wp.float64),
    odometry: wp.array2d(dtype=wp.float64),
    edges: wp.array(dtype=Edge),
):
    """What `steer` asks for.

    clock: begin, end, length of the step [ns]
    stamp: time of the edge, < 0 = none
    """
    w = wp.tid()
    ns = real(1.0e9)
    asked[0] = real(clock[2]) / ns
    asked[1] = real(clock[1] - stamp[0]) / ns
    asked[2] = ZERO
    odometry[w, 0] = speed[w]
    odometry[w, 1] = yaw_rate[w]
    odometry[w, 2] = angle[w]
    if stamp[0] >= wp.int64(0):
        asked[2] = ONE
        edge = Edge()
        edge.offset = offset[w]
        edge.heading = heading[w]
        edge.curvature = curvature[w]
        edge.reference = reference[w]
        edge.confidence = confidence[w]
        edge.sd = sd[w]
        edges[w] = edge


@wp.kernel
def steer(
    laws: wp.array(dtype=Law),
    asked: wp.array(dtype=wp.float64),
    odometry: wp.array2d(dtype=wp.float64),
    edges: wp.array(dtype=Edge),
    upward: wp.array2d(dtype=wp.float64),
    turning: wp.array2d(dtype=wp.float64),
    pendings: wp.array2d(dtype=wp.float64),
    states: wp.array(dtype=State),
    curvatures: wp.array(dtype=wp.float64),
    engaged: wp.array(dtype=wp.bool),
):
    """asked: length of the step [s], age of the edge at its end [s], whether there is one.

    upward, turning: memories of `Inclination` and `YawRate`; curvatures, engaged: the command
    """
    w = wp.tid()
    law = laws[w]
    state = states[w]
    seconds = asked[0]
    measured = odometry[w, 0]
    rate = odometry[w, 1]
    angle = odometry[w, 2]
    speed = real(0.0)
    if wp.isfinite(measured):
        speed = measured
    turning[w, 1] = rate
    turning[w, 2] = measured
    turning[w, 3] = angle
    turning[w, 4] = seconds
    turn(turning[w])
    rate = rate - turning[w, BIAS]
    driven = real(0.0)
    if measured > CRAWL and wp.isfinite(rate):
        driven = rate / measured
    elif wp.isfinite(angle):
        driven = wp.tan(angle) / law.wheelbase
    driven = between(driven, -law.limit, law.limit)
    pending = pendings[w]
    state.model += law.share * (pending[0] - state.model)
    last = int(law.pending) - 1
    for k in range(last):
        pending[k] = pending[k + 1]
    pending[last] = state.command
    state.curvature = driven
    travel = wp.max(speed, ZERO) * seconds
    state.deficit += wp.min(ONE, travel * law.learnt) * (state.model - driven - state.deficit)
    if upward[w, 0] > ZERO:
        upward[w, 1] = speed
        incline(upward[w])
    aside = upward[w, 3] / wp.max(upward[w, 4], HALF)
    expected = -(law.crab * (aside + speed * state.curvature * speed / GRAVITY))
    state.slip = state.observed + expected
    edge = edges[w]
    is_usable = edge.confidence > ZERO and wp.isfinite(edge.offset) and wp.abs(edge.heading) < ONE
    wanted = real(0.0)
    if asked[2] > ZERO and is_usable and wp.isfinite(edge.curvature) and measured > ZERO:
        state.engaged += seconds
        state.lost = ZERO
        far = measured * wp.max(asked[1], ZERO)
        now = Place()
        now.x = far
        now.heading = far * state.curvature
        now.y = far * (HALF * now.heading + state.slip)
        if measured > CRAWL:
            target = target_of(law, edge, now, law.x, law.y)
            slow = wp.max(real(0.1), ONE - law.y * state.curvature)
            drift = target.angle - wp.atan2(law.x * state.curvature, slow) - (state.slip - state.observed)
            sd = real(0.0)
            if wp.isfinite(edge.sd):
                sd = edge.sd
            weight = wp.pow(SURE / wp.max(sd, SURE), TWO)
            state = observe(state, law, target.error, drift, measured * seconds, weight, sd)
        then = chained(now, ahead_of(law, state, pending, measured))
        preview_m = wp.max(law.lookahead, law.lookahead_s * measured)
        wanted = aim(law, edge, then, state.slip, preview_m) + state.deficit
        state.held += wp.min(ONE, seconds / HALF) * (wanted - state.held)
        blend = real(1.0)
        if law.engage > ZERO:
            blend = wp.min(ONE, state.engaged / law.engage)
        wanted = state.command + blend * (wanted - state.command)
    else:
        state.engaged = ZERO
        state.lost += seconds
        state.error = real(wp.nan)
        state.sd = ZERO
        if state.lost <= law.hold:
            wanted = state.held
    step = law.rate * seconds
    wanted = between(wanted, -law.limit, law.limit)
    state.command += between(wanted - state.command, -step, step)
    curvatures[w] = state.command
    engaged[w] = state.lost <= law.hold
    states[w] = state
