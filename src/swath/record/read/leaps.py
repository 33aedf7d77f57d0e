"""Positions of a receiver against its own speed: whether a machine can have driven from one to the next."""

from math import hypot, isfinite, isnan

from swath.core.schedule import NS
from swath.record.read.feed import Timed
from swath.signals import Fix, MachineState, Signal

TOP_SPEED = 15.0  # m/s of a machine, where a receiver says no speed
FASTER = 1.2  # times the speed that is said: between two positions it may have been higher; estimated
HELD_S = 2.0  # s for which a speed that is said holds; estimated
OFF_M = (10.0, 10.0, 4.0, 2.0, 0.5)  # that positions of a quality wander between two epochs; estimated


class Leaps:
    """Counts the positions that lie farther from the last good one than the machine can have driven.

    count: of them; farthest: what the farthest lies beyond its reach [m]
    Where the receiver stays there, what follows is good again.
    """

    def __init__(self) -> None:
        self.count, self.farthest = 0, 0.0
        self._good: tuple[float, ...] = ()
        self._away: tuple[float, ...] = ()

    @property
    def notes(self) -> dict[str, int]:
        """What of it the user should know, with how often."""
        far = f"up to {self.farthest:,.1f} m farther from the one before than its speed reaches"
        return {f"place: positions that lie {far}": self.count} if self.count else {}

    def take(self, t: int, sample: Signal) -> Timed:
        """One more position, and when it was published, as they are.

        The speed of a MachineState that was made of positions is theirs, it is not asked.
        """
        if isinstance(sample, Fix):
            off = OFF_M[min(max(int(sample.quality), 0), len(OFF_M) - 1)]
            at = (sample.t / NS, sample.x, sample.y, sample.speed, off)
        else:
            assert isinstance(sample, MachineState)
            x, y, _ = sample.pose.position.tolist()
            at = (sample.t / NS, x, y, float("nan"), OFF_M[1])
        if isfinite(at[1]) and isfinite(at[2]):
            beyond = _beyond(self._good, at)
            if beyond > 0.0 and not (self._away and _beyond(self._away, at) <= 0.0):
                self.count, self.farthest = self.count + 1, max(self.farthest, beyond)
                self._away = at
            else:
                self._good, self._away = at, ()
        return t, sample


def _beyond(one: tuple[float, ...], other: tuple[float, ...]) -> float:
    """How far a position lies out of reach of another one [m], 0 and less = within.

    one, other: time [s], x, y [m], speed [m/s], what it may be off [m]
    """
    if not one:
        return 0.0
    took, speed = abs(other[0] - one[0]), FASTER * max(one[3], other[3])
    reach = TOP_SPEED if isnan(one[3] + other[3]) or took > HELD_S else speed
    return hypot(other[1] - one[1], other[2] - one[2]) - reach * took - max(one[4], other[4])
