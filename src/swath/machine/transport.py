"""Crop in transport: plug flow and mixing, exact for any step, several streams side by side."""

from collections import deque
from math import exp
from operator import add, sub

from swath.core.component import KeepsState

Masses = list[float]


class Conveyor(KeepsState):
    """Plug flow over a length: what enters comes out unchanged after that much path, first in, first out.

    length and paths are in one unit of choice: metres, seconds at nominal speed, or shares of the length.
    What enters during a step lies evenly over the path of that step, so a delay is exact to rounding however
    it falls between steps. Ways shorter than `joined` share a packet. No list of masses is changed in place.
    """

    kept = ("_path", "_packets", "_held")

    def __init__(self, length: float, streams: int, *, joined: float = 0.0) -> None:
        self.length, self.streams, self._joined = length, streams, joined
        self.clear()

    def clear(self) -> None:
        """Empty it."""
        self._path = 0.0
        self._packets: deque[tuple[float, float, Masses]] = deque()
        self._held = [0.0] * self.streams

    def advance(self, masses: Masses, path: float) -> Masses:
        """Masses [kg] that leave while these enter, evenly over `path` >= 0."""
        start = self._path
        self._path = end = start + path
        last = self._packets[-1] if self._packets else None
        if last is not None and end - last[0] <= self._joined:
            self._packets[-1] = (last[0], end, [*map(add, last[2], masses)])
        elif any(masses):
            self._packets.append((start, end, masses))
        out = self._leave(end - self.length)
        if self._packets:
            self._held = [*map(sub, map(add, self._held, masses), out)]
        else:
            self._held = [0.0] * self.streams
        return out

    def held(self) -> Masses:
        """Masses on it [kg], kept up step by step."""
        return self._held

    def _leave(self, until: float) -> Masses:
        out = [0.0] * self.streams
        packets = self._packets
        while packets and packets[0][1] <= until:
            out = [*map(add, out, packets.popleft()[2])]
        if packets and packets[0][0] < until:
            start, end, masses = packets[0]
            share = (until - start) / (end - start)
            gone = [share * mass for mass in masses]
            packets[0] = (until, end, [*map(sub, masses, gone)])
            out = [*map(add, out, gone)]
        return out


class Mixer(KeepsState):
    """A well-mixed volume: d(held)/dt = in - held / lag, solved exactly for an even inflow over a step."""

    kept = ("_held",)

    def __init__(self, streams: int) -> None:
        self.streams = streams
        self.clear()

    def clear(self) -> None:
        """Empty it."""
        self._held = [0.0] * self.streams

    def advance(self, masses: Masses, dt: float, lag: float) -> Masses:
        """Masses [kg] that leave within dt [s] while these enter; lag [s] >= 0, 0 = no mixing."""
        if lag <= 0.0:
            out = [*map(add, self._held, masses)]
            self._held = [0.0] * self.streams
            return out
        kept = exp(-dt / lag)
        entering = (1.0 - kept) * lag / dt
        held = self._held
        self._held = [h * kept + m * entering for h, m in zip(held, masses, strict=True)]
        return [*map(sub, map(add, held, masses), self._held)]

    def held(self) -> Masses:
        """Masses in it [kg]."""
        return self._held


def flow_delay(held: float, delay: float, flow: float, exponent: float) -> float:
    """Delay [s] of a transport whose delay is delay * (F / flow)^-exponent at a steady flow F [kg/s].

    held: mass in transport [kg], F times the delay in the steady state, so that the delay follows from it
    without a loop. Bounded to 0.5 and 1.6 times `delay` (8 s at 1.3 kg/s against 5 s at 21 kg/s).
    """
    if held <= 0.0:
        return 1.6 * delay
    free: float = (delay * (delay * flow / held) ** exponent / delay**exponent) ** (1.0 / (1.0 - exponent))
    return min(max(free, 0.5 * delay), 1.6 * delay)
