"""Process level `constant` as a kernel over worlds."""

import warp as wp

from swath.kernels import constants

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

Numbers = wp.array(dtype=wp.float64)
Trails = wp.array2d(dtype=wp.float64)
ZERO, NS = constants(0.0, 1e9)


@wp.struct
class Shares:
    """loss: share of the grain lost; capacity: of the tank [kg], 0 = without end."""

    loss: wp.float64
    capacity: wp.float64


@wp.struct
class Sums:
    """Compensated sums [kg], as `Total`; laid: straw that left during the step."""

    tank: wp.float64
    tank_rest: wp.float64
    lost: wp.float64
    lost_rest: wp.float64
    straw: wp.float64
    straw_rest: wp.float64
    laid: wp.float64


@wp.func
def rest_of(total: wp.float64, value: wp.float64) -> wp.float64:
    """What rounding leaves of a term that is added to a total."""
    new = total + value
    if wp.abs(total) >= wp.abs(value):
        return (total - new) + value
    return (value - new) + total


@wp.kernel
def pass_on(
    shares: wp.array(dtype=Shares),
    sums: wp.array(dtype=Sums),
    clock: wp.array(dtype=wp.int64),
    needs: wp.array(dtype=wp.int32),
    head: wp.array(dtype=wp.int64),
    cut_grain: Trails,
    cut_straw: Trails,
    tank_grain: Numbers,
    lost_grain: Numbers,
    dropped_straw: Numbers,
    held_grain: Numbers,
    held_straw: Numbers,
    grain_flow: Numbers,
    straw_flow: Numbers,
    header_flow: Numbers,
    feeder_flow: Numbers,
    drum_flow: Numbers,
    rotor_flow: Numbers,
    shoe_flow: Numbers,
    separation_loss: Numbers,
    loss_share: Numbers,
):
    """head, cut_grain, cut_straw: of the trail of crop flows, (k, world); needs: set, the straw is to be
    laid; from tank_grain on: of a `MachineLoad`.
    """
    w = wp.tid()
    p = shares[w]
    s = sums[w]
    grain = ZERO
    straw = ZERO
    lost = ZERO
    for i in range(int(head[1])):
        came = cut_grain[i, w]
        gone = came * p.loss
        over = ZERO
        if p.capacity > ZERO:
            content = s.tank + s.tank_rest
            over = wp.min(wp.max(content + (came - gone) - p.capacity, ZERO), came - gone)
        kept = came - gone - over
        s.tank_rest += rest_of(s.tank, kept)
        s.tank += kept
        s.lost_rest += rest_of(s.lost, gone + over)
        s.lost += gone + over
        s.straw_rest += rest_of(s.straw, cut_straw[i, w])
        s.straw += cut_straw[i, w]
        grain = grain + came - gone
        straw = straw + cut_straw[i, w]
        lost = lost + gone
    s.laid = straw
    sums[w] = s
    needs[0] = 1
    rate = NS / wp.float64(clock[2])
    tank_grain[w] = s.tank + s.tank_rest
    lost_grain[w] = s.lost + s.lost_rest
    dropped_straw[w] = s.straw + s.straw_rest
    grain_flow[w] = grain * rate
    straw_flow[w] = straw * rate
    feed = grain * rate + lost * rate + straw * rate
    header_flow[w] = feed
    feeder_flow[w] = feed
    drum_flow[w] = feed
    rotor_flow[w] = straw * rate
    shoe_flow[w] = grain * rate
    separation_loss[w] = lost * rate
    loss_share[w] = ZERO
    if feed > ZERO:
        loss_share[w] = p.loss
