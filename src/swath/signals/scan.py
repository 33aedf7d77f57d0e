"""Sweeps of a LiDAR: what it measured, and what it really hit."""

from typing import Annotated

import numpy as np

from swath.core.frozen import frozen
from swath.core.signal import About, Message, Quantity, Signal
from swath.signals.arrays import F32, F64
from swath.signals.ranges import ANGLE, CODE16, HEADING, PLACE, RECEIVED, SHARE, SIGHT, SWEEP

_SCAN = (
    Message("sensor_msgs/LaserScan", "first echoes of one plane at even angles"),
    Message(
        "sensor_msgs/PointCloud2",
        "any other scan or several echoes: x, y, z, intensity, time, beam, ring, echo",
        "/machine/slot/output_points",
    ),
)


@frozen
class Scan(Signal, about=About("sensor", _SCAN, is_bulky=True, seen_as="figure `Scans` of the report")):
    """One sweep of a LiDAR, in beam order. t is the end of the sweep.

    The nominal direction of a beam is (cos e cos a, cos e sin a, sin e) with its elevation e and azimuth a.
    """

    beam_t: Annotated[
        F64, Quantity("s", "time of each beam relative to t, <= 0", ("beam_count",), span=SWEEP)
    ]
    azimuth: Annotated[
        F64, Quantity("rad", "nominal beam angle", ("beam_count",), "the beam says nothing", span=HEADING)
    ]
    elevation: Annotated[F64, Quantity("rad", "nominal beam angle", ("beam_count",), span=ANGLE)]
    ranges: Annotated[
        F32, Quantity("m", "measured distance", ("beam_count", "echo_count"), "no echo", span=SIGHT)
    ]
    intensity: Annotated[
        F32,
        Quantity(
            "",
            "received, relative to a white diffuse target that fills the spot at the same range",
            ("beam_count", "echo_count"),
            "no echo",
            span=RECEIVED,
        ),
    ]

    def points(self) -> F64:
        """Echo points in the sensor frame [m], shape (beam_count, echo_count, 3), nan = no echo.

        What the sensor itself believes: nominal angles, no correction for its own motion.
        """
        directions = beam_directions(self.azimuth, self.elevation)
        return self.ranges[:, :, None].astype(np.float64) * directions[:, None, :]


@frozen
class ScanTruth(
    Signal,
    about=About(
        "world",
        (Message("sensor_msgs/PointCloud2", "x, y, z, beam, echo"),),
        samples="full",
        seen_as="echoes in the replay",
    ),
):
    """What a simulated scan really hit, for metrics and pictures only."""

    points: Annotated[
        F64, Quantity("m", "where the echoes lie", ("beam_count", "echo_count", 3), "no echo", span=PLACE)
    ]
    sensor_position: Annotated[
        F64, Quantity("m", "sensor at the time of each beam", ("beam_count", 3), "not recorded", span=PLACE)
    ]


WINDOW_STATES = "ok", "warning", "error", "serious"  # as SICK's LMS500 calls them
_WINDOW = (
    Message("swath_msgs/WindowState"),
    Message("diagnostic_msgs/DiagnosticArray", "OK, WARN, ERROR", "/diagnostics"),
)


@frozen
class WindowState(Signal, about=About("sensor", _WINDOW)):
    """What a scanner says of its dirty window, by its dirt sensors, each of which looks through a sector."""

    state: Annotated[
        int, Quantity("", "0 ok, 1 warning, 2 error, 3 serious", span=(0, 3), column="window_state")
    ]
    transmission: Annotated[
        float,
        Quantity(
            "",
            "light through the dirtiest sector, one way",
            span=SHARE,
            column="window_transmission",
        ),
    ]
    sector: Annotated[int, Quantity("", "the dirtiest one, 0 = at the first azimuth", span=CODE16)]


def beam_directions(azimuth: F64, elevation: F64) -> F64:
    """Unit vectors in the sensor frame, shape (..., 3), from angles [rad]."""
    ce = np.cos(elevation)
    return np.stack([ce * np.cos(azimuth), ce * np.sin(azimuth), np.sin(elevation)], axis=-1)
