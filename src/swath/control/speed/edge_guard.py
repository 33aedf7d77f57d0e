"""How fast a machine may drive by what it sees of the crop edge: fast where it is sure, slowly where it is
not, not at all where it has seen nothing for some metres.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, sqrt
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt, Le

from swath.core.component import KeepsState
from swath.core.schedule import NS
from swath.core.together import Samples, field_of
from swath.core.units import KMH
from swath.signals import F64, CropEdge, Odometry

BRAKE = 0.5  # m/s2, gentler than the drive can
LAG = 0.25  # s from a wanted speed to the way driven
STANDING = 0.05  # m/s, below that it is noise of the odometry at rest (0.02 m/s with level `error`)
UNSURE = 0.6  # share of `sure` at which the speed is down to `slow_kmh`
BEND_M = 1.0  # m of travel over which the bend of the edge is averaged
EVEN_CHANCE = 0.6745  # of a normal error's deviations, within which it lies as often as not


@dataclass(frozen=True)
class Guard:
    """What a speed law does where the edge is not confidently seen. Without an edge detector: nothing.

    when_lost: `stop` = slow down, stop and end the run; `slow` = go on slowly; `ignore` = as if it were seen;
    `path` = go on slowly while the steering follows a path instead, stop where it does not
    blind_m: driven without seeing the edge ahead, or knowing where it is, until the machine stands
    room_m: where the edge lies is not known where it may as well be farther off than that
    slow_kmh: where the edge is not sure; sure: confidence from which on the speed is full
    bend_m_s2: greatest lateral acceleration along the edge
    """

    when_lost: Literal["stop", "slow", "ignore", "path"] = "stop"
    blind_m: Annotated[float, Gt(0), Le(1000)] = 4.5
    room_m: Annotated[float, Gt(0), Le(10)] = 0.3
    slow_kmh: Annotated[float, Gt(0), Le(40)] = 3.0
    sure: Annotated[float, Gt(0), Le(1)] = 0.5
    bend_m_s2: Annotated[float, Gt(0), Le(10)] = 0.1


class EdgeGuard(KeepsState):
    """Bounds a wanted speed by the edge. blind: driven without knowing it [m]; reason: to end the run."""

    kept = ("blind", "reason", "bend")

    def __init__(self, params: Guard) -> None:
        self.params = params
        self.reset()

    def reset(self) -> None:
        """Nothing driven yet."""
        self.blind, self.reason, self.bend = 0.0, "", 0.0

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
        p = self.params
        if is_led and p.when_lost == "path":
            self.blind = 0.0
            return min(wanted, p.slow_kmh * KMH)
        if edge is None or p.when_lost == "ignore":
            return wanted
        speed = abs(odometry.speed) if odometry is not None and isfinite(odometry.speed) else wanted
        travel = speed * dt / NS if speed >= STANDING else 0.0
        is_known = edge.is_found and not edge.seen_to < edge.reference_x
        is_known = is_known and not EVEN_CHANCE * edge.offset_sd > p.room_m
        self.blind = 0.0 if is_known else self.blind + travel
        bend = abs(edge.curvature) if edge.is_found and isfinite(edge.curvature) else 0.0
        self.bend += min(1.0, travel / BEND_M) * (bend - self.bend)
        most = min(wanted, sqrt(p.bend_m_s2 / max(self.bend, 1e-6)))
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


class EdgeGuards:
    """Those of many worlds. blind, bend: as in `EdgeGuard`; reasons: by world"""

    def __init__(self, guards: Sequence[EdgeGuard]) -> None:
        params = [guard.params for guard in guards]
        self._lost = np.array([p.when_lost for p in params])
        rows = [(p.blind_m, p.slow_kmh * KMH, p.sure, p.bend_m_s2, p.room_m) for p in params]
        self._blind_m, self._slow, self._sure, self._most, self._room = np.array(rows).T
        self.blind, self.bend = np.zeros((2, len(params)))
        self.reasons: dict[int, str] = {}

    def reset(self) -> None:
        """Nothing driven yet."""
        self.blind[:], self.bend[:] = 0.0, 0.0
        self.reasons.clear()

    def give(self, world: int, guard: EdgeGuard) -> None:
        """A guard of its own goes on as that of a world."""
        guard.blind, guard.reason = float(self.blind[world]), self.reasons.get(world, "")
        guard.bend = float(self.bend[world])

    def take(self, world: int, guard: EdgeGuard) -> None:
        """The other way round."""
        self.blind[world], self.bend[world] = guard.blind, guard.bend
        if guard.reason:
            self.reasons[world] = guard.reason

    def limit(self, wanted: F64, edge: Samples | None, odometry: Samples | None, dt: int) -> F64:
        """As `EdgeGuard.limit`, steering by the edge."""
        if edge is None:
            return wanted
        measured = np.full(len(wanted), np.nan) if odometry is None else field_of(odometry, "speed")
        speed = np.where(np.isfinite(measured), np.abs(measured), wanted)
        travel = np.where(speed >= STANDING, speed * dt / NS, 0.0)
        names = ("offset", "confidence", "curvature", "seen_to", "reference_x", "offset_sd")
        offset, confidence, curvature, seen_to, reference, sd = (field_of(edge, n) for n in names)
        is_found = (confidence > 0.0) & np.isfinite(offset)
        is_known = is_found & ~(np.asarray(seen_to) < reference)
        is_known &= ~(EVEN_CHANCE * np.asarray(sd) > self._room)
        counts = self._lost != "ignore"
        self.blind = np.where(counts, np.where(is_known, 0.0, self.blind + travel), self.blind)
        bend = np.where(is_found & np.isfinite(curvature), np.abs(curvature), 0.0)
        more = np.minimum(1.0, travel / BEND_M) * (bend - self.bend)
        self.bend = np.where(counts, self.bend + more, self.bend)
        most = np.minimum(wanted, np.sqrt(self._most / np.maximum(self.bend, 1e-6)))
        low = UNSURE * self._sure
        trust = np.minimum(np.maximum((confidence - low) / (self._sure - low), 0.0), 1.0)
        slow = np.minimum(self._slow, wanted)
        bound = np.minimum(most, slow + trust * np.maximum(wanted - slow, 0.0))
        left = self._blind_m - self.blind - LAG * speed
        stops = counts & (self._lost != "slow")
        for world in np.flatnonzero(stops & (left <= STANDING * LAG) & (speed < STANDING)).tolist():
            self.reasons[world] = f"no crop edge seen for {self.blind[world]:.1f} m"
        braked = np.where(left > 0.0, np.minimum(bound, np.sqrt(2.0 * BRAKE * np.maximum(left, 0.0))), 0.0)
        bound = np.where(stops & (self.blind != 0.0), braked, bound)
        return np.where(counts, bound, wanted)
