"""Messages of a satellite receiver and of an inertial unit.

Of a receiver: sensor_msgs/NavSatFix, and nav_msgs/Odometry in the world's own metres. Of a unit:
sensor_msgs/Imu.

The Odometry stands in `map`; its child frame `<machine>/gnss_course` lies at the antenna with x along the way
it goes, so its twist is the speed over ground. It is in no /tf.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from swath.core.frames import Pose
from swath.signals import F64, FIX_QUALITIES, Fix, Inertial

UNKNOWN = 1e6  # variance of what a receiver does not know
STATUS = {"none": -1, "single": 0, "dgps": 1, "float": 2, "fix": 2}  # sensor_msgs/NavSatStatus
GPS = 1  # NavSatStatus.SERVICE_GPS
BESIDE = "_odometry"  # what the topic of the Odometry ends with


def fix_messages(file: Any, fix: Fix, frame: str, *, is_on_earth: bool) -> Iterator[tuple[str, Any]]:
    """(ending of the topic, message) of a fix; without one the Odometry is nan and not to be sent.

    file: McapFile; frame: of the antenna

    is_on_earth: the field has a geodetic origin
    """
    if is_on_earth or np.isfinite(fix.latitude):
        yield "", _nav_sat_fix(file, fix, frame)
    yield BESIDE, _odometry(file, fix, f"{frame}_course")


def _nav_sat_fix(file: Any, fix: Fix, frame: str) -> Any:
    """Without a fix its position is nan, as drivers have it."""
    is_known = fix.horizontal_sd > 0.0
    variances = (fix.horizontal_sd**2, fix.horizontal_sd**2, fix.vertical_sd**2)
    return file.make(
        "sensor_msgs/msg/NavSatFix",
        header=file.header(fix.t, frame),
        status=file.make(
            "sensor_msgs/msg/NavSatStatus", status=STATUS[FIX_QUALITIES[fix.quality]], service=GPS
        ),
        latitude=float(np.degrees(fix.latitude)),
        longitude=float(np.degrees(fix.longitude)),
        altitude=float(fix.height),
        position_covariance=np.diag(variances).ravel() if is_known else np.zeros(9),
        position_covariance_type=2 if is_known else 0,  # DIAGONAL_KNOWN, UNKNOWN
    )


def _odometry(file: Any, fix: Fix, child: str) -> Any:
    has_course = bool(np.isfinite(fix.course))
    turn = (fix.speed_sd / fix.speed) ** 2 if has_course else UNKNOWN
    place = Pose.from_euler((fix.x, fix.y, fix.z), yaw=fix.course if has_course else 0.0)
    across = fix.horizontal_sd**2
    speed = file.make("geometry_msgs/msg/Twist", linear=file.vector(fix.speed), angular=file.vector())
    moving = fix.speed_sd**2
    return file.make(
        "nav_msgs/msg/Odometry",
        header=file.header(fix.t, "map"),
        child_frame_id=child,
        pose=file.make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=file.pose(place),
            covariance=_diagonal(across, across, fix.vertical_sd**2, UNKNOWN, UNKNOWN, turn),
        ),
        twist=file.make(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=speed,
            covariance=_diagonal(moving, moving, UNKNOWN, UNKNOWN, UNKNOWN, UNKNOWN),
        ),
    )


def imu_message(file: Any, sample: Inertial, frame: str) -> Any:
    """sensor_msgs/Imu, gravity included (REP 145); it knows no orientation. frame: of the unit"""
    return file.make(
        "sensor_msgs/msg/Imu",
        header=file.header(sample.t, frame),
        orientation=file.quaternion(Pose.identity()),
        orientation_covariance=np.array([-1.0] + [0.0] * 8),  # there is none
        angular_velocity=file.vector(sample.rate_x, sample.rate_y, sample.rate_z),
        angular_velocity_covariance=_diagonal(*[sample.rate_sd**2] * 3),
        linear_acceleration=file.vector(sample.force_x, sample.force_y, sample.force_z),
        linear_acceleration_covariance=_diagonal(*[sample.force_sd**2] * 3),
    )


def _diagonal(*variances: float) -> F64:
    return np.diag(np.array(variances, dtype=float)).ravel()
