"""How fast machines may drive by what they see of the crop edge, as a kernel over worlds."""

import warp as wp

from swath.control.speed import guard
from swath.kernels import constants

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

Numbers = wp.array(dtype=wp.float64)
ZERO, ONE, TWO, NS, LEAST = constants(0.0, 1.0, 2.0, 1e9, 1e-6)
BRAKE, LAG, STANDING = constants(guard.BRAKE, guard.LAG, guard.STANDING)
UNSURE, BEND_M, EVEN_CHANCE = constants(guard.UNSURE, guard.BEND_M, guard.EVEN_CHANCE)
SLOW, IGNORE, PATH = (wp.constant(guard.CHOICES.index(name)) for name in ("slow", "ignore", "path"))


@wp.struct
class Limits:
    """Numbers of `Guard` in SI.

    when_lost: place in `CHOICES`
    wanted: speed where nothing bounds it [m/s]
    """

    when_lost: wp.int32
    wanted: wp.float64
    blind_m: wp.float64
    slow: wp.float64
    sure: wp.float64
    bend: wp.float64
    room: wp.float64


@wp.struct
class Driven:
    """What a machine has driven.

    blind: distance driven without knowing the edge [m]
    bend: curvature of the edge [1/m]
    is_over: whether the machine stopped because it was blind for too long
    """

    blind: wp.float64
    bend: wp.float64
    is_over: wp.int32


@wp.kernel
def bound_speeds(
    limits: wp.array(dtype=Limits),
    driven: wp.array(dtype=Driven),
    clock: wp.array(dtype=wp.int64),
    needs: wp.array(dtype=wp.int32),
    sees: wp.bool,
    offset: Numbers,
    confidence: Numbers,
    curvature: Numbers,
    seen_to: Numbers,
    reference_x: Numbers,
    offset_sd: Numbers,
    other_offset: Numbers,
    other_chance: Numbers,
    measured: Numbers,
    is_led: wp.array(dtype=wp.bool),
    allowed: Numbers,
):
    """Write to `allowed` the speed that may be driven over the next step [m/s].

    needs: set where a machine stops for good
    """
    w = wp.tid()
    p = limits[w]
    wanted = p.wanted
    allowed[w] = wanted
    if is_led[w] and p.when_lost == PATH:
        driven[w].blind = ZERO
        allowed[w] = wp.min(wanted, p.slow)
        return
    if not sees or p.when_lost == IGNORE:
        return
    speed = wanted
    if wp.isfinite(measured[w]):
        speed = wp.abs(measured[w])
    travel = ZERO
    if speed >= STANDING:
        travel = speed * wp.float64(clock[2]) / NS
    is_found = confidence[w] > ZERO and wp.isfinite(offset[w])
    is_known = is_found and not (seen_to[w] < reference_x[w]) and not (EVEN_CHANCE * offset_sd[w] > p.room)
    blind = driven[w].blind + travel
    if is_known:
        blind = ZERO
    bend = ZERO
    if is_found and wp.isfinite(curvature[w]):
        bend = wp.abs(curvature[w])
    bend = driven[w].bend + wp.min(ONE, travel / BEND_M) * (bend - driven[w].bend)
    driven[w].blind = blind
    driven[w].bend = bend
    most = wp.min(wanted, wp.sqrt(p.bend / wp.max(bend, LEAST)))
    low = UNSURE * p.sure
    trust = wp.min(wp.max((confidence[w] - low) / (p.sure - low), ZERO), ONE)
    if wp.abs(other_offset[w] - offset[w]) > p.room:  # nan where there is no other place
        trust = trust * (ONE - other_chance[w])
    slow = wp.min(p.slow, wanted)
    bound = wp.min(most, slow + trust * wp.max(wanted - slow, ZERO))
    allowed[w] = bound
    if p.when_lost == SLOW:
        return
    left = p.blind_m - blind - LAG * speed
    if left <= STANDING * LAG and speed < STANDING and driven[w].is_over == 0:
        driven[w].is_over = 1
        needs[0] = 1
    if blind != ZERO:
        allowed[w] = ZERO
        if left > ZERO:
            allowed[w] = wp.min(bound, wp.sqrt(TWO * BRAKE * left))
