"""What a machine measures of its own motion and place."""

from collections.abc import Callable
from math import isfinite, sqrt
from typing import Annotated

from swath.core.frozen import frozen
from swath.core.signal import About, Message, Quantity, Signal, TrackColumn
from swath.signals.arrays import F64
from swath.signals.ranges import (
    AGE,
    ANGLE,
    COVARIANCE,
    DEVIATION,
    FORCE_PER_MASS,
    HEADING,
    HEIGHT,
    MEASURED_RATE,
    MEASURED_SPEED,
    PLACE,
    RATIO,
    STEEP,
)

FIX_QUALITIES = ("none", "single", "dgps", "float", "fix")  # of a Fix, by number
SATELLITES = -1, 1000
_NAN = float("nan")


@frozen
class Odometry(
    Signal,
    about=About(
        messages=(Message("nav_msgs/Odometry", frame="`machine/odom` -> `machine/base_link`"),), track_order=4
    ),
):
    """Measured motion."""

    speed: Annotated[
        float, Quantity("m/s", "measured speed", column="odometry_speed_m_s", span=MEASURED_SPEED)
    ]
    yaw_rate: Annotated[
        float,
        Quantity(
            "rad/s", "measured yaw rate, > 0 left", column="odometry_yaw_rate_rad_s", span=MEASURED_RATE
        ),
    ]
    steer_angle: Annotated[
        float, Quantity("rad", "measured, > 0 turns left", nan="not known of a recorded machine", span=ANGLE)
    ]


@frozen
class Inertial(
    Signal, about=About("sensor", (Message("sensor_msgs/Imu", "gravity included, no orientation"),))
):
    """What an inertial unit feels about and along its own axes, the mean since its sample before.

    Forces are specific forces, acceleration less gravity: +9.81 upward at rest.
    """

    rate_x: Annotated[
        float, Quantity("rad/s", "measured, x axis", column="imu_rate_x_rad_s", span=MEASURED_RATE)
    ]
    rate_y: Annotated[
        float, Quantity("rad/s", "measured, y axis", column="imu_rate_y_rad_s", span=MEASURED_RATE)
    ]
    rate_z: Annotated[
        float, Quantity("rad/s", "measured, z axis", column="imu_rate_z_rad_s", span=MEASURED_RATE)
    ]
    force_x: Annotated[
        float, Quantity("m/s2", "measured, x axis", column="imu_force_x_m_s2", span=FORCE_PER_MASS)
    ]
    force_y: Annotated[
        float, Quantity("m/s2", "measured, y axis", column="imu_force_y_m_s2", span=FORCE_PER_MASS)
    ]
    force_z: Annotated[
        float, Quantity("m/s2", "measured, z axis", column="imu_force_z_m_s2", span=FORCE_PER_MASS)
    ]
    rate_sd: Annotated[
        float, Quantity("rad/s", "white noise of a sample, 1 sigma", nan="not known", span=DEVIATION)
    ] = 0.0
    force_sd: Annotated[
        float, Quantity("m/s2", "white noise of a sample, 1 sigma", nan="not known", span=DEVIATION)
    ] = 0.0


_FIX = (
    Message(
        "sensor_msgs/NavSatFix", "of a field on Earth; status -1 where it is lost", frame="`machine/slot`"
    ),
    Message(
        "nav_msgs/Odometry",
        "while there is a fix; twist along the course",
        "/machine/slot/output_odometry",
        "`map` -> `machine/slot_course`",
    ),
)


@frozen
class Fix(Signal, about=About("world", _FIX, time_column="fix_t_s")):
    """A satellite receiver's position, valid when it was measured; it comes out later.

    Qualities by number, as in `FIX_QUALITIES`: none, single, dgps, float, fix.
    """

    x: Annotated[
        float, Quantity("m", "antenna as measured, east", nan="no position", column="fix_x_m", span=PLACE)
    ]
    y: Annotated[
        float, Quantity("m", "antenna as measured, north", nan="no position", column="fix_y_m", span=PLACE)
    ]
    z: Annotated[
        float, Quantity("m", "antenna as measured, height", nan="no position", column="fix_z_m", span=HEIGHT)
    ]
    speed: Annotated[
        float,
        Quantity(
            "m/s",
            "measured horizontal speed over ground",
            nan="not known",
            column="fix_speed_m_s",
            span=MEASURED_SPEED,
        ),
    ]
    course: Annotated[float, Quantity("rad", "where to, from east, > 0 left", nan="not known", span=HEADING)]
    horizontal_sd: Annotated[
        float, Quantity("m", "1 sigma as reported, of east and north each", nan="not known", span=DEVIATION)
    ]
    vertical_sd: Annotated[float, Quantity("m", "1 sigma as reported", nan="not known", span=DEVIATION)]
    speed_sd: Annotated[float, Quantity("m/s", "1 sigma as reported", nan="not known", span=DEVIATION)]
    quality: Annotated[
        int, Quantity("", "0 none, 1 single, 2 dgps, 3 float, 4 fix", column="fix_quality", span=(0, 4))
    ]
    longitude: Annotated[
        float, Quantity("rad", "of the same place", nan="no position, or nowhere on Earth", span=ANGLE)
    ] = _NAN
    latitude: Annotated[
        float, Quantity("rad", "of the same place", nan="no position, or nowhere on Earth", span=STEEP)
    ] = _NAN
    height: Annotated[
        float,
        Quantity("m", "in the field's geodetic system", nan="no position, or nowhere on Earth", span=HEIGHT),
    ] = _NAN
    heading: Annotated[
        float,
        Quantity(
            "rad", "of the machine by two antennas, from east, > 0 left", nan="one antenna, or not known",
            column="fix_heading_rad", span=HEADING,
        ),
    ] = _NAN  # fmt: skip
    heading_sd: Annotated[float, Quantity("rad", "1 sigma as reported", nan="not known", span=DEVIATION)] = (
        _NAN
    )
    age: Annotated[
        float,
        Quantity(
            "s",
            "of the corrections",
            nan="without corrections, or not reported",
            column="fix_age_s",
            span=AGE,
        ),
    ] = _NAN
    satellites: Annotated[
        int, Quantity("", "that it uses, -1 = not modelled", column="fix_satellites", span=SATELLITES)
    ] = -1
    hdop: Annotated[
        float,
        Quantity("", "horizontal dilution of precision", nan="not modelled", column="fix_hdop", span=RATIO),
    ] = _NAN
    roll: Annotated[
        float,
        Quantity("rad", "of the machine, > 0 left side up", nan="no two antennas across it", span=ANGLE),
    ] = _NAN
    pitch: Annotated[
        float, Quantity("rad", "of the machine, > 0 nose down", nan="no two antennas along it", span=ANGLE)
    ] = _NAN

    @property
    def has_place(self) -> bool:
        """Whether it says where the antenna is."""
        return self.quality > 0 and isfinite(self.x) and isfinite(self.y)


def _sd(i: int) -> Callable[[F64], float]:
    return lambda covariance: sqrt(max(float(covariance[i, i]), 0.0))


_SPREAD = (
    TrackColumn("pose_x_sd_m", "m", "of the estimate, 1 sigma", _sd(0)),
    TrackColumn("pose_y_sd_m", "m", "of the estimate, 1 sigma", _sd(1)),
    TrackColumn("pose_heading_sd_rad", "rad", "of the estimate, 1 sigma", _sd(2)),
    TrackColumn("pose_speed_sd_m_s", "m/s", "of the estimate, 1 sigma", _sd(3)),
)


_POSE = Message("nav_msgs/Odometry", "once it is known, with its covariance", frame="`map` -> `machine/slot`")


@frozen
class PoseEstimate(Signal, about=About("world", (_POSE,))):
    """Where the machine takes itself to be: the centre of its fixed axle on the ground, by its sensors."""

    x: Annotated[float, Quantity("m", "estimated, east", nan="not known yet", column="pose_x_m", span=PLACE)]
    y: Annotated[float, Quantity("m", "estimated, north", nan="not known yet", column="pose_y_m", span=PLACE)]
    heading: Annotated[
        float,
        Quantity(
            "rad",
            "estimated, from east, > 0 left",
            nan="not known yet",
            column="pose_heading_rad",
            span=HEADING,
        ),
    ]
    speed: Annotated[
        float, Quantity("m/s", "estimated, forward", column="pose_speed_m_s", span=MEASURED_SPEED)
    ]
    yaw_rate: Annotated[float, Quantity("rad/s", "estimated, > 0 left", span=MEASURED_RATE)]
    covariance: Annotated[
        F64,
        Quantity(
            "",
            "of x, y, heading, speed in SI units",
            (4, 4),
            "not known yet",
            columns=_SPREAD,
            span=COVARIANCE,
        ),
    ]
    fix_age: Annotated[
        float,
        Quantity(
            "s", "since the newest position that counts", nan="none yet", column="pose_fix_age_s", span=AGE
        ),
    ]

    @property
    def position_sd(self) -> float:
        """The greater of east and north [m], nan where it is not known."""
        return sqrt(max(float(self.covariance[0, 0]), float(self.covariance[1, 1]), 0.0))
