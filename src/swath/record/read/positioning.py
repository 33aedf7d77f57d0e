"""Samples of a satellite receiver and of an inertial unit from their messages, for a time [ns] each."""

from functools import partial
from math import atan2, hypot, isfinite, nan, radians, sqrt
from typing import Any

import numpy as np

from swath.record.message_factory import UNKNOWN
from swath.record.read.fields import Context, Maker, Makers
from swath.record.read.fixes import TangentPlane, has_fix, place_of
from swath.signals import FIX_QUALITIES, Fix, Inertial

# Horizontal sd up to which a position is called so [m]
CALLED = (("fix", 0.05), ("float", 0.3), ("dgps", 1.0))
CLAIMED = {-1: "none", 0: "single", 1: "dgps", 2: "dgps"}  # by a NavSatStatus, at least


class FixOfNavSat:
    """NavSatFix -> Fix without speed.

    Many drivers leave the status at 0, or the covariance away: what the receiver says of its accuracy decides
    on the quality, else what its status claims at least.
    """

    def __init__(self, context: Context) -> None:
        self._to_local, self._note = context.to_local, context.note
        self._origin: tuple[float, float, float] | None = None  # where the context has none

    def __call__(self, message: Any, t: int) -> Fix:
        """One sample; a height that is not known is nan."""
        place = np.array([place_of(message)])
        if not has_fix(message):
            return Fix(t, nan, nan, nan, nan, nan, nan, nan, nan, 0)
        x, y, z = (float(v) for v in (self._to_local or self._own_plane(*place[0].tolist()))(place)[0])
        wide = high = nan
        if message.position_covariance_type > 0:
            wide, high = _sd(message.position_covariance[::4])
        claimed = CLAIMED[min(int(message.status.status), 2)]
        if not isfinite(wide):
            self._note(f"derived: fixes without their accuracy, called {claimed} by their status")
        earth = radians(place[0, 0]), radians(place[0, 1]), float(place[0, 2])
        quality = max(FIX_QUALITIES.index(claimed), FIX_QUALITIES.index(called(wide)))
        return Fix(t, x, y, z, nan, nan, wide, high, nan, quality, *earth)

    def _own_plane(self, lon: float, lat: float, up: float) -> TangentPlane:
        """At the first position, in the first height that is known."""
        lon, lat, height = self._origin or (lon, lat, nan)
        self._origin = lon, lat, height if isfinite(height) else up
        return TangentPlane(lon, lat, float(np.nan_to_num(self._origin[2])))


def called(sd: float) -> str:
    """Quality of a position with that horizontal sd [m], `single` where it is not known."""
    return next((name for name, limit in CALLED if sd <= limit), "single")


def fix_of_odometry(context: Context, message: Any, t: int) -> Fix:
    """Position and speed; the course is the heading of the pose, where its variance says that it is known."""
    at, motion = message.pose.pose.position, message.twist.twist.linear
    wide, high = _sd(message.pose.covariance[:15:7])
    q = message.pose.pose.orientation
    course = atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    if not isfinite(wide):
        context.note("derived: fixes without their accuracy, called single")
    return Fix(
        t,
        float(at.x),
        float(at.y),
        float(at.z),
        hypot(motion.x, motion.y),
        course if 0.0 < message.pose.covariance[35] < UNKNOWN else nan,
        wide,
        high,
        _root(message.twist.covariance[0]),
        FIX_QUALITIES.index(called(wide)),
    )


def inertial_of_imu(message: Any, t: int) -> Inertial:
    """Rates and forces; the orientation, which few units have, is left out."""
    rate, force = message.angular_velocity, message.linear_acceleration
    variances = message.angular_velocity_covariance[0], message.linear_acceleration_covariance[0]
    return Inertial(
        t,
        *(float(v) for v in (rate.x, rate.y, rate.z, force.x, force.y, force.z)),
        *(_root(v) for v in variances),
    )


def _sd(variances: Any) -> tuple[float, float]:
    """(Horizontal, vertical) sd of an axis [m] from the variances of east, north and up."""
    east, north, up = (_root(v) for v in variances)
    return sqrt(0.5 * (east**2 + north**2)), up


def _root(variance: Any) -> float:
    """Standard deviation; nan for 0 and less: REP 145 and NavSatFix have 0 for what is not known."""
    return sqrt(float(variance)) if variance > 0.0 else nan


def _stamped(context: Context, make: Maker) -> Maker:
    return lambda message, t: make(message, context.stamp(message, t))


MAKERS: Makers = {
    (Fix, "NavSatFix"): lambda context: _stamped(context, FixOfNavSat(context)),
    (Fix, "Odometry"): lambda context: _stamped(context, partial(fix_of_odometry, context)),
    (Inertial, "Imu"): lambda context: _stamped(context, inertial_of_imu),
}
