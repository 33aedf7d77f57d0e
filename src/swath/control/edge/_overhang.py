"""How far the canopy seems to hang over the feet of its stems, learned from the scans themselves.

Stems lean and nod to all sides, and their feet end at the edge. So across the edge the depth of crop that a
beam meets does not begin with a step: at a lateral place u it is that of the stand within times
Phi((u - m) / s), with m the edge of the feet, s the spread of the stems' upper parts across the edge. A beam
comes through to less than half of the crop's height with the chance exp(-depth) (mean free path), so echoes
are high with

    P(u) = 1 - exp(-q Phi((u - m) / s))

A dense stand is seen high where a few stems stand out over the edge, a thin one only where it has begun. The
step that the detector finds is where P is a half, m lies s times -Phi^-1(ln 2 / q) further in.

q comes from the heights within the stand: their spread says how fast beams are used up. s and m come from how
the share of high echoes grows across the edge, of the last tens of metres. Nothing is known of the crop but a
first guess of s.
"""

from math import erf

import numpy as np

from swath.control.edge._step import Step
from swath.core.component import State
from swath.core.signals import F64

SHARE = (
    0.5  # of the depth within the stand, above half its height, that counts at the edge: see docs/control.md
)
FROM, TO, BIN = -0.7, 0.9, 0.025  # m, lateral places whose echoes are counted
INSIDE = (0.4, 1.5)  # m behind the edge: the stand within
TALLEST, LAYER = 4.0, 0.02  # m, of the heights counted within
FEWEST = 60.0  # echoes within, before their spread counts
STRAY = 0.02  # share of echoes on the wrong side whatever the edge
LOOKS = 4.0  # scans that see the same stems: so many echoes count as one
CLOSE = 0.12  # m: scans whose edge point is further from the line than this show a notch, not the edge
GUESS = 0.35  # standard deviation of ln s about the guess
PLACE = 0.02  # m, standard deviation of P = 1/2 about the step that the detector finds
OFTEN = 0.5  # m of travel from fit to fit

_Z = np.linspace(-6.0, 6.0, 1201)
_PHI = np.array([0.5 * (1.0 + erf(z / np.sqrt(2.0))) for z in _Z])


class Overhang:
    """Counts echoes across the edge and within the stand, and fits P(u).

    memory_m: travel after which old echoes count 1/e; 0 = nothing is learned and `shift` is the guess
    guess: spread s of the upper parts over the height of the crop
    """

    def __init__(self, memory_m: float, guess: float) -> None:
        self._memory, self._guess = memory_m, guess
        self._middle = np.arange(FROM + 0.5 * BIN, TO, BIN)
        self._spreads = np.geomspace(0.015, 0.3, 19)
        self._places = np.arange(-2, 3) * PLACE
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._seen = np.zeros((2, len(self._middle)))  # low and high echoes across the edge
        self._heights = np.zeros(round(TALLEST / LAYER))
        self._limit = float("nan")
        self._since = 0.0
        self._shift = float("nan")

    def move(self, distance: float) -> None:
        """The machine drove so far [m]."""
        if self._memory > 0.0 and distance > 0.0:
            keep = np.exp(-distance / self._memory)
            self._seen *= keep
            self._heights *= keep
            self._since += distance

    def add(self, step: Step, beside: float, height: float) -> None:
        """Count the echoes of a scan that shows the edge `beside` the line [m]; crop height [m]."""
        if self._memory <= 0.0 or self._guess <= 0.0 or abs(beside) > CLOSE:
            return
        is_high = step.height > step.limit
        bins = np.floor((step.lateral - FROM) / BIN).astype(np.int64)
        ok = (bins >= 0) & (bins < len(self._middle))
        np.add.at(self._seen, (is_high[ok].astype(np.int64), bins[ok]), 1.0 / LOOKS)
        within = step.height[(step.lateral > INSIDE[0]) & (step.lateral < INSIDE[1])]
        layer = np.clip(within / LAYER, 0.0, len(self._heights) - 1).astype(np.int64)
        np.add.at(self._heights, layer, 1.0)
        self._limit = step.limit if np.isnan(self._limit) else 0.9 * self._limit + 0.1 * step.limit
        if self._since >= OFTEN and height > 0.0:
            self._since = 0.0
            self._shift = self._fit(height)

    def shift(self, height: float) -> float:
        """How far the edge of the feet lies behind the detected step [m], of crop `height` [m] tall."""
        return self._shift if np.isfinite(self._shift) else self._guess * max(height, 0.0)

    def save(self) -> State:
        """Counts and the last fit."""
        return {
            "seen": self._seen.copy(),
            "heights": self._heights.copy(),
            "rest": (self._limit, self._since, self._shift),
        }

    def load(self, state: State) -> None:
        """Back to a saved moment."""
        self._seen, self._heights = state["seen"].copy(), state["heights"].copy()
        self._limit, self._since, self._shift = state["rest"]

    def _fit(self, height: float) -> float:
        """Mean of m under the likelihood of the counts and what is known beforehand [m]; nan = too few."""
        if float(self._heights.sum()) < FEWEST:
            return self._shift
        depth = SHARE * stand_depth(self._heights, self._limit)
        step = -float(np.interp(np.log(2.0) / depth, _PHI, _Z))
        spread = self._spreads[:, None, None]
        edge = self._places[None, :, None] + step * spread
        density = np.interp((self._middle - edge) / spread, _Z, _PHI)
        high = STRAY + (1.0 - 2.0 * STRAY) * (1.0 - np.exp(-depth * density))
        score = (self._seen[1] * np.log(high) + self._seen[0] * np.log(1.0 - high)).sum(axis=-1)
        score -= 0.5 * (np.log(self._spreads / (self._guess * height))[:, None] / GUESS) ** 2
        score -= 0.5 * (self._places / PLACE) ** 2
        chance = np.exp(score - score.max())
        return float((chance * edge[..., 0]).sum() / chance.sum())


def stand_depth(heights: F64, limit: float) -> float:
    """Optical depth of a stand from its top down to `limit` [m], from a histogram of measured heights.

    heights: counts in layers of LAYER from 0 up. The chance to get below a height is exp(-depth): ln 10 at
    the 10th percentile, ln 2 at the median, and so on at the same rate down to the limit. Between 2 and 30.
    """
    reached = np.cumsum(heights) / heights.sum()
    top = LAYER * np.arange(1, len(heights) + 1)
    low, middle = np.interp([0.1, 0.5], reached, top)
    rate = np.log(5.0) / max(float(middle - low), 0.01)
    return float(np.clip(np.log(10.0) + rate * max(float(low) - limit, 0.0), 2.0, 30.0))
