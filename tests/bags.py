"""Real bags of ROS 1 and ROS 2, written by rosbags: a machine drives past a low wall.

10 s, 2 m/s east from (3, -1), a scanner on top that looks ahead and down; all on one clock, of 2024.
"""

import numpy as np

from swath.core.frames import Pose
from swath.core.units import DEG
from swath.record.read.fixes import TangentPlane

NS = 1_000_000_000
BEGIN = 1_722_600_000 * NS + 123_456_789
PLANE = TangentPlane(11.5, 48.2, 500.0)
MOUNT = Pose.from_euler((1.0, 0.0, 2.0), pitch=30 * DEG)
AZIMUTH = np.linspace(-30, 30, 61) * DEG
SPEED, START, SECONDS = 2.0, (3.0, -1.0), 10.0
KINDS = ("rosbag1", "sqlite", "mcap")
TYPES = {
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "ackermann_msgs/msg/AckermannDrive": "float32 steering_angle\nfloat32 steering_angle_velocity\n"
    "float32 speed\nfloat32 acceleration\nfloat32 jerk\n",
    "ackermann_msgs/msg/AckermannDriveStamped": "std_msgs/Header header\n"
    "ackermann_msgs/AckermannDrive drive\n",
}


def on_earth(local):
    """East, north, up of PLANE [m], (n, 3), as longitude, latitude [deg] and height [m], iterated."""
    local = np.asarray(local, dtype=float).reshape(-1, 3)
    scale = np.array([1.0 / (6.39e6 * np.cos(PLANE.lat * DEG)), 1.0 / 6.39e6]) / DEG
    points = np.array([[PLANE.lon, PLANE.lat, PLANE.height]])
    for _ in range(20):
        off = local - PLANE(points)
        points = points + np.column_stack([off[:, :2] * scale, off[:, 2]])
    return points


def ranges_at(x, y):
    """What the scanner measures there: ground at 0, a wall 0.8 m high to the right of y = -1.3."""
    d = MOUNT.turn(np.stack([np.cos(AZIMUTH), np.sin(AZIMUTH), 0 * AZIMUTH], axis=1))
    top, ground = (2.0 - 0.8) / -d[:, 2], 2.0 / -d[:, 2]
    with np.errstate(divide="ignore"):
        wall = np.where(d[:, 1] < 0, (-1.3 - y) / np.minimum(d[:, 1], -1e-9), np.inf)
    return np.where(wall > ground, ground, np.where(wall > top, wall, top)).astype(np.float32)


class Bag:
    """One bag of a kind; `write` by topic, time since the beginning and a made message."""

    def __init__(self, path, kind):
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import StoragePlugin
        from rosbags.rosbag2 import Writer as Writer2
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.is1 = kind == "rosbag1"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.is1 else Stores.ROS2_HUMBLE)
        for name, text in TYPES.items():
            if name not in self.store.types:
                self.store.register(get_types_from_msg(text, name))
        plugin = {"sqlite": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}.get(kind)
        self.writer = Writer1(path) if self.is1 else Writer2(path, version=8, storage_plugin=plugin)
        self.writer.open()
        self.connections = {}

    def write(self, topic, seconds, message):
        kind = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        data = (
            self.store.serialize_ros1(message, kind) if self.is1 else self.store.serialize_cdr(message, kind)
        )
        self.writer.write(self.connections[topic], BEGIN + round(seconds * NS), data)

    def close(self):
        self.writer.close()

    def make(self, kind, /, **values):
        package, _, rest = kind.partition("/")
        return self.store.types[f"{package}/msg/{rest}"](**values)

    def header(self, seconds, frame):
        sec, nanosec = divmod(BEGIN + round(seconds * NS), NS)
        stamp = self.make("builtin_interfaces/Time", sec=int(sec), nanosec=int(nanosec))
        return self.make("std_msgs/Header", **({"seq": 0} if self.is1 else {}), stamp=stamp, frame_id=frame)

    def xyz(self, kind, *values):
        return self.make(f"geometry_msgs/{kind}", **dict(zip("xyz", map(float, values), strict=True)))

    def turn(self, pose):
        x, y, z, w = pose.quaternion()
        return self.make("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w)

    def pose(self, pose):
        return self.make(
            "geometry_msgs/Pose", position=self.xyz("Point", *pose.position), orientation=self.turn(pose)
        )

    def twist(self, speed, yaw_rate):
        return self.make(
            "geometry_msgs/Twist",
            linear=self.xyz("Vector3", speed, 0, 0),
            angular=self.xyz("Vector3", 0, 0, yaw_rate),
        )

    def odometry(self, seconds, pose, speed, yaw_rate):
        blank = np.zeros(36)
        return self.make(
            "nav_msgs/Odometry",
            header=self.header(seconds, "odom"),
            child_frame_id="base_link",
            pose=self.make("geometry_msgs/PoseWithCovariance", pose=self.pose(pose), covariance=blank),
            twist=self.make(
                "geometry_msgs/TwistWithCovariance", twist=self.twist(speed, yaw_rate), covariance=blank
            ),
        )

    def fix(self, seconds, place, status=0):
        lon, lat, up = on_earth(np.array([place]))[0]
        return self.make(
            "sensor_msgs/NavSatFix",
            header=self.header(seconds, "gps"),
            status=self.make("sensor_msgs/NavSatStatus", status=status, service=1),
            latitude=lat,
            longitude=lon,
            altitude=up,
            position_covariance=np.zeros(9),
            position_covariance_type=0,
        )

    def laser(self, seconds, ranges):
        return self.make(
            "sensor_msgs/LaserScan",
            header=self.header(seconds, "laser"),
            angle_min=float(AZIMUTH[0]),
            angle_max=float(AZIMUTH[-1]),
            angle_increment=float(AZIMUTH[1] - AZIMUTH[0]),
            time_increment=0.0001,
            scan_time=0.04,
            range_min=0.1,
            range_max=80.0,
            ranges=ranges,
            intensities=np.full(len(ranges), 128.0, np.float32),
        )

    def cloud(self, seconds, ranges):
        """As a driver of a rotating scanner publishes it."""
        kinds = [
            ("x", "<f4"),
            ("y", "<f4"),
            ("z", "<f4"),
            ("intensity", "<f4"),
            ("ring", "<u2"),
            ("time", "<f4"),
        ]
        table = np.zeros(len(ranges), dtype=np.dtype(kinds, align=True))
        table["x"], table["y"] = ranges * np.cos(AZIMUTH), ranges * np.sin(AZIMUTH)
        table["intensity"], table["time"] = 128.0, 0.0001 * np.arange(len(ranges))
        codes = {"<f4": 7, "<u2": 4}
        fields = [
            self.make(
                "sensor_msgs/PointField", name=n, offset=table.dtype.fields[n][1], datatype=codes[k], count=1
            )
            for n, k in kinds
        ]
        return self.make(
            "sensor_msgs/PointCloud2",
            header=self.header(seconds, "laser"),
            height=1,
            width=len(table),
            fields=fields,
            is_bigendian=False,
            point_step=table.dtype.itemsize,
            row_step=table.nbytes,
            data=np.frombuffer(table.tobytes(), np.uint8),
            is_dense=True,
        )

    def mounting(self):
        transform = self.make(
            "geometry_msgs/Transform",
            translation=self.xyz("Vector3", *MOUNT.position),
            rotation=self.turn(MOUNT),
        )
        stamped = self.make(
            "geometry_msgs/TransformStamped",
            header=self.header(0.0, "base_link"),
            child_frame_id="laser",
            transform=transform,
        )
        return self.make("tf2_msgs/TFMessage", transforms=[stamped])


def place_at(seconds):
    return START[0] + SPEED * seconds, START[1]


def write_bag(path, kind, *, gap=(99.0, 99.0)):
    """The drive. gap: (begin, end) without odometry [s]."""
    bag = Bag(path, kind)
    bag.write("/tf_static", 0.0, bag.mounting())
    for k in range(int(SECONDS * 50) + 1):
        t = 0.02 * k
        x, y = place_at(t)
        if not gap[0] < t < gap[1]:
            bag.write("/odom", t, bag.odometry(t, Pose.from_euler((x, y, 0.0)), SPEED, 0.0))
        if k % 5 == 0:
            bag.write("/gps/fix", t + 0.004, bag.fix(t, (x - 1.2, y, 3.9)))  # received 4 ms later
            drive = bag.make(
                "ackermann_msgs/AckermannDrive",
                steering_angle=0.1, steering_angle_velocity=0.0, speed=2.5, acceleration=0.0, jerk=0.0,
            )  # fmt: skip
            header = bag.header(t, "base_link")
            bag.write(
                "/drive", t, bag.make("ackermann_msgs/AckermannDriveStamped", header=header, drive=drive)
            )
            twist = bag.make("geometry_msgs/TwistStamped", header=header, twist=bag.twist(1.5 + 0.1 * t, 0.2))
            bag.write("/speed", t, twist)
            bag.write("/curvature", t, bag.make("std_msgs/Float64", data=5.0 + t))
        if k % 2 == 0:
            ranges = ranges_at(x, y)
            bag.write("/scan", t + 0.0065, bag.laser(t, ranges))
            bag.write("/points", t + 0.0065, bag.cloud(t, ranges))
    bag.close()
    return path
