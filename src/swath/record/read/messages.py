"""From ROS messages to samples: which message can stand for which sample, and what is made of it.

| sample | messages |
|---|---|
| Scan | LaserScan, PointCloud2 |
| ScanTruth | PointCloud2 with `beam` and `echo` |
| MachineState | Odometry, PoseStamped, PoseWithCovarianceStamped, NavSatFix (`fixes.py`) |
| Odometry | Odometry, TwistStamped, Twist |
| Fix | NavSatFix, Odometry (`positioning.py`) |
| Inertial | Imu |
| SpeedCommand | TwistStamped, Twist, AckermannDriveStamped, AckermannDrive, Float64, Float32 |
| SteerState, SteerCommand | AckermannDriveStamped, AckermannDrive, Float64, Float32 |
| any | swath_msgs/<its name> |

Steering angles and turn rates follow from each other by the kinematic single track: tan(angle) = wheelbase *
yaw rate / speed (Rajamani, Vehicle Dynamics and Control, eq. 2.4 without slip).
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from math import atan2, tan
from typing import Any, get_type_hints

import numpy as np
from numpy.typing import NDArray

from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.record.read import positioning
from swath.signals import (
    F32,
    F64,
    Fix,
    Inertial,
    MachineState,
    Odometry,
    Scan,
    ScanTruth,
    Signal,
    SpeedCommand,
    SteerCommand,
    SteerState,
)

Maker = Callable[[Any, int], Signal]  # (message, log time [ns]) -> sample on the clock of the log
POINT_KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}  # PointField
# Names that drivers give to the time of a point: -> its unit [s], and whether it counts from the stamp.
POINT_TIMES = {
    "time": (1.0, True),
    "t": (1e-9, True),
    "offset_time": (1e-9, True),
    "timestamp": (1.0, False),
    "time_stamp": (1.0, True),
}
BRIGHTNESS = ("intensity", "reflectivity", "i")
CLOCKS_AGREE = 60 * NS  # a stamp this far from the log time is on another clock
STANDING = 0.05  # below this speed a turn rate says nothing about the steering [m/s]


@dataclass(frozen=True)
class Context:
    """wheelbase [m] of the machine that the samples are for.

    to_local: (n, 3) longitude, latitude [deg], height [m] -> (n, 3) east, north, up [m]; None: the plane at
    the first position
    """

    wheelbase: float
    to_local: Callable[[F64], F64] | None = None


def maker_for(signal: type[Signal], msgtype: str, context: Context) -> Maker | None:
    """What makes samples of a type from messages of a type; None where nothing does."""
    package, _, name = msgtype.partition("/msg/")
    if package == "swath_msgs" and name == signal.__name__:
        return lambda message, t: _of_own(signal, message, t)
    make = MAKERS.get((signal, name)) if package in PACKAGES else None
    return None if make is None else make(context)


def message_names(signal: type[Signal]) -> list[str]:
    """Messages that a sample can be made from."""
    return [name for kind, name in MAKERS if kind is signal] + [f"swath_msgs/{signal.__name__}"]


def stamp_of(message: Any, t: int) -> int:
    """When it was measured: the stamp [ns] where it is on the clock of the log, else the log time `t`."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return t
    own = int(stamp.sec) * NS + int(stamp.nanosec)
    return min(own, t) if abs(own - t) < CLOCKS_AGREE else t


def number_at(message: Any, path: str) -> float:
    """A number in a message, such as `twist.linear.x` or `data.3`. AttributeError where there is none."""
    value = message
    for part in path.split("."):
        try:
            value = value[int(part)] if part.isdigit() else getattr(value, part)
        except (IndexError, TypeError) as error:
            raise AttributeError(path) from error
    return float(value)


def pose_of(pose: Any) -> Pose:
    """geometry_msgs/Pose; a quaternion that is not a unit one is scaled."""
    return _pose(pose.position, pose.orientation)


def pose_of_transform(transform: Any) -> Pose:
    """geometry_msgs/Transform."""
    return _pose(transform.translation, transform.rotation)


def _pose(position: Any, turn: Any) -> Pose:
    q = np.array([turn.x, turn.y, turn.z, turn.w], float)
    x, y, z, w = q / max(float(np.linalg.norm(q)), 1e-12)
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return Pose(np.array([position.x, position.y, position.z], float), rotation)


def cloud_table(message: Any) -> NDArray[np.void]:
    """sensor_msgs/PointCloud2 as a table with a column per field. ValueError where it is too short."""
    names = {f.name: f for f in message.fields}
    order = ">" if message.is_bigendian else "<"
    layout = np.dtype(
        {
            "names": list(names),
            "formats": [order + POINT_KINDS[f.datatype] for f in names.values()],
            "offsets": [f.offset for f in names.values()],
            "itemsize": message.point_step,
        }
    )
    count = message.width * message.height
    return np.frombuffer(np.asarray(message.data).tobytes(), dtype=layout, count=count)


def _scan_of_laser(message: Any, t: int) -> Scan:
    """Stamp of the first beam; ranges outside its limits, inf and 0 are no echo."""
    count = len(message.ranges)
    first = stamp_of(message, t)
    beam = np.arange(count)
    late = np.asarray(beam * float(message.time_increment), dtype=np.float64)
    end = min(first + round(float(late[-1]) * NS), t) if count else first
    ranges = np.array(message.ranges, dtype=np.float32)
    with np.errstate(invalid="ignore"):
        good = np.isfinite(ranges) & (ranges >= message.range_min) & (ranges <= message.range_max)
    intensity = np.array(message.intensities, dtype=np.float32)
    if len(intensity) != count:
        intensity = np.full(count, np.nan, dtype=np.float32)
    ranges[~good], intensity[~good] = np.nan, np.nan
    azimuth = np.asarray(float(message.angle_min) + beam * float(message.angle_increment), np.float64)
    return Scan(
        end,
        late - (late[-1] if count else 0.0),
        azimuth,
        np.zeros(count),
        ranges[:, None],
        intensity[:, None],
    )


def _scan_of_cloud(message: Any, t: int) -> Scan:
    """A beam per point, or per `beam` where there are several echoes; points at 0 or nan are left out."""
    table = cloud_table(message)
    names = table.dtype.names or ()
    points = np.stack([table[n].astype(np.float64) for n in "xyz"], axis=1)
    far = np.linalg.norm(points, axis=1)
    good = np.isfinite(far) & (far > 0.0)
    table, points, far = table[good], points[good], far[good]
    late = _point_times(table, stamp_of(message, t))
    bright = next((n for n in BRIGHTNESS if n in names), None)
    intensity = np.full(len(far), np.nan) if bright is None else table[bright].astype(np.float64)
    if "beam" in names and "echo" in names:
        beams, beam = np.unique(table["beam"], return_inverse=True)
        echo = table["echo"].astype(int)
    else:
        beams, beam, echo = np.arange(len(far)), np.arange(len(far)), np.zeros(len(far), dtype=int)
    shape = (len(beams), int(echo.max(initial=0)) + 1)
    ranges, light = np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32)
    ranges[beam, echo], light[beam, echo] = far, intensity
    azimuth, elevation, after = (np.zeros(len(beams)) for _ in range(3))
    azimuth[beam] = np.arctan2(points[:, 1], points[:, 0])
    elevation[beam] = np.arcsin(np.clip(points[:, 2] / far, -1.0, 1.0))
    after[beam] = late
    last = float(after.max(initial=-np.inf)) if len(beams) else 0.0
    end = stamp_of(message, t) + round(last * NS)
    return Scan(min(end, t), after - last, azimuth, elevation, ranges, light)


def _point_times(table: NDArray[np.void], stamp: int) -> F64:
    """Time of each point after the stamp [s]; 0 where the cloud does not say."""
    for name, (unit, is_relative) in POINT_TIMES.items():
        if name in (table.dtype.names or ()):
            value = table[name].astype(np.float64) * unit
            late = value if is_relative else value - stamp / NS
            return np.asarray(np.where(np.abs(late) < 10.0, late, 0.0))  # else it is on another clock
    return np.zeros(len(table))


def _truth_of_cloud(message: Any, t: int) -> ScanTruth:
    """Points as rounded to float32; where the sensor was is not in it: nan."""
    table = cloud_table(message)
    beam, echo = table["beam"].astype(int), table["echo"].astype(int)
    points = np.full((int(beam.max(initial=-1)) + 1, int(echo.max(initial=0)) + 1, 3), np.nan)
    points[beam, echo] = np.stack([table[n].astype(np.float64) for n in "xyz"], axis=1)
    return ScanTruth(stamp_of(message, t), points, np.full((len(points), 3), np.nan))


class _States:
    """MachineState from poses, with the way that was driven; speeds by difference where there are none."""

    def __init__(self, context: Context) -> None:
        self.context = context
        self.last: tuple[int, Pose] | None = None
        self.distance = 0.0

    def __call__(self, message: Any, t: int) -> MachineState:
        at, outer = stamp_of(message, t), message.pose
        pose = pose_of(outer.pose if hasattr(outer, "pose") else outer)
        ahead = side = turn = 0.0
        if self.last is not None and at > self.last[0]:
            before, dt = self.last[1], (at - self.last[0]) / NS
            moved = before.rotation.T @ (pose.position - before.position)
            self.distance += float(np.hypot(moved[0], moved[1]))
            ahead, side = float(moved[0]) / dt, float(moved[1]) / dt
            turned = before.rotation.T @ pose.rotation
            turn = float(np.arctan2(turned[1, 0], turned[0, 0])) / dt
        self.last = (at, pose)
        if (twist := getattr(message, "twist", None)) is not None:
            ahead, side, turn = _motion(twist.twist)
        steer = steer_angle(self.context.wheelbase, ahead, turn)
        return MachineState(at, pose, ahead, side, turn, steer, self.distance)


def steer_angle(wheelbase: float, speed: float, yaw_rate: float) -> float:
    """Equivalent steering angle of a turn [rad], > 0 left; nan while it stands."""
    if abs(speed) < STANDING:
        return float("nan")
    return atan2(wheelbase * yaw_rate, abs(speed)) * (1.0 if speed > 0 else -1.0)


def _motion(twist: Any) -> tuple[float, float, float]:
    """Forward and leftward speed [m/s], yaw rate [rad/s] of a geometry_msgs/Twist, stamped or not."""
    inner = getattr(twist, "twist", twist)
    return float(inner.linear.x), float(inner.linear.y), float(inner.angular.z)


def _odometry(context: Context) -> Maker:
    def make(message: Any, t: int) -> Odometry:
        speed, _, turn = _motion(getattr(message, "twist", message))
        return Odometry(stamp_of(message, t), speed, turn, steer_angle(context.wheelbase, speed, turn))

    return make


def _drive(message: Any) -> Any:
    return getattr(message, "drive", message)


def _of_own(signal: type[Signal], message: Any, t: int) -> Signal:
    """A swath_msgs message by its fields; arrays are flat there."""
    hints, values = get_type_hints(signal), {}
    for field in fields(signal):
        if field.name == "t" or not hasattr(message, field.name):
            continue
        value, hint = getattr(message, field.name), hints[field.name]
        if hint is Pose:
            value = pose_of(value)
        elif hint in (F64, F32):
            value = np.array(value, dtype=np.float32 if hint == F32 else np.float64)
        else:
            value = hint(value)
        values[field.name] = value
    return signal(stamp_of(message, t), **values)


def _stamped(make: Callable[[Any, int], Signal]) -> Maker:
    return lambda message, t: make(message, stamp_of(message, t))


def _speed(of: Callable[[Any], float]) -> Callable[[Context], Maker]:
    return lambda context: lambda message, t: SpeedCommand(stamp_of(message, t), float(of(message)))


def _steer_state(of: Callable[[Any], tuple[float, float]]) -> Callable[[Context], Maker]:
    return lambda context: lambda message, t: SteerState(stamp_of(message, t), *map(float, of(message)))


def _curvature(of: Callable[[Any, Context], float]) -> Callable[[Context], Maker]:
    return lambda context: (
        lambda message, t: SteerCommand(stamp_of(message, t), float(of(message, context)), True)
    )


PACKAGES = ("sensor_msgs", "nav_msgs", "geometry_msgs", "ackermann_msgs", "std_msgs", "example_interfaces")
MAKERS: dict[tuple[type[Signal], str], Callable[[Context], Maker]] = {
    (Scan, "LaserScan"): lambda context: _scan_of_laser,
    (Scan, "PointCloud2"): lambda context: _scan_of_cloud,
    (ScanTruth, "PointCloud2"): lambda context: _truth_of_cloud,
    (MachineState, "Odometry"): _States,
    (MachineState, "PoseStamped"): _States,
    (MachineState, "PoseWithCovarianceStamped"): _States,
    (Odometry, "Odometry"): _odometry,
    (Odometry, "TwistStamped"): _odometry,
    (Odometry, "Twist"): _odometry,
    (Fix, "NavSatFix"): lambda context: _stamped(positioning.FixOfNavSat(context.to_local)),
    (Fix, "Odometry"): lambda context: _stamped(positioning.fix_of_odometry),
    (Inertial, "Imu"): lambda context: _stamped(positioning.inertial_of_imu),
    (SpeedCommand, "TwistStamped"): _speed(lambda m: _motion(m)[0]),
    (SpeedCommand, "Twist"): _speed(lambda m: _motion(m)[0]),
    (SpeedCommand, "AckermannDriveStamped"): _speed(lambda m: _drive(m).speed),
    (SpeedCommand, "AckermannDrive"): _speed(lambda m: _drive(m).speed),
    (SteerState, "AckermannDriveStamped"): _steer_state(
        lambda m: (_drive(m).steering_angle, _drive(m).steering_angle_velocity)
    ),
    (SteerState, "AckermannDrive"): _steer_state(
        lambda m: (_drive(m).steering_angle, _drive(m).steering_angle_velocity)
    ),
    (SteerCommand, "AckermannDriveStamped"): _curvature(
        lambda m, c: tan(_drive(m).steering_angle) / c.wheelbase
    ),
    (SteerCommand, "AckermannDrive"): _curvature(lambda m, c: tan(_drive(m).steering_angle) / c.wheelbase),
    **{(SpeedCommand, name): _speed(lambda m: m.data) for name in ("Float64", "Float32")},
    **{(SteerState, name): _steer_state(lambda m: (m.data, 0.0)) for name in ("Float64", "Float32")},
    **{(SteerCommand, name): _curvature(lambda m, c: m.data) for name in ("Float64", "Float32")},
}
