"""How a machine stands on the ground, compiled; pitch and roll: see `attitude`."""

import warp as wp

from swath.field.ground.footprint_kernel import Place, Span, mean_height
from swath.machine.drive_kernel import HALF, ONE

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
real = wp.float64


@wp.struct
class Track:
    """The state: place [m], heading [rad], lateral speed of the centre of gravity [m/s], yaw rate [rad/s],
    slips of the axles, distance [m]. The same struct holds its rates.
    """

    x: wp.float64
    y: wp.float64
    yaw: wp.float64
    side: wp.float64
    turn: wp.float64
    front_slip: wp.float64
    rear_slip: wp.float64
    distance: wp.float64


@wp.struct
class Ground:
    """Nodes in memory around a machine, and what its tyres touch, as `Footprint.arguments`; wheelbase, below
    0 where the steered axle is ahead, tracks of the axles [m].
    """

    nodes: wp.array2d(dtype=wp.float64)
    first: wp.array(dtype=int)
    points: wp.array2d(dtype=wp.float64)
    span: wp.array(dtype=Span)
    wheelbase: wp.float64
    front_track: wp.float64
    rear_track: wp.float64


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


@wp.func
def stood(g: Ground, q: Track) -> Stand:
    """Where a track is; is_done 0 where the ground there is not in memory."""
    span = g.span[0]
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
        left = mean_height(g.nodes, g.first, g.points, p, 0, 4)
        right = mean_height(g.nodes, g.first, g.points, p, 1, 4)
        rear_left = mean_height(g.nodes, g.first, g.points, p, 2, 4)
        rear_right = mean_height(g.nodes, g.first, g.points, p, 3, 4)
        a.z = HALF * (left + right)
        fall = HALF * (rear_left + rear_right) - a.z
        a.pitch = wp.atan2(wp.copysign(ONE, g.wheelbase) * fall, wp.abs(g.wheelbase))
        a.front_slope = (left - right) / g.front_track
        a.roll = wp.atan(a.front_slope * wp.cos(a.pitch))
        a.rear_slope = (rear_left - rear_right) / g.rear_track
    return a


@wp.func
def turned(a: Stand, q: Track, ahead: wp.float64) -> Stand:
    """With the rows of the rotation, as `frames.rotation_rows`, and what else a sample says.

    ahead: of the centre of gravity to the fixed axle [m]
    """
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
    a.lateral = q.side + ahead * q.turn
    a.turn = q.turn
    a.distance = q.distance
    return a


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
def stand_at(grounds: wp.array(dtype=Ground), tracks: wp.array(dtype=Track), stands: wp.array(dtype=Stand)):
    """Where the tracks are."""
    w = wp.tid()
    stands[w] = turned(stood(grounds[w], tracks[w]), tracks[w], real(0.0))
