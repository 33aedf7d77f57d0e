"""What a speed law does where the edge is not surely seen: its numbers."""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Gt, Le

BRAKE = 0.5  # m/s2, gentler than the drive can
LAG = 0.25  # s from a wanted speed to the way driven
STANDING = 0.05  # m/s, below that it is noise of the odometry at rest (0.02 m/s with level `error`)
UNSURE = 0.6  # share of `sure` at which the speed is down to `slow_kmh`
BEND_M = 1.0  # m of travel over which the bend of the edge is averaged
EVEN_CHANCE = 0.6745  # of a normal error's deviations, within which it lies as often as not
CHOICES = "stop", "slow", "ignore", "path"  # of `when_lost`


@dataclass(frozen=True)
class Guard:
    """What a speed law does where the edge is not confidently seen.

    Without an edge detector it does nothing.

    when_lost: `stop` = slow down, stop and end the run; `slow` = go on slowly; `ignore` = as if the edge were
        seen; `path` = go on slowly while the steering follows a path instead, stop where it does not
    blind_m: distance driven without seeing the edge ahead, or knowing where it is, until the machine stands
    room_m: the place of the edge counts as unknown where the edge may as well be farther off than this; where
        the other place that it may have is farther off, the speed is lower by that one's chance
    slow_kmh: speed where the edge is not sure
    sure: confidence from which on the speed is full [1]
    bend_m_s2: greatest lateral acceleration along the edge
    """

    when_lost: Literal["stop", "slow", "ignore", "path"] = "stop"
    blind_m: Annotated[float, Gt(0), Le(1000)] = 4.5
    room_m: Annotated[float, Gt(0), Le(10)] = 0.3
    slow_kmh: Annotated[float, Gt(0), Le(40)] = 3.0
    sure: Annotated[float, Gt(0), Le(1)] = 0.5
    bend_m_s2: Annotated[float, Gt(0), Le(10)] = 0.1
