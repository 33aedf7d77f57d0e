"""Whether machines of a job touch: for how long the bodies of two overlap, and how near they come.

Every step the footprints of all pairs are held against each other; what is hitched together is one machine,
and a pipe passes above. Pairs that are far apart are left until they could have met.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from swath.job.footprint import Footprint, clearance
from swath.job.path import Pose

NEAR = 5.0  # m, beyond which a clearance is a lower bound
FASTEST = 12.0  # m/s, of any machine
Place = tuple[Pose, float]  # of the fixed axle, heading of the trailer [rad]


@dataclass
class PairClearance:
    """first, second: names; least: clearance [m], a lower bound beyond 5 m; touched: for so long [s]

    times: begin and end of each contact [s]; places: where the first stood then [m]
    """

    first: str
    second: str
    least: float = math.inf
    touched: float = 0.0
    times: list[tuple[float, float]] = field(default_factory=list)
    places: list[tuple[float, float]] = field(default_factory=list)


class ContactWatch:
    """Looks at the places of all machines that were added."""

    def __init__(self) -> None:
        self._footprints: dict[str, Footprint] = {}
        self.pairs: list[PairClearance] = []
        self._next: list[float] = []

    def __contains__(self, name: str) -> bool:
        """True for a machine that was added."""
        return name in self._footprints

    def add(self, name: str, footprint: Footprint) -> None:
        """One more machine."""
        for other in self._footprints:
            self.pairs.append(PairClearance(other, name))
            self._next.append(0.0)
        self._footprints[name] = footprint

    def look(self, time: float, dt: float, places: Mapping[str, Place]) -> None:
        """All machines where they are for a step of dt [s] that begins at a time [s]."""
        bodies: dict[str, list[tuple[tuple[float, float], ...]]] = {}
        for i, pair in enumerate(self.pairs):
            if self._next[i] > time or pair.first not in places or pair.second not in places:
                continue
            a, b = places[pair.first][0], places[pair.second][0]
            reach = self._footprints[pair.first].reach + self._footprints[pair.second].reach
            apart = math.hypot(a.x - b.x, a.y - b.y) - reach
            if apart > NEAR:
                pair.least = min(pair.least, apart)
                self._next[i] = time + (apart - NEAR) / (2.0 * FASTEST)
                continue
            for name in (pair.first, pair.second):
                if name not in bodies:
                    bodies[name] = self._footprints[name].at(*places[name])
            found = clearance(bodies[pair.first], bodies[pair.second])
            pair.least = min(pair.least, found)
            if found <= 0.0:
                self._touch(pair, time, dt, a)

    def _touch(self, pair: PairClearance, time: float, dt: float, at: Pose) -> None:
        pair.touched += dt
        if pair.times and time - pair.times[-1][1] < 0.5 * dt:
            pair.times[-1] = (pair.times[-1][0], time + dt)
        else:
            pair.times.append((time, time + dt))
            pair.places.append((at.x, at.y))
