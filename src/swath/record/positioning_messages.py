"""Samples of a satellite receiver and of an inertial unit as ROS 2 messages."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from swath.core.frames import Pose
from swath.record.message_factory import EXACT, UNKNOWN, Draft, MessageFactory, Sent, Source, common
from swath.signals import F64, FIX_QUALITIES, Fix, Inertial, PoseEstimate

STATUS = {"none": -1, "single": 0, "dgps": 1, "float": 2, "fix": 2}  # sensor_msgs/NavSatStatus
GPS = 1  # NavSatStatus.SERVICE_GPS
BESIDE = "_odometry"  # what the topic of the Odometry ends with
INERTIAL = tuple(f"{name}.{axis}" for name in ("angular_velocity", "linear_acceleration") for axis in "xyz")


def fix_messages(source: Source, fix: Fix) -> Iterator[Sent]:
    """sensor_msgs/NavSatFix where the field lies on Earth, and nav_msgs/Odometry in the world's own metres.

    The Odometry stands in `map`; its child frame `<machine>/gnss_course` lies at the antenna with x along the
    way it goes, so its twist is the speed over ground. It is in no /tf; without a fix it is only announced.
    """
    if source.machine.origin is not None or np.isfinite(fix.latitude):
        yield Sent(source.topic, _nav_sat_fix(source, fix))
    yield Sent(source.topic + BESIDE, _odometry(source, fix), "" if fix.quality else "announced")


def imu_messages(source: Source, sample: Any) -> Iterator[Sent]:
    """sensor_msgs/Imu, gravity included (REP 145); it knows no orientation."""
    values = (sample.rate_x, sample.rate_y, sample.rate_z, sample.force_x, sample.force_y, sample.force_z)
    variant = common(sample.rate_sd), common(sample.force_sd)
    yield Sent(source.topic, Draft(sample.t, INERTIAL, values, lambda: _imu(source, sample), variant))


def pose_messages(source: Source, pose: PoseEstimate) -> Iterator[Sent]:
    """nav_msgs/Odometry in `map`, its child frame `<machine>/<slot>`; until it is known it is announced."""
    make, is_known = source.make, bool(np.isfinite(pose.x))
    place = Pose.from_euler((pose.x, pose.y, 0.0), yaw=pose.heading) if is_known else Pose.identity()
    spread = np.diag([UNKNOWN] * 6)
    spread[:2, :2] = pose.covariance[:2, :2]
    spread[5, [0, 1, 5]] = spread[[0, 1, 5], 5] = pose.covariance[2, :3]
    speed = np.diag([float(pose.covariance[3, 3]), *[UNKNOWN] * 5])
    twist = make.twist(pose.speed, yaw_rate=pose.yaw_rate)
    head = make.header(pose.t, "map")
    message = make.odometry(head, source.frame, place, twist, spread.ravel(), speed.ravel())
    yield Sent(source.topic, message, "" if is_known else "announced")


def _imu(source: Source, sample: Inertial) -> Any:
    """A sensor that does not know its noise has covariances of zeros: unknown, as REP 145 has it."""
    make = source.make
    least = EXACT if source.slot in source.machine.errors else 0.0
    rate, force = (max(sd**2, least) if sd >= 0.0 else 0.0 for sd in (sample.rate_sd, sample.force_sd))
    return make(
        "sensor_msgs/msg/Imu",
        header=make.header(sample.t, source.frame),
        orientation=make.quaternion(Pose.identity()),
        orientation_covariance=np.array([-1.0] + [0.0] * 8),  # there is none
        angular_velocity=make.vector(sample.rate_x, sample.rate_y, sample.rate_z),
        angular_velocity_covariance=_diagonal(*[rate] * 3),
        linear_acceleration=make.vector(sample.force_x, sample.force_y, sample.force_z),
        linear_acceleration_covariance=_diagonal(*[force] * 3),
    )


def _nav_sat_fix(source: Source, fix: Fix) -> Any:
    """Without a fix its position is nan, as drivers have it."""
    across, up = max(fix.horizontal_sd**2, EXACT), max(fix.vertical_sd**2, EXACT)
    place = np.degrees(fix.latitude), np.degrees(fix.longitude), fix.height
    spread = (across, across, up) if fix.quality else None
    status = STATUS[FIX_QUALITIES[fix.quality]]
    return nav_sat_fix(source.make, source.make.header(fix.t, source.frame), status, place, spread)


def nav_sat_fix(
    make: MessageFactory, header: Any, status: int, place: Sequence[float], spread: Sequence[float] | None
) -> Any:
    """sensor_msgs/NavSatFix.

    place: latitude, longitude [deg], height [m]
    spread: variances of east, north and up [m2], None without a fix
    """
    return make(
        "sensor_msgs/msg/NavSatFix",
        header=header,
        status=make("sensor_msgs/msg/NavSatStatus", status=status, service=GPS),
        **dict(zip(("latitude", "longitude", "altitude"), map(float, place), strict=True)),
        position_covariance=np.zeros(9) if spread is None else _diagonal(*spread),
        position_covariance_type=0 if spread is None else 2,  # UNKNOWN, DIAGONAL_KNOWN
    )


def _odometry(source: Source, fix: Fix) -> Any:
    has_course = bool(np.isfinite(fix.course))
    turn = max((fix.speed_sd / fix.speed) ** 2, EXACT) if has_course else UNKNOWN
    place = Pose.from_euler((fix.x, fix.y, fix.z), yaw=fix.course if has_course else 0.0)
    across, up, moving = (max(sd**2, EXACT) for sd in (fix.horizontal_sd, fix.vertical_sd, fix.speed_sd))
    return source.make.odometry(
        source.make.header(fix.t, "map"),
        f"{source.frame}_course",
        place,
        source.make.twist(fix.speed),
        _diagonal(across, across, up, UNKNOWN, UNKNOWN, turn),
        _diagonal(moving, moving, *[UNKNOWN] * 4),
    )


def _diagonal(*variances: float) -> F64:
    return np.diag(np.array(variances, dtype=float)).ravel()
