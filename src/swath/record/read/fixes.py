"""Positions of a GNSS receiver as a track of a machine: local metres, heading from the course.

Local metres are those of a field folder (its projected system and origin), or of the plane that touches the
ellipsoid at an origin: east, north, up from Earth-centred coordinates (WGS 84; Misra and Enge, Global
Positioning System, 2nd ed., ch. 4.A).
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import cos, radians, sin
from pathlib import Path
from typing import Any

import numpy as np

from swath.core import portable
from swath.core.errors import InputError
from swath.core.frames import Pose, wrap_angle
from swath.core.portable import product
from swath.core.schedule import NS
from swath.record.read.feed import Timed
from swath.record.read.fields import Context
from swath.record.read.motion import steer_angle
from swath.signals import F64, MachineState

AXIS = 6_378_137.0  # semi-major axis of WGS 84 [m]
FLATTENING = 1.0 / 298.257223563

ToLocal = Callable[[F64], F64]
"""Longitude, latitude [deg], height [m], (n, 3), as east, north, up [m], (n, 3); up nan where a height is."""


@dataclass(frozen=True)
class TangentPlane:
    """East, north and up from a point. lon, lat [deg], height above the ellipsoid [m]."""

    lon: float
    lat: float
    height: float = 0.0

    def __call__(self, points: F64) -> F64:
        """Longitude, latitude [deg] and height [m], (n, 3), as east, north, up [m], (n, 3)."""
        is_known = np.isfinite(points[:, 2])
        points = np.column_stack([points[:, :2], np.where(is_known, points[:, 2], self.height)])
        away = _earth_centred(points) - _earth_centred(self._origin)
        local = np.asarray(product(away, self._axes.T))
        local[~is_known, 2] = np.nan
        return local

    @property
    def _origin(self) -> F64:
        return np.array([[self.lon, self.lat, self.height]])

    @property
    def _axes(self) -> F64:
        """Rows: east, north, up in Earth-centred axes."""
        sl, cl = sin(radians(self.lon)), cos(radians(self.lon))
        sp, cp = sin(radians(self.lat)), cos(radians(self.lat))
        return np.array([[-sl, cl, 0.0], [-sp * cl, -sp * sl, cp], [cp * cl, cp * sl, sp]])


def field_plane(folder: Path) -> ToLocal:
    """The local metres of a field folder. InputError where it is none, MissingExtra without pyproj."""
    from swath.field_io.folder import read_origin

    origin = read_origin(folder)
    return lambda p: np.column_stack([origin.to_local(p[:, :2]), p[:, 2] - origin.height])


def _earth_centred(points: F64) -> F64:
    """Places from Earth's centre [m], (n, 3)."""
    lon, lat = np.radians(points[:, 0]), np.radians(points[:, 1])
    squared = FLATTENING * (2.0 - FLATTENING)
    across = AXIS / np.sqrt(1.0 - squared * np.sin(lat) ** 2)
    flat = (across + points[:, 2]) * np.cos(lat)
    up = (across * (1.0 - squared) + points[:, 2]) * np.sin(lat)
    return np.stack([flat * np.cos(lon), flat * np.sin(lon), up], axis=1)


COURSE_M = 1.0  # the heading is the course over at least this much way
NO_FIX = -1  # sensor_msgs/NavSatStatus.STATUS_NO_FIX


@dataclass(frozen=True)
class Fixes:
    """Positions of a receiver.

    published, t: log time and time of measurement [ns], (n,)
    place: lon, lat [deg], height [m], (n, 3)
    """

    published: np.ndarray
    t: np.ndarray
    place: F64


def place_of(message: Any) -> tuple[float, float, float]:
    """Longitude, latitude [deg] and height [m] of a NavSatFix, nan where it is not known."""
    lon, lat, up = float(message.longitude), float(message.latitude), float(message.altitude)
    return lon, lat, up if np.isfinite(up) else np.nan


def has_fix(message: Any) -> bool:
    """Whether a NavSatFix has a position: drivers send zeros before the first."""
    lon, lat, _ = place_of(message)
    is_on_earth = -180.0 <= lon <= 360.0 and abs(lat) <= 90.0 and not lon == lat == 0.0
    return int(message.status.status) > NO_FIX and is_on_earth


def read_fixes(messages: Iterable[tuple[str, int, Any]], context: Context) -> Fixes:
    """NavSatFix messages; those without a fix, or not later than the one before are left out.

    Heights that are not known are those between; without any, all lie in a plane. InputError when fewer than
    two positions are left.
    """
    rows: list[tuple[int, int, float, float, float]] = []
    for _, t, message in messages:
        at = context.stamp(message, t)
        if has_fix(message) and not (rows and at <= rows[-1][1]):
            rows.append((t, at, *place_of(message)))
    if len(rows) < 2:
        raise InputError("fixes", len(rows), "expected at least two positions at different times")
    times, place = np.array([r[:2] for r in rows], dtype=np.int64), np.array([r[2:] for r in rows])
    known = np.isfinite(place[:, 2])
    if not known.all():
        found = f"those of {known.sum()} others" if known.any() else "one plane, the terrain is not followed"
        context.note(f"heights: {(~known).sum()} positions without a height: put on {found}")
        seconds = (times[:, 1] - times[0, 1]) / NS
        place[:, 2] = np.interp(seconds, seconds[known], place[known, 2]) if known.any() else 0.0
    return Fixes(times[:, 0], times[:, 1], place)


def poses_of_fixes(
    fixes: Fixes, to_local: ToLocal | None, antenna: tuple[float, float, float]
) -> tuple[F64, F64]:
    """Positions (n, 3) [m] and headings (n,) [rad] of a machine that drives forward.

    The heading is the direction of a way of COURSE_M around each point, so it needs a machine that moves.
    to_local: None = the plane at the first fix; antenna: where it sits on the machine [m]
    """
    local = (to_local or TangentPlane(*fixes.place[0]))(fixes.place)
    step = np.hypot(*np.diff(local[:, :2], axis=0).T)
    distance = np.concatenate([[0.0], np.cumsum(step)])
    if not distance[-1] > 0.0:
        raise InputError("fixes", None, "expected a machine that moves, its heading is its course")
    reach = min(0.5 * COURSE_M, 0.5 * distance[-1])
    kept = np.concatenate([[True], step > 0.0])
    ends = [
        np.stack(
            [
                np.interp(np.clip(distance + s, 0.0, distance[-1]), distance[kept], local[kept, k])
                for k in range(2)
            ]
        )
        for s in (-reach, reach)
    ]
    ahead = ends[1] - ends[0]
    yaw = np.unwrap(portable.arctan2(ahead[1], ahead[0]))
    x, y, z = antenna
    turned = np.stack([np.cos(yaw) * x - np.sin(yaw) * y, np.sin(yaw) * x + np.cos(yaw) * y], axis=1)
    position = local - np.column_stack([turned, np.full(len(yaw), z)])
    return position, yaw


def states_of_fixes(
    fixes: Fixes, to_local: ToLocal | None, antenna: tuple[float, float, float], wheelbase: float
) -> list[Timed]:
    """MachineStates of a level machine; speed and turn rate by difference between neighbours."""
    position, yaw = poses_of_fixes(fixes, to_local, antenna)
    seconds = (fixes.t - fixes.t[0]) / NS
    rate = np.gradient(position, seconds, axis=0)
    turn = np.gradient(yaw, seconds)
    speed = rate[:, 0] * np.cos(yaw) + rate[:, 1] * np.sin(yaw)
    side = rate[:, 1] * np.cos(yaw) - rate[:, 0] * np.sin(yaw)
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(position[:, :2], axis=0).T))])
    return [
        (
            int(fixes.published[i]),
            MachineState(
                int(fixes.t[i]),
                Pose.from_euler(position[i], yaw=float(wrap_angle(yaw[i]))),
                float(speed[i]),
                float(side[i]),
                float(turn[i]),
                steer_angle(wheelbase, float(speed[i]), float(turn[i])),
                float(driven[i]),
            ),
        )
        for i in range(len(yaw))
    ]
