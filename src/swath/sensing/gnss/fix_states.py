"""What a receiver makes of the satellites it hears: none, single, dgps, float, fix, and a wrong fix.

A state machine with times: ambiguities are fixed a while after the carrier is tracked, and now and then to
wrong numbers, which nobody notices until a later test does. How often and how long is not published for farm
machines as a whole: the defaults are estimates.
"""

from dataclasses import dataclass
from math import log1p
from typing import Annotated, NamedTuple

from annotated_types import Ge, Gt, Le

from swath.core.component import KeepsState
from swath.core.packed_state import saved_type
from swath.signals import FIX_QUALITIES

NONE, SINGLE, DGPS, FLOAT, FIX = range(len(FIX_QUALITIES))
TINY = 1e-9  # s, that sums of periods are off by
Seconds = Annotated[float, Ge(0), Le(1e6)]


@dataclass(frozen=True)
class Times:
    """How a receiver gets its fix and loses it.

    reacquire_s: from four satellites on to the first position; fix_min_s, fix_mean_s: from the first float
    solution to the fix, at least, and the mean of what comes on top (exponential)
    phase_float, phase_fix: satellites whose carrier is tracked, for a float solution and to fix it
    rtk_age_s, dgps_age_s: age of the corrections up to which they serve
    losses_per_h: of a fix under open sky, to float
    wrong_percent: of fixes that are wrong; wrong_shaded: times as many with fewer than 8 carriers or a
    horizontal dilution above 2; wrong_s: mean time until one is noticed
    """

    reacquire_s: Seconds = 1.0
    fix_min_s: Seconds = 2.0
    fix_mean_s: Annotated[float, Gt(0), Le(1e5)] = 6.0
    phase_float: Annotated[int, Ge(4), Le(50)] = 5
    phase_fix: Annotated[int, Ge(4), Le(50)] = 6
    rtk_age_s: Seconds = 30.0
    dgps_age_s: Seconds = 120.0
    losses_per_h: Annotated[float, Ge(0), Le(3600)] = 0.5
    wrong_percent: Annotated[float, Ge(0), Le(100)] = 0.5
    wrong_shaded: Annotated[float, Ge(1), Le(200)] = 10.0
    wrong_s: Annotated[float, Gt(0), Le(1e5)] = 40.0


@saved_type()
class Heard(NamedTuple):
    """codes, carriers: satellites of which either is tracked; hdop; age: of the corrections [s]"""

    codes: int
    carriers: int
    hdop: float
    age: float


class FixStates(KeepsState):
    """quality: by number, as in FIX_QUALITIES; is_wrong: a fix on wrong ambiguities; wrong_count: so far."""

    kept = ("quality", "is_wrong", "wrong_count", "fix_count", "_heard", "_floats", "_wait")

    def __init__(self, times: Times, best: int = FIX) -> None:
        self._times, self._best = times, best
        self.reset()

    def reset(self, quality: int = NONE) -> None:
        """From this quality on."""
        self.quality, self.is_wrong = min(quality, self._best), False
        self.wrong_count = self.fix_count = 0
        self._heard = 0.0 if quality == NONE else float("inf")  # time with four satellites
        self._floats = 0.0  # time with a float solution
        self._wait = float("inf")  # time of it until the fix

    def step(self, seconds: float, heard: Heard, draw: tuple[float, float, float]) -> int:
        """The quality after so many seconds. draw: three uniform numbers of [0, 1)"""
        t = self._times
        self._heard = self._heard + seconds if heard.codes >= 4 else 0.0
        if heard.codes < 4 or self._heard < t.reacquire_s - TINY:
            return self._go(NONE)
        most = FLOAT if heard.carriers >= t.phase_float else DGPS
        if heard.age > t.dgps_age_s:
            most = SINGLE
        elif heard.age > t.rtk_age_s:
            most = min(most, DGPS)
        if most < FLOAT or self._best < FLOAT:
            return self._go(min(most, self._best))
        if self.quality == FIX:
            return self._keep(seconds, heard, draw)
        if self.quality != FLOAT or self._wait == float("inf"):
            self._begin(draw[0])
            return self._go(FLOAT)
        self._floats += seconds
        if self._best == FIX and self._floats >= self._wait - TINY and heard.carriers >= t.phase_fix:
            self._fix(heard, draw[1])
        return self.quality

    def _keep(self, seconds: float, heard: Heard, draw: tuple[float, float, float]) -> int:
        """A fix stays, is lost, or is found to be wrong."""
        t = self._times
        rate = 1.0 / t.wrong_s if self.is_wrong else t.losses_per_h / 3600.0
        if heard.carriers < t.phase_float or draw[2] < rate * seconds:
            self._begin(draw[0])
            return self._go(FLOAT)
        return FIX

    def _begin(self, draw: float) -> None:
        """A float solution begins; draw the time until it is fixed."""
        self._floats = 0.0
        self._wait = self._times.fix_min_s - self._times.fix_mean_s * log1p(-draw)

    def _fix(self, heard: Heard, draw: float) -> None:
        t = self._times
        is_shaded = heard.carriers < 8 or heard.hdop > 2.0
        share = min(t.wrong_percent / 100.0 * (t.wrong_shaded if is_shaded else 1.0), 1.0)
        self.is_wrong = draw < share
        self.fix_count += 1
        self.wrong_count += self.is_wrong
        self.quality = FIX

    def _go(self, quality: int) -> int:
        self.quality, self.is_wrong = quality, False
        return quality
