"""How a machine moves: the truth, and where its steered axle stands."""

from typing import Annotated

from swath.core.frames import Pose
from swath.core.frozen import frozen
from swath.core.signal import About, Message, Quantity, Signal, TrackColumn
from swath.signals.ranges import DIMENSIONLESS, FORCE, MEASURED_SPEED, PLACE, RATE, SPEED, STEEP, WAY

_POSE = (
    TrackColumn("x_m", "m", "east of the fixed axle's centre", part="x"),
    TrackColumn("y_m", "m", "north of it", part="y"),
    TrackColumn("z_m", "m", "height of it", part="z"),
    TrackColumn("roll_rad", "rad", "> 0 left side up", part="roll"),
    TrackColumn("pitch_rad", "rad", "> 0 nose down", part="pitch"),
    TrackColumn("yaw_rad", "rad", "from east, > 0 left", part="yaw"),
)
_STATE = (
    Message("nav_msgs/Odometry", frame="`map` -> `machine/base_link`"),
    Message(
        "sensor_msgs/NavSatFix",
        "the truth at 10 Hz, of a field on Earth, where no slot publishes a Fix",
        "/machine/slot/fix",
        "`machine/base_link`",
    ),
    Message("tf2_msgs/TFMessage", "", "/tf", "`machine/odom` -> `machine/base_link`"),
    Message(
        "tf2_msgs/TFMessage",
        "mountings",
        "/tf_static",
        "`machine/base_link` -> `machine/sensor`, `map` -> `machine/odom`",
    ),
    Message("std_msgs/String", "URDF of the first machine, for viewers", "/robot_description"),
    Message(
        "visualization_msgs/MarkerArray", "edge and boundary of the field", "/machine/field_markers", "`map`"
    ),
    Message(
        "visualization_msgs/MarkerArray",
        "the machine's body where that is from a file",
        "/machine/body_markers",
        "`machine/base_link`",
    ),
)


@frozen
class MachineState(Signal, about=About("world", _STATE, is_thinned=True, track_order=0, time_column="t_s")):
    """Truth about a machine's motion. Sensors and the header read it; control never does."""

    pose: Annotated[
        Pose,
        Quantity(
            "",
            "pose_world_machine, origin: centre of the fixed (front) axle, on the ground",
            columns=_POSE,
            span=PLACE,
        ),
    ]
    speed: Annotated[float, Quantity("m/s", "true forward speed", column="speed_m_s", span=SPEED)]
    lateral_speed: Annotated[
        float, Quantity("m/s", "true leftward speed", column="lateral_speed_m_s", span=SPEED)
    ]
    yaw_rate: Annotated[
        float, Quantity("rad/s", "true yaw rate, > 0 left", column="yaw_rate_rad_s", span=RATE)
    ]
    steer_angle: Annotated[
        float,
        Quantity(
            "rad",
            "equivalent single-wheel angle, > 0 turns left",
            nan="not known of a recorded machine",
            span=STEEP,
        ),
    ]
    distance: Annotated[float, Quantity("m", "travelled path length", column="distance_m", span=WAY)]


@frozen
class WheelState(Signal):
    """Truth about the driven wheels, of a motion level that is asked for it."""

    speed: Annotated[
        float, Quantity("m/s", "of their rims, what a sensor at the axle counts", span=MEASURED_SPEED)
    ]
    slip: Annotated[
        float,
        Quantity(
            "", "faster than the ground passes, share of its speed", column="wheel_slip", span=DIMENSIONLESS
        ),
    ]
    traction: Annotated[float, Quantity("N", "that they pull, all together", span=FORCE)]
    load: Annotated[float, Quantity("N", "that presses them to the ground", span=FORCE)]


@frozen
class SteerState(
    Signal,
    about=About(messages=(Message("ackermann_msgs/AckermannDriveStamped"),), is_thinned=True, track_order=1),
):
    """Where the steered axle stands."""

    angle: Annotated[
        float,
        Quantity(
            "rad",
            "equivalent single-wheel angle of the steered axle, > 0 turns left",
            column="steer_rad",
            span=STEEP,
        ),
    ]
    rate: Annotated[float, Quantity("rad/s", "its rate", span=RATE)]
