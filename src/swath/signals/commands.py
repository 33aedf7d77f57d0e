"""What control wants of the machine."""

from typing import Annotated

from swath.core.frozen import frozen
from swath.core.signal import About, Message, Quantity, Signal
from swath.signals.ranges import CURVATURE, SPEED


@frozen
class SteerCommand(Signal, about=About(track_order=2)):
    """Wanted path curvature."""

    curvature: Annotated[
        float,
        Quantity(
            "1/m",
            "wanted path curvature at the fixed axle, > 0 left",
            column="command_curvature_1_m",
            span=CURVATURE,
        ),
    ]
    is_engaged: Annotated[
        bool, Quantity("", "1 while the automatic steers, 0 = a person must steer", column="engaged")
    ]


@frozen
class SpeedCommand(Signal, about=About(messages=(Message("geometry_msgs/TwistStamped"),), track_order=3)):
    """Wanted speed."""

    speed: Annotated[float, Quantity("m/s", "wanted forward speed", column="command_speed_m_s", span=SPEED)]
