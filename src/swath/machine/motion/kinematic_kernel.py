"""The level `kinematic` as kernels over worlds: each machine drives its arc, then stands on the ground."""

from pathlib import Path

import warp as wp

from swath.kernels import exact_code
from swath.machine.attitude_kernel import Ground, Stand, Track, stood, tell, turned
from swath.machine.drive_kernel import HALF, ONE, Loop, Traction, Wheels, rolled, slipped

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
real = wp.float64
_HERE = Path(__file__).parent


@wp.func_native(exact_code(_HERE / "length_of_two.cpp"))
def length_of(x: wp.float64, y: wp.float64) -> wp.float64: ...


@wp.struct
class Vehicle:
    """What stays. along, across: the wheels; wheelbase [m], below 0
    where the steered axle is ahead; rear_share: of the slope under the rear axle.
    """

    along: Traction
    across: Traction
    loop: Loop
    wheelbase: wp.float64
    rear_share: wp.float64


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
    before = Wheels()
    before.speed = a.speed
    before.rim = a.rim
    before.slip = a.slip
    wheels = rolled(before, wanted, dt, a.pitch, v.along, v.loop)
    travel = wheels.way
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
    a.speed = wheels.speed
    a.rim = wheels.rim
    a.slip = wheels.slip
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
    a = stood(grounds[w], q)
    if a.is_done == ONE:
        a = turned(a, q, real(0.0))
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
