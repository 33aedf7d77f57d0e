"""How fast a machine may drive by what it sees of the crop edge: fast where it is sure, slowly where it is
not, not at all where it has seen nothing for some metres.
"""

from dataclasses import dataclass
from math import isfinite, sqrt
from typing import Annotated, Literal

from annotated_types import Gt, Le

from swath.core.component import KeepsState
from swath.core.schedule import NS
from swath.core.units import KMH
from swath.signals import CropEdge, Odometry

BRAKE = 0.5  # m/s2, gentler than the drive can
LAG = 0.25  # s from a wanted speed to the way driven
STANDING = 0.05  # m/s, below that it is noise of the odometry at rest (0.02 m/s with level `error`)
UNSURE = 0.6  # share of `sure` at which the speed is down to `slow_kmh`
BEND_M = 1.0  # m of travel over which the bend of the edge is averaged


@dataclass(frozen=True)
class Guard:
    """What a speed law does where the edge is not confidently seen. Without an edge detector: nothing.

    when_lost: `stop` = slow down, stop and end the run; `slow` = go on slowly; `ignore` = as if it were seen;
    `path` = go on slowly while the steering follows a path instead, stop where it does not
    blind_m: driven without seeing the edge ahead until the machine stands
    slow_kmh: where the edge is not sure; sure: confidence from which on the speed is full
    bend_m_s2: greatest lateral acceleration along the edge
    """

    when_lost: Literal["stop", "slow", "ignore", "path"] = "stop"
    blind_m: Annotated[float, Gt(0), Le(1000)] = 4.5
    slow_kmh: Annotated[float, Gt(0), Le(40)] = 3.0
    sure: Annotated[float, Gt(0), Le(1)] = 0.5
    bend_m_s2: Annotated[float, Gt(0), Le(10)] = 0.1


class EdgeGuard(KeepsState):
    """Bounds a wanted speed by the edge. blind: driven without seeing it [m]; reason: to end the run."""

    kept = ("blind", "reason", "_bend")

    def __init__(self, params: Guard) -> None:
        self._p = params
        self.reset()

    def reset(self) -> None:
        """Nothing driven yet."""
        self.blind, self.reason, self._bend = 0.0, "", 0.0

    def limit(
        self,
        wanted: float,
        edge: CropEdge | None,
        odometry: Odometry | None,
        dt: int,
        *,
        is_led: bool = False,
    ) -> float:
        """The speed [m/s] that may be driven instead of a wanted one, over the next `dt` [ns].

        is_led: the steering follows a path instead of the edge
        """
        p = self._p
        if is_led and p.when_lost == "path":
            self.blind = 0.0
            return min(wanted, p.slow_kmh * KMH)
        if edge is None or p.when_lost == "ignore":
            return wanted
        speed = abs(odometry.speed) if odometry is not None and isfinite(odometry.speed) else wanted
        travel = speed * dt / NS if speed >= STANDING else 0.0
        is_ahead = edge.is_found and not edge.seen_to < edge.reference_x
        self.blind = 0.0 if is_ahead else self.blind + travel
        bend = abs(edge.curvature) if edge.is_found and isfinite(edge.curvature) else 0.0
        self._bend += min(1.0, travel / BEND_M) * (bend - self._bend)
        most = min(wanted, sqrt(p.bend_m_s2 / max(self._bend, 1e-6)))
        low = UNSURE * p.sure
        trust = min(max((edge.confidence - low) / (p.sure - low), 0.0), 1.0)
        slow = min(p.slow_kmh * KMH, wanted)
        bound = min(most, slow + trust * max(wanted - slow, 0.0))
        if p.when_lost == "slow":
            return bound
        left = p.blind_m - self.blind - LAG * speed
        if left <= STANDING * LAG and speed < STANDING:
            self.reason = f"no crop edge seen for {self.blind:.1f} m"
        if self.blind == 0.0:
            return bound
        return min(bound, sqrt(2.0 * BRAKE * left)) if left > 0.0 else 0.0
