"""Follows things over the ground from scan to scan: an alpha-beta filter each, nearest first."""

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, hypot, inf

from swath.core.component import KeepsState

GATE = 0.8  # a heap belongs to the thing that is expected no farther from it [m]
FASTEST = 4.0  # and this much more per second since it was seen [m/s]
ALPHA, BETA = 0.5, 0.15  # of the place and the velocity, for scans some 0.1 s apart
FAINT = 0.1  # what is less sure is not reported
LASTS = 0.7  # of the evidence of one scan in the next: both see much the same stems
BELIEF, DOUBT = (
    0.4,
    0.1,
)  # share of the way to what a scan makes of a thing, and to 0 where it does not show it


@dataclass(frozen=True)
class Heap:
    """x, y: its middle; length, width: along the machine's axes; top: above the ground under the axle [m].

    evidence: that it is a thing and not crop [nat]; infinite where the sensor cannot mistake crop for one
    """

    x: float
    y: float
    length: float
    width: float
    top: float
    evidence: float = inf


@dataclass
class Track:
    """A thing that is followed. place, velocity: at t [s]; hits: scans that showed it."""

    number: int
    t: float
    place: tuple[float, float]
    velocity: tuple[float, float]
    heap: Heap
    hits: int = 0
    confidence: float = 0.0
    evidence: float = 0.0

    def at(self, t: float) -> tuple[float, float]:
        """Place where the object is expected at a time [s]."""
        dt = t - self.t
        return self.place[0] + dt * self.velocity[0], self.place[1] + dt * self.velocity[1]

    def believe(self, doubt: float) -> None:
        """What its heap says; doubt: evidence that crop and things have equally often [nat]."""
        self.hits += 1
        self.evidence = LASTS * self.evidence + self.heap.evidence
        sure = 1.0 / (1.0 + exp(min(doubt - self.evidence, 50.0)))
        self.confidence += BELIEF * (sure - self.confidence)

    def take(self, t: float, heap: Heap) -> None:
        """It was seen there."""
        dt = max(t - self.t, 1e-3)
        x, y = self.at(t)
        dx, dy = heap.x - x, heap.y - y
        self.place = x + ALPHA * dx, y + ALPHA * dy
        vx, vy = self.velocity
        self.velocity = vx + BETA / dt * dx, vy + BETA / dt * dy
        self.t, self.heap = t, heap


class Tracks(KeepsState):
    """confirm: scans that show a thing before it counts; keep: seconds without being seen.

    doubt: evidence that crop and things have equally often [nat]
    """

    kept = ("_tracks", "_number")

    def __init__(self, confirm: int, keep: float, doubt: float = 0.0) -> None:
        self._confirm, self._keep, self._doubt = confirm, keep, doubt
        self.clear()

    def clear(self) -> None:
        """Nothing followed."""
        self._tracks: list[Track] = []
        self._number = 0

    def confirmed(self) -> list[Track]:
        """Tracks that enough measurements have shown."""
        return [t for t in self._tracks if t.hits >= self._confirm and t.confidence >= FAINT]

    def update(self, t: float, heaps: list[Heap], is_blind: Callable[[Track], bool]) -> None:
        """The heaps of a scan at t [s]: each to the nearest thing that was expected there, or a new one.

        is_blind: whether the scanner cannot see a thing where it was; it then stays there.
        """
        away = []
        for i, track in enumerate(self._tracks):
            x, y = track.at(t)
            gate = GATE + FASTEST * (t - track.t)
            near = [(hypot(h.x - x, h.y - y), i, j) for j, h in enumerate(heaps)]
            away += [row for row in near if row[0] <= gate]
        taken: set[int] = set()
        used: set[int] = set()
        for _, i, j in sorted(away):
            if i not in taken and j not in used:
                self._tracks[i].take(t, heaps[j])
                self._tracks[i].believe(self._doubt)
                taken.add(i)
                used.add(j)
        for i, track in enumerate(self._tracks):
            if i not in taken and track.hits >= self._confirm and is_blind(track):
                track.t, track.velocity = t, (0.0, 0.0)
            elif i not in taken:
                track.confidence *= 1.0 - DOUBT
                track.evidence *= LASTS
        self._tracks = [track for track in self._tracks if t - track.t <= self._keep]
        for j, heap in enumerate(heaps):
            if j not in used:
                self._number += 1
                self._tracks.append(Track(self._number, t, (heap.x, heap.y), (0.0, 0.0), heap))
                self._tracks[-1].believe(self._doubt)
