"""A whole step of `single_track`, compiled: the loop of the drive, the tyres, the ground under them."""

from pathlib import Path

import warp as wp

from swath.kernels import exact_code
from swath.machine.attitude_kernel import Ground, Stand, Track, stood, tell, turned
from swath.machine.drive_kernel import Loop, Traction, Wheels, rolled
from swath.machine.motion.single_track_kernel import ONE, Car, Drive, Moment, held, integrated

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
real = wp.float64


@wp.struct
class Loading:
    """Machines that carry what is in their tanks, see weigh.cpp."""

    tank_grain: wp.array(dtype=wp.float64)
    carried: wp.array(dtype=wp.float64)
    needs: wp.array(dtype=int)
    empties: wp.array2d(dtype=wp.float64)
    cars: wp.array(dtype=Car)
    tractions: wp.array(dtype=Traction)
    firm: wp.array(dtype=Traction)
    tracks: wp.array(dtype=Track)


@wp.func_native(exact_code(Path(__file__).parent / "weigh.cpp"))
def weigh_car(w: int, its: Loading): ...


@wp.kernel
def weigh(its: Loading):
    """One world a thread."""
    weigh_car(wp.tid(), its)


@wp.kernel
def stand_cars(
    grounds: wp.array(dtype=Ground),
    cars: wp.array(dtype=Car),
    tracks: wp.array(dtype=Track),
    stands: wp.array(dtype=Stand),
    states: wp.array2d(dtype=wp.float64),
):
    """Where the tracks are, wheels straight."""
    w = wp.tid()
    old = stands[w]
    a = stood(grounds[w], tracks[w])
    if a.is_done == ONE:
        a = turned(a, tracks[w], cars[w].ahead)
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
    tractions: wp.array(dtype=Traction),
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
    count = wp.max(real(1.0), wp.ceil(seconds / car.longest - real(1.0e-9)))
    h = seconds / count
    wheels = Wheels()
    wheels.speed = a.speed
    wheels.rim = a.rim
    wheels.slip = a.slip
    d = Drive()
    d.h = h
    d.steer = car.sense * steering[w]
    for _ in range(int(count)):
        if is_done:
            d.start = wheels.speed
            wheels = rolled(wheels, wanted, h, a.pitch, tractions[w], loop)
            d.middle = wheels.middle
            d.end = wheels.speed
            d.roll = a.roll
            d.pitch = a.pitch
            d.front_slope = a.front_slope
            d.rear_slope = a.rear_slope
            m = held(car, d)
            q = integrated(q, d, car, m)
            a = stood(g, q)
            is_done = a.is_done == ONE
            if not is_done:
                sought[w, 0] = q.x
                sought[w, 1] = q.y
                sought[w, 2] = q.yaw
    if is_done:
        a = turned(a, q, car.ahead)
        a.speed = wheels.speed
        a.rim = wheels.rim
        a.slip = wheels.slip
        stands[w] = a
        tracks[w] = q
        moments[w] = m
        tell(states, w, a, steering[w])
    else:
        a = stands[w]
        a.is_done = real(0.0)
        stands[w] = a
        needs[0] = 1
