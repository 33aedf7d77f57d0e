"""How a machine stands, compiled; the class around it: `attitude.TerrainFollower`."""

import warp as wp

from swath.field.footprint_kernel import Ground, read_points

real = wp.float64


@wp.struct
class Stand:
    """As `attitude.Stance`."""

    z: wp.float64
    roll: wp.float64
    pitch: wp.float64
    front_slope: wp.float64
    rear_slope: wp.float64


@wp.struct
class Gear:
    """The axles (front: the fixed one, rear: the steered one), the ground under them, where the result goes.

    wheelbase: < 0 where the steered axle is ahead; front_track, rear_track [m]
    ground: without points its means are given
    stand: (1,); position: (3,), rotation: (3, 3) of the pose
    """

    wheelbase: wp.float64
    front_track: wp.float64
    rear_track: wp.float64
    ground: Ground
    stand: wp.array(dtype=Stand)
    position: wp.array(dtype=wp.float64)
    rotation: wp.array2d(dtype=wp.float64)


@wp.func
def stand_at(place: wp.vec3d, g: Gear):
    """Stand at x, y [m] with a heading [rad].

    pitch = atan((rear - front) / wheelbase), roll = atan(front slope * cos(pitch)): on a plane the body's
    z axis is then exactly the plane's normal (intrinsic z-y'-x'' angles).
    """
    if g.ground.points.shape[0] > 0:
        read_points(place, g.ground)
    z = g.ground.means
    a = Stand()
    a.z = real(0.5) * (z[0] + z[1])
    fall = real(0.5) * (z[2] + z[3]) - a.z
    a.pitch = wp.atan2(wp.sign(g.wheelbase) * fall, wp.abs(g.wheelbase))
    a.front_slope = (z[0] - z[1]) / g.front_track
    a.rear_slope = (z[2] - z[3]) / g.rear_track
    a.roll = wp.atan(a.front_slope * wp.cos(a.pitch))
    g.stand[0] = a
    write_pose(wp.vec3d(place[0], place[1], a.z), wp.vec3d(a.roll, a.pitch, place[2]), g)


@wp.func
def write_pose(at: wp.vec3d, turned: wp.vec3d, g: Gear):
    """As `frames.Pose.from_euler`."""
    cr = wp.cos(turned[0])
    sr = wp.sin(turned[0])
    cp = wp.cos(turned[1])
    sp = wp.sin(turned[1])
    cy = wp.cos(turned[2])
    sy = wp.sin(turned[2])
    for k in range(3):
        g.position[k] = at[k]
    g.rotation[0, 0] = cy * cp
    g.rotation[0, 1] = cy * sp * sr - sy * cr
    g.rotation[0, 2] = cy * sp * cr + sy * sr
    g.rotation[1, 0] = sy * cp
    g.rotation[1, 1] = sy * sp * sr + cy * cr
    g.rotation[1, 2] = sy * sp * cr - cy * sr
    g.rotation[2, 0] = -sp
    g.rotation[2, 1] = cp * sr
    g.rotation[2, 2] = cp * cr


@wp.kernel(enable_backward=False)
def stand(places: wp.array(dtype=wp.vec3d), gear: Gear):
    stand_at(places[0], gear)
