"""Bags as other people's drivers write them: the drive of `bags.py` with other frames, units and clocks."""

import numpy as np

from swath.core.frames import Pose
from swath.core.units import DEG
from tests.bags import BEGIN, NS, SPEED, START, Bag

GRAVITY = 9.81
CODES = {"f4": 7, "f8": 8, "i4": 5, "u4": 6, "u2": 4}
ANTENNA = (-1.2, 0.0, 3.9)
PLANAR = Pose.identity()
WALL, RATE_HZ = 15.0, 10.0  # x of the step that `heading_for_a_wall` drives at [m]; sweeps a second


def tree(bag, *links):
    """A TFMessage of (parent, child, pose)."""
    made = []
    for parent, child, pose in links:
        transform = bag.make(
            "geometry_msgs/Transform",
            translation=bag.xyz("Vector3", *pose.position),
            rotation=bag.turn(pose),
        )
        header = bag.header(0.0, parent)
        made.append(
            bag.make(
                "geometry_msgs/TransformStamped", header=header, child_frame_id=child, transform=transform
            )
        )
    return bag.make("tf2_msgs/TFMessage", transforms=made)


def imu(bag, seconds, force, rate=(0.0, 0.0, 0.0), frame="imu"):
    turn = bag.make("geometry_msgs/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    return bag.make(
        "sensor_msgs/Imu",
        header=bag.header(seconds, frame),
        orientation=turn,
        orientation_covariance=np.array([-1.0] + [0.0] * 8),
        angular_velocity=bag.xyz("Vector3", *rate),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=bag.xyz("Vector3", *force),
        linear_acceleration_covariance=np.zeros(9),
    )


def fix(bag, seconds, place, *, status=0, variances=None, kind=None, lift=0.0):
    """variances: of east, north, up [m2]; kind: of the covariance; lift: of the height [m]"""
    message = bag.fix(seconds, place, status)
    message.altitude += lift
    if variances is not None:
        message.position_covariance[::4] = variances
    message.position_covariance_type = (0 if variances is None else 2) if kind is None else kind
    return message


def cloud(bag, seconds, points, *columns, frame="laser"):
    """A PointCloud2 of points (n, 3) with more columns, (name, kind, values) each."""
    every = [(n, "f4", points[:, k]) for k, n in enumerate("xyz")] + list(columns)
    table = np.zeros(len(points), dtype=[(name, "<" + kind) for name, kind, _ in every])
    for name, _, values in every:
        table[name] = values
    fields = [
        bag.make(
            "sensor_msgs/PointField", name=n, offset=table.dtype.fields[n][1], datatype=CODES[k], count=1
        )
        for n, k, _ in every
    ]
    return bag.make(
        "sensor_msgs/PointCloud2",
        header=bag.header(seconds, frame),
        height=1,
        width=len(table),
        fields=fields,
        is_bigendian=False,
        point_step=table.dtype.itemsize,
        row_step=table.nbytes,
        data=np.frombuffer(table.tobytes(), np.uint8),
        is_dense=True,
    )


def stamp_ns(seconds):
    return BEGIN + round(seconds * NS)


def step_seen(x, height=2.5, count=241):
    """Points of a sweep that begins at x of a machine at 3 m/s, before a step of 1 m at WALL; times [s].

    Each point is exact at the moment when its beam goes out; the sensor is `height` above ground.
    """
    late = np.arange(count) / count / RATE_HZ
    azimuth = (-60.0 + 120.0 * np.arange(count) / (count - 1)) * DEG
    points, times = [], []
    for elevation in np.array([-8.0, -14.0, -20.0, -28.0, -38.0]) * DEG:
        way = np.stack(
            [
                np.cos(elevation) * np.cos(azimuth),
                np.cos(elevation) * np.sin(azimuth),
                np.full(count, np.sin(elevation)),
            ],
            axis=1,
        )
        ahead = x + 3.0 * late
        wall = (WALL - ahead) / way[:, 0]
        hit = height + wall * way[:, 2]
        top = (height - 1.0) / -way[:, 2]
        far = np.where((hit >= 0.0) & (hit <= 1.0), wall, height / -way[:, 2])
        far = np.where((ahead + top * way[:, 0] > WALL) & (hit > 1.0), top, far)
        good = ahead < WALL - 0.5
        points.append((way * far[:, None])[good])
        times.append(late[good])
    return np.concatenate(points), np.concatenate(times)


def heading_for_a_wall(
    path, columns, *, links=None, child="base_link", height=2.5, pose_z=0.0, clocks=(float, float)
):
    """A turning head on a machine that drives 4.5 s at 3 m/s towards a step.

    columns: of stamp [ns] and times after it [s] to (name, kind, values); links: of /tf_static; child: frame
    whose poses the odometry gives, pose_z above the ground [m]; clocks: stamps of poses, sweeps [s]
    """
    bag = Bag(path, "mcap")
    links = links or [("base_link", "laser", Pose.from_euler((0.0, 0.0, height)))]
    bag.write("/tf_static", 0.0, tree(bag, *links))
    for k in range(451):
        t = 0.01 * k
        odometry = bag.odometry(clocks[0](t), Pose.from_euler((3.0 * t, 0.0, pose_z)), 3.0, 0.0)
        odometry.child_frame_id = child
        bag.write("/odom", t, odometry)
        if k % 10 == 0:
            points, late = step_seen(3.0 * t, height)
            if len(points):
                stamp = clocks[1](t)
                made = cloud(bag, stamp, points, *columns(stamp_ns(stamp), late))
                bag.write("/points", t + 1.0 / RATE_HZ, made)
    bag.close()
    return path


def drive(path, *, links=(), seconds=10.0, fixes=None, force=None, rate_hz=10.0, odometry=None):
    """The drive of `bags.py` by odometry (50 Hz), receiver and inertial unit (100 Hz).

    fixes(bag, t, place): a message; force(t): specific force in the unit's axes [m/s2]
    odometry(bag, t): a message in the place of the usual one
    """
    bag = Bag(path, "mcap")
    if links:
        bag.write("/tf_static", 0.0, tree(bag, *links))
    for k in range(round(seconds * 100) + 1):
        t = 0.01 * k
        x, y = START[0] + SPEED * t, START[1]
        if k % 2 == 0:
            usual = bag.odometry(t, Pose.from_euler((x, y, 0.0)), SPEED, 0.0)
            bag.write("/odom", t, usual if odometry is None else odometry(bag, t))
        if fixes is not None and k % round(100 / rate_hz) == 0:
            bag.write("/fix", t, fixes(bag, t, (x + ANTENNA[0], y, ANTENNA[2])))
        if force is not None:
            bag.write("/imu", t, imu(bag, t, force(t)))
    bag.close()
    return path
