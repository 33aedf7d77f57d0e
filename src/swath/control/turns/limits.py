"""What a machine can drive in a turn."""

from dataclasses import dataclass
from math import atan

from swath.core.errors import check_within


@dataclass(frozen=True)
class TurnLimits:
    """What a machine can drive.

    radius: of the tightest turn it is driven in [m]
    sharpness: change of curvature per distance [1/m2], from the steering rate and the speed
    """

    radius: float
    sharpness: float

    def __post_init__(self) -> None:
        """Refuse what no machine does."""
        for key, low, high in (("radius", 0.5, 200.0), ("sharpness", 1e-5, 100.0)):
            check_within(f"turn.{key}", getattr(self, key), low, high)


def limits_of(wheelbase: float, radius: float, steer_rate: float, speed: float) -> TurnLimits:
    """Limits of a machine: wheelbase [m], radius [m], steering rate of the wheel [rad/s], speed [m/s].

    The curvature tan(angle) / wheelbase goes from none to 1 / radius while the wheel turns through
    atan(wheelbase / radius) at its rate.
    """
    ramp = atan(wheelbase / radius) / steer_rate * speed
    return TurnLimits(radius, 1.0 / (radius * max(ramp, 1e-3)))
