"""Angular rate and specific force at a point of a machine, from its true poses.

Over the time from one sample to the next, as a unit reports that adds up its own fast readings:

    rate  = log(R0^T R1) / (t1 - t0)
    force = R^T ((v1 - v0) / (s1 - s0) + g up)

R0, R1: attitude of the sensor; v: last difference of two of its positions, valid half a state before, at s;
R: the attitude half way from s0 to s1; log: rotation vector of a rotation matrix. So turn rates add up to the
turn and accelerations to the speed; as a mean over T, a frequency f comes through with sinc(f T).
"""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from swath.core.frames import Pose
from swath.core.units import DEG

GRAVITY = 9.81  # [m/s2]
Length = Annotated[float, Ge(-30), Le(30)]
Angle = Annotated[float, Ge(-180), Le(180)]


@dataclass(frozen=True)
class Place:
    """Place of the unit on its machine.

    x_m: ahead of the fixed axle
    y_m: leftward
    z_m: above ground
    roll_deg: > 0 left side up
    pitch_deg: > 0 nose down
    yaw_deg: > 0 to the left
    """

    x_m: Length = 0.0
    y_m: Length = 0.0
    z_m: Length = 1.5
    roll_deg: Angle = 0.0
    pitch_deg: Angle = 0.0
    yaw_deg: Angle = 0.0

    def pose(self) -> Pose:
        """pose_machine_sensor."""
        angles = self.roll_deg * DEG, self.pitch_deg * DEG, self.yaw_deg * DEG
        return Pose.from_euler((self.x_m, self.y_m, self.z_m), *angles)
