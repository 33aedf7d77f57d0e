"""From samples to ROS 2 messages: which sample becomes which message, in which frame, on which topic.

The topic of an output is `/machine/slot/output`. Frames: `map` (world, ENU), `<machine>/base` (ISO 8855,
fixed axle on the ground), `<machine>/<sensor slot>`, `<machine>/<camera slot>_optical` (x right, y down, z
forward), `<machine>/odom` (the start pose). docs/run-folder.md is the table for users.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.frames import Pose, wrap_angle
from swath.core.schedule import NS
from swath.field.projection import Origin
from swath.field.track import EdgeShape
from swath.record.image_messages import picture_messages
from swath.record.mcap_file import McapFile
from swath.record.positioning_messages import BESIDE, fix_messages, imu_message
from swath.signals import (
    CropEdge,
    Fix,
    Image,
    Inertial,
    MachineState,
    Odometry,
    Scan,
    ScanTruth,
    Signal,
    SpeedCommand,
    SteerState,
)
from swath.signals.setup import MachineGeometry

POINT_FIELDS = (("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"))
# As the drivers of rotating scanners name and type them (velodyne_pointcloud: `ring`, `time`), then our own.
BEAM_FIELDS = (("time", "<f4"), ("beam", "<u4"), ("ring", "<u2"), ("echo", "<u2"))
ROS_KINDS = {"<f4": 7, "<u2": 4, "<u4": 6}  # sensor_msgs/PointField FLOAT32, UINT16, UINT32
OPTICAL_FRAME = "_optical"  # after the name of a camera's own frame, as REP 103 asks
FIX_PERIOD = 100_000_000  # between two NavSatFix [ns]
EDGE_BEHIND, EDGE_AHEAD = 4.0, 6.0  # drawn length of the edge line about its reference [m]


@dataclass(frozen=True)
class RecordedMachine:
    """What the recording needs to know of a machine.

    name: its key in the scenario; geometry: its data sheet; edge_side: `left` or `right`
    mounting: sensor slot (without the machine's name) -> pose_machine_sensor
    origin: where on Earth the world's origin lies, if that is known
    slots: that it has; edge: the initial edge that it follows
    """

    name: str
    geometry: MachineGeometry
    edge_side: str
    mounting: Mapping[str, Pose] = field(default_factory=dict)
    origin: Origin | None = None
    slots: tuple[str, ...] = ()
    edge: EdgeShape | None = None


class Messenger:
    """Writes the samples of one machine to a file as messages."""

    def __init__(self, machine: RecordedMachine, file: McapFile) -> None:
        self.machine, self.file = machine, file
        self._base = f"{machine.name}/base"
        self._odom: Pose | None = None
        self._odom_t = self._next_fix = 0
        self._started = False

    def write(self, slot: str, output: str, t: int, signal: Signal) -> None:
        """Write one sample published at t [ns] by `slot` (the part after the machine's name)."""
        topic = f"/{self.machine.name}/{slot.replace('.', '/')}/{output}"
        if isinstance(signal, MachineState):
            self._write_state(topic, t, signal)
        elif isinstance(signal, Scan):
            self._write_scan(topic, t, signal, f"{self.machine.name}/{slot}")
        elif isinstance(signal, Image):
            frame = f"{self.machine.name}/{slot}{OPTICAL_FRAME}"
            for place, message in picture_messages(self.file, topic, signal, frame):
                self.file.write(place, t, message)
        elif isinstance(signal, ScanTruth):
            points, beams = _flatten(signal.points)
            cloud = {"x": points[:, 0], "y": points[:, 1], "z": points[:, 2], **beams}
            self.file.write(topic, t, self._cloud(signal.t, "map", cloud))
        elif isinstance(signal, Odometry):
            self._write_odometry(topic, t, signal)
        elif isinstance(signal, Fix):
            frame, is_on_earth = f"{self.machine.name}/{slot}", self.machine.origin is not None
            for ending, message in fix_messages(self.file, signal, frame, is_on_earth=is_on_earth):
                if ending == BESIDE and signal.quality == 0:  # nothing to say, but it will come
                    self.file.announce(topic + ending, message)
                else:
                    self.file.write(topic + ending, t, message)
        elif isinstance(signal, Inertial):
            self.file.write(topic, t, imu_message(self.file, signal, f"{self.machine.name}/{slot}"))
        elif isinstance(signal, CropEdge):
            self.file.write(topic, t, self.file.of_signal(signal, self._base))
            self.file.write(f"{topic}_marker", t, self._edge_marker(signal))
        elif isinstance(signal, SteerState):
            self.file.write(topic, t, self._steering(signal))
        elif isinstance(signal, SpeedCommand):
            twist = self._twist(signal.speed, 0.0, 0.0)
            header = self.file.header(signal.t, self._base)
            self.file.write(
                topic, t, self.file.make("geometry_msgs/msg/TwistStamped", header=header, twist=twist)
            )
        else:
            self.file.write(topic, t, self.file.of_signal(signal, self._base))

    def _write_state(self, topic: str, t: int, state: MachineState) -> None:
        if not self._started:
            self._started = True
            frames = [self._transform(0, self._base, f"{self.machine.name}/{slot}", pose)
                      for slot, pose in self.machine.mounting.items()]  # fmt: skip
            frames.append(self._transform(0, "map", f"{self.machine.name}/odom", state.pose))
            tree = self.file.make("tf2_msgs/msg/TFMessage", transforms=frames)
            self.file.write("/tf_static", t, tree, is_latched=True)
        twist = self._twist(state.speed, state.lateral_speed, state.yaw_rate)
        self.file.write(topic, t, self._odometry(state.t, "map", state.pose, twist))
        moved = [self._transform(state.t, "map", self._base, state.pose)]
        self.file.write("/tf", t, self.file.make("tf2_msgs/msg/TFMessage", transforms=moved))
        if self.machine.origin is not None and "gnss" not in self.machine.slots and state.t >= self._next_fix:
            self._next_fix = state.t + FIX_PERIOD
            fix = self._fix(state, self.machine.origin)
            self.file.write(f"{topic.rpartition('/')[0]}/fix", t, fix)

    def _fix(self, state: MachineState, origin: Origin) -> Any:
        """sensor_msgs/NavSatFix of the true place; the height is that of the field's own zero."""
        x, y, z = state.pose.position
        longitude, latitude = origin.to_lon_lat([[x, y]])[0]
        return self.file.make(
            "sensor_msgs/msg/NavSatFix",
            header=self.file.header(state.t, self._base),
            status=self.file.make("sensor_msgs/msg/NavSatStatus", status=2, service=1),  # GBAS, GPS
            latitude=float(latitude),
            longitude=float(longitude),
            altitude=float(origin.height + z),
            position_covariance=np.zeros(9),
            position_covariance_type=0,  # unknown: it is the truth
        )

    def _write_odometry(self, topic: str, t: int, sample: Odometry) -> None:
        """Twist as measured; the pose is its dead reckoning from the start (midpoint rule), for viewing."""
        if self._odom is None:
            self._odom = Pose.identity()
        else:
            dt = (sample.t - self._odom_t) / NS
            turn, advance = sample.yaw_rate * dt, sample.speed * dt
            yaw = self._odom.euler()[2]
            middle = yaw + 0.5 * turn
            ahead = np.array([np.cos(middle), np.sin(middle), 0.0]) * advance
            self._odom = Pose.from_euler(self._odom.position + ahead, yaw=float(wrap_angle(yaw + turn)))
        self._odom_t = sample.t
        twist = self._twist(sample.speed, 0.0, sample.yaw_rate)
        frame = f"{self.machine.name}/odom"
        self.file.write(topic, t, self._odometry(sample.t, frame, self._odom, twist))

    def _write_scan(self, topic: str, t: int, scan: Scan, frame: str) -> None:
        is_plane = is_laser_scan(scan)
        if is_plane:
            self.file.write(topic, t, self._laser_scan(scan, frame))
        if not is_plane or scan.ranges.shape[1] > 1:
            points, beams = _flatten(scan.points())
            echo, beam = beams["echo"], beams["beam"]
            cloud: dict[str, NDArray[Any]] = {"x": points[:, 0], "y": points[:, 1], "z": points[:, 2]}
            cloud |= {"intensity": scan.intensity[beam, echo], "time": scan.beam_t[beam], **beams}
            cloud["ring"] = rings(scan)[beam]
            self.file.write(f"{topic}_points", t, self._cloud(scan.t, frame, cloud))

    def _laser_scan(self, scan: Scan, frame: str) -> Any:
        """sensor_msgs/LaserScan of the first echoes; no echo is +inf (REP 117)."""
        count = len(scan.azimuth)
        step = float(scan.azimuth[-1] - scan.azimuth[0]) / max(count - 1, 1)
        span = float(scan.beam_t[-1] - scan.beam_t[0])
        ranges = np.ascontiguousarray(scan.ranges[:, 0], dtype=np.float32)
        return self.file.make(
            "sensor_msgs/msg/LaserScan",
            header=self.file.header(scan.t + round(float(scan.beam_t[0]) * NS), frame),
            angle_min=float(scan.azimuth[0]),
            angle_max=float(scan.azimuth[-1]),
            angle_increment=step,
            time_increment=span / max(count - 1, 1),
            scan_time=span,
            range_min=0.0,
            range_max=1000.0,
            ranges=np.where(np.isnan(ranges), np.float32(np.inf), ranges),
            intensities=np.nan_to_num(np.ascontiguousarray(scan.intensity[:, 0], dtype=np.float32)),
        )

    def _cloud(self, t: int, frame: str, columns: Mapping[str, NDArray[Any]]) -> Any:
        """sensor_msgs/PointCloud2 of equally long columns."""
        layout = [(name, kind) for name, kind in (*POINT_FIELDS, *BEAM_FIELDS) if name in columns]
        table = np.zeros(len(columns["x"]), dtype=np.dtype(layout, align=True))
        for name, _ in layout:
            table[name] = columns[name]
        described = [
            self.file.make(
                "sensor_msgs/msg/PointField",
                name=name,
                offset=int(table.dtype.fields[name][1]),  # type: ignore[index]
                datatype=ROS_KINDS[kind],
                count=1,
            )
            for name, kind in layout
        ]
        return self.file.make(
            "sensor_msgs/msg/PointCloud2",
            header=self.file.header(t, frame),
            height=1,
            width=len(table),
            fields=described,
            is_bigendian=False,
            point_step=table.dtype.itemsize,
            row_step=table.nbytes,
            data=np.frombuffer(table.tobytes(), dtype=np.uint8),
            is_dense=True,
        )

    def _steering(self, state: SteerState) -> Any:
        drive = self.file.make(
            "ackermann_msgs/msg/AckermannDrive",
            steering_angle=float(state.angle),
            steering_angle_velocity=float(state.rate),
            speed=0.0,
            acceleration=0.0,
            jerk=0.0,
        )
        header = self.file.header(state.t, self._base)
        return self.file.make("ackermann_msgs/msg/AckermannDriveStamped", header=header, drive=drive)

    def _edge_marker(self, edge: CropEdge) -> Any:
        """visualization_msgs/Marker: the edge as a line on the ground, deleted when none is seen."""
        line: list[Any] = []
        if edge.is_found:
            heading = edge.heading if np.isfinite(edge.heading) else 0.0
            curvature = edge.curvature if np.isfinite(edge.curvature) else 0.0
            for ahead in np.linspace(-EDGE_BEHIND, EDGE_AHEAD, 11):
                y = edge.offset + np.tan(heading) * ahead + 0.5 * curvature * ahead**2
                line.append(self.file.point(edge.reference_x + ahead, y, 0.05))
        width = self.file.vector(0.06, 0.0, 0.0)
        colour = self.file.make("std_msgs/msg/ColorRGBA", r=0.84, g=0.37, b=0.0, a=1.0)
        never = self.file.make("builtin_interfaces/msg/Duration", sec=0, nanosec=0)
        empty = self.file.make("sensor_msgs/msg/CompressedImage", header=self.file.header(0, ""), format="",
                               data=np.zeros(0, np.uint8))  # fmt: skip
        mesh = self.file.make("visualization_msgs/msg/MeshFile", filename="", data=np.zeros(0, np.uint8))
        return self.file.make(
            "visualization_msgs/msg/Marker",
            header=self.file.header(edge.t, self._base),
            ns="crop_edge",
            id=0,
            type=4,  # LINE_STRIP
            action=0 if line else 2,  # ADD or DELETE
            pose=self.file.pose(Pose.identity()),
            scale=width,
            color=colour,
            lifetime=never,
            frame_locked=False,
            points=line,
            colors=[],
            texture_resource="",
            texture=empty,
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=mesh,
            mesh_use_embedded_materials=False,
        )

    def _odometry(self, t: int, frame: str, pose: Pose, twist: Any) -> Any:
        blank = np.zeros(36)
        return self.file.make(
            "nav_msgs/msg/Odometry",
            header=self.file.header(t, frame),
            child_frame_id=self._base,
            pose=self.file.make(
                "geometry_msgs/msg/PoseWithCovariance", pose=self.file.pose(pose), covariance=blank
            ),
            twist=self.file.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=blank),
        )

    def _transform(self, t: int, parent: str, child: str, pose: Pose) -> Any:
        transform = self.file.make(
            "geometry_msgs/msg/Transform",
            translation=self.file.vector(*pose.position),
            rotation=self.file.quaternion(pose),
        )
        return self.file.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.file.header(t, parent),
            child_frame_id=child,
            transform=transform,
        )

    def _twist(self, forward: float, leftward: float, yaw_rate: float) -> Any:
        linear, angular = self.file.vector(forward, leftward), self.file.vector(z=yaw_rate)
        return self.file.make("geometry_msgs/msg/Twist", linear=linear, angular=angular)


def is_laser_scan(scan: Scan) -> bool:
    """True when the beams lie in the sensor's x-y plane at even angles: what a LaserScan can say."""
    if len(scan.azimuth) < 2 or np.any(np.abs(scan.elevation) > 1e-9):
        return False
    steps = np.diff(scan.azimuth)
    return bool(np.all(np.abs(steps - steps.mean()) < 1e-3 * abs(steps.mean()) + 1e-12))


def rings(scan: Scan) -> NDArray[np.int64]:
    """The layer that each beam belongs to, 0 = the lowest, (beam_count,); all 0 for a single plane."""
    _, layer = np.unique(np.round(scan.elevation, 6), return_inverse=True)
    return np.asarray(layer, dtype=np.int64).reshape(-1)


def _flatten(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], dict[str, NDArray[np.int64]]]:
    """Echoes that exist, shape (n, 3), with the beam and echo number of each."""
    beam, echo = np.nonzero(np.isfinite(points[:, :, 0]))
    return points[beam, echo], {"beam": beam, "echo": echo}
