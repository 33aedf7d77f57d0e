"""Speed over ground, measured without wheels."""

from typing import Annotated

from swath.core.frozen import frozen
from swath.core.signal import Quantity, Signal
from swath.signals.ranges import MEASURED_SPEED, WAY


@frozen
class GroundSpeed(Signal):
    """Speed over ground of the machine, measured without wheels."""

    speed: Annotated[
        float, Quantity("m/s", "measured forward speed", column="ground_speed_m_s", span=MEASURED_SPEED)
    ]
    distance: Annotated[float, Quantity("m", "measured way since the start", span=WAY)]
