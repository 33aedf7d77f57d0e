"""Samples of a satellite receiver and of an inertial unit from their messages, for a time [ns] each."""

from collections.abc import Callable
from math import atan2, hypot, nan, radians, sqrt
from typing import Any

import numpy as np

from swath.record.messages import UNKNOWN
from swath.record.read.fields import Maker, Makers, stamp_of
from swath.record.read.tangent_plane import TangentPlane
from swath.signals import F64, FIX_QUALITIES, Fix, Inertial

# Horizontal sd up to which a position is called so, where a message does not say [m]
CALLED = (("fix", 0.05), ("float", 0.3), ("dgps", 1.0))
DIFFERENTIAL = {-1: "none", 0: "single", 1: "dgps"}  # of NavSatStatus; above, the sd decides


class FixOfNavSat:
    """NavSatFix -> Fix without speed. to_local: to the world's metres; None = plane at the first position."""

    def __init__(self, to_local: Callable[[F64], F64] | None = None) -> None:
        self._to_local = to_local

    def __call__(self, message: Any, t: int) -> Fix:
        """One sample; a height that is not known counts as 0."""
        status = int(message.status.status)
        quality = DIFFERENTIAL.get(status)
        up = float(message.altitude)
        place = np.array([[message.longitude, message.latitude, up if np.isfinite(up) else 0.0]], dtype=float)
        if status < 0 or not np.isfinite(place).all():
            return Fix(t, nan, nan, nan, nan, nan, nan, nan, nan, 0)
        if self._to_local is None:
            self._to_local = TangentPlane(*place[0].tolist())
        x, y, z = (float(v) for v in self._to_local(place)[0])
        wide = high = nan
        if message.position_covariance_type > 0:
            wide, high = _sd(message.position_covariance[::4])
        called = quality or ("fix" if not wide > CALLED[0][1] else "float")
        earth = radians(place[0, 0]), radians(place[0, 1]), float(place[0, 2])
        return Fix(t, x, y, z, nan, nan, wide, high, nan, FIX_QUALITIES.index(called), *earth)


def fix_of_odometry(message: Any, t: int) -> Fix:
    """Position and speed; the course is the heading of the pose, where its variance says that it is known."""
    at, motion = message.pose.pose.position, message.twist.twist.linear
    wide, high = _sd(message.pose.covariance[:15:7])
    q = message.pose.pose.orientation
    course = atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    called = next((name for name, limit in CALLED if wide <= limit), "single")
    return Fix(
        t,
        float(at.x),
        float(at.y),
        float(at.z),
        hypot(motion.x, motion.y),
        course if message.pose.covariance[35] < UNKNOWN else nan,
        wide,
        high,
        sqrt(message.twist.covariance[0]),
        FIX_QUALITIES.index(called),
    )


def inertial_of_imu(message: Any, t: int) -> Inertial:
    """Rates and forces; the orientation, which few units have, is left out."""
    rate, force = message.angular_velocity, message.linear_acceleration
    variances = message.angular_velocity_covariance[0], message.linear_acceleration_covariance[0]
    return Inertial(
        t,
        *(float(v) for v in (rate.x, rate.y, rate.z, force.x, force.y, force.z)),
        *(sqrt(max(float(v), 0.0)) for v in variances),
    )


def _sd(variances: Any) -> tuple[float, float]:
    """(Horizontal, vertical) sd of an axis [m] from the variances of east, north and up."""
    east, north, up = (max(float(v), 0.0) for v in variances)
    return sqrt(0.5 * (east + north)), sqrt(up)


def _stamped(make: Maker) -> Maker:
    return lambda message, t: make(message, stamp_of(message, t))


MAKERS: Makers = {
    (Fix, "NavSatFix"): lambda context: _stamped(FixOfNavSat(context.to_local)),
    (Fix, "Odometry"): lambda context: _stamped(fix_of_odometry),
    (Inertial, "Imu"): lambda context: _stamped(inertial_of_imu),
}
