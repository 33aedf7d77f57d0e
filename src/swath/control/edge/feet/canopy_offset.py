"""How far the edge of the canopy lies beyond the stem bases, learned from the scans themselves.

The step that the detector finds is where the outermost stems stop half of the rays: in dense crop those that
lean out furthest, in thin crop hardly any. It is a sharp mark to follow, but lies off the stem bases by
centimetres in wheat and by decimetres in rape. The stem bases end where half of the stand is there. That can
be seen without knowing the crop, because the stand within is its own measure: nine of ten of its rays are
stopped above a certain height; where half of the stand is there, a known smaller share is (`stopped`). Each
ray counts once, at the lateral place where it crosses the middle height of the echoes within.

Nothing is assumed of depth, height or habit of the crop but that it leans to both sides alike. The counts are
kept over the last tens of metres; the steps of single scans carry the line.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from swath.core.component import KeepsState
from swath.core.portable import exp, geomspace
from swath.kernels import repeatable, shared
from swath.signals import F64

REACHED = 0.9  # share of the rays within the stand that are stopped above the height that is watched
FROM, TO, BIN = -0.8, 1.0, 0.025  # m, lateral places whose rays are counted
STEP = 0.005  # m, of which bins and shifts are multiples
INSIDE = (0.4, 1.5)  # m behind the step: the stand within
TALLEST, LAYER = 4.0, 0.02  # m, of the heights counted within
FEWEST = 60.0  # echoes within, before their heights count
STRAY = 0.02  # share of rays on the wrong side whatever the edge
SCANS_PER_SAMPLE = 4.0  # scans see the same stems: rays per independent sample
CLOSE = 0.12  # m: scans whose edge point is further from the line than this show a notch, not the edge
GUESS = 0.05  # m, standard deviation of the shift about the guess
OFTEN = 0.5  # m of travel from fit to fit

_Z = np.linspace(-6.0, 6.0, 1201)
_MET = np.linspace(0.0, 60.0, 3001)
_PHI = np.array([0.5 * (1.0 + math.erf(z / np.sqrt(2.0))) for z in _Z])


@dataclass(frozen=True)
class Rays:
    """How the rays of a profile come down through the canopy; all in one order, shape (echo_count,).

    upper, lower: lateral distance [m] from the edge as it was known before, where a ray is (or would have
        been) `top` and `limit` [m] above the foot of the stubble side, less the roll
    height [m]: of its echo above that foot
    top: of the canopy
    limit: midway between both sides
    """

    upper: F64
    lower: F64
    height: F64
    top: float
    limit: float

    def at(self, height: float) -> F64:
        """Lateral distance [m] of every ray at a height [m] above the foot of the stubble side."""
        share = (height - self.limit) / max(self.top - self.limit, 0.01)
        return self.lower + share * (self.upper - self.lower)


class CanopyOffset(KeepsState):
    """Counts the rays that are stopped in the canopy, across the edge and within the stand.

    memory_m: travel after which old rays count 1/e; 0 = nothing is learned and `shift` is the guess
    lean, spot: first guess of the shift, over the height of the crop [1] and whatever that is [m]
    parts: of plants that make an echo together
    """

    kept = ("_seen", "_heights", "_since", "_shift")

    def __init__(self, memory_m: float, lean: float, spot: float = 0.0, *, parts: int = 1) -> None:
        self._memory, self._lean, self._spot = memory_m, lean, spot
        self._middle = np.arange(FROM + 0.5 * BIN, TO, BIN)
        self._spreads = geomspace(0.02, 0.3, 8)  # as many as the kernel's SPREADS
        self._shifts = np.arange(-0.1, 0.45, 2 * STEP)
        lateral = np.subtract.outer(self._middle, self._shifts).T  # of places from shifts, few are distinct
        apart = np.round(lateral / STEP).astype(np.int64)
        which = apart - apart.min()  # [shift, place] -> place of `there`
        steps = STEP * np.arange(apart.min(), apart.max() + 1) + float(lateral[0, 0] - STEP * apart[0, 0])
        there = np.interp(steps / self._spreads[:, None], _Z, _PHI)  # share of the stand, [spread, ...]
        self._there, place = np.unique(there, return_inverse=True)  # half of them are the same
        place = np.moveaxis(place.reshape(there.shape)[:, which], 0, -1)
        self._which = np.ascontiguousarray(place, np.int32)  # [shift, place, spread] -> place of `_there`
        self._chance = stopped(_MET, parts)
        self._launch: Any = None
        self.clear()

    def tables(self) -> dict[str, Any]:
        """What kernels need beside the counts, by their names of it."""
        found = {"middle": self._middle, "shifts": self._shifts, "met": _MET, "chance": self._chance}
        return {**found, "there": self._there, "which": self._which}

    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shapes of the counts of rays and of heights, and of the scratch arrays logs and scores."""
        scores = len(self._spreads), len(self._shifts)
        return self._seen.shape, self._heights.shape, (2, len(self._there)), scores

    def clear(self) -> None:
        """Forget everything."""
        self._seen = np.zeros((2, len(self._middle)))  # rays that went on and that were stopped, by place
        self._heights = np.zeros(round(TALLEST / LAYER))
        self._since = 0.0
        self._shift = float("nan")

    def move(self, distance: float) -> None:
        """The machine drove so far [m]."""
        if self._memory > 0.0 and distance > 0.0:
            keep = math.exp(-distance / self._memory)
            self._seen *= keep
            self._heights *= keep
            self._since += distance

    def add(self, rays: Rays, lateral: float, height: float) -> None:
        """Count rays that show the edge `lateral` the line [m]; crop height [m]."""
        if self._memory <= 0.0 or abs(lateral) > CLOSE:
            return
        place = rays.at(0.5 * (rays.limit + rays.top))
        within = rays.height[(place > INSIDE[0]) & (place < INSIDE[1])]
        layer = np.clip(within / LAYER, 0.0, len(self._heights) - 1).astype(np.int64)
        np.add.at(self._heights, layer, 1.0)
        if float(self._heights.sum()) < FEWEST:
            return
        self._count(rays)
        if self._since >= OFTEN and height > 0.0:
            self._since = 0.0
            self._shift = self._fit(self._guess(height))

    def shift(self, height: float) -> float:
        """How far the edge of the feet lies behind the detected step [m], of crop `height` [m] tall."""
        return self._shift if np.isfinite(self._shift) else self._guess(height)

    def _guess(self, height: float) -> float:
        return self._lean * max(height, 0.0) + self._spot

    def _count(self, rays: Rays) -> None:
        low, middle = height_at(self._heights, np.array([1.0 - REACHED, 0.5]))
        bins = np.floor((rays.at(float(middle)) - FROM) / BIN).astype(np.int64)
        ok = (bins >= 0) & (bins < len(self._middle))
        is_stopped = rays.height > max(float(low), rays.limit)
        np.add.at(self._seen, (is_stopped[ok].astype(np.int64), bins[ok]), 1.0 / SCANS_PER_SAMPLE)

    def _fit(self, guess: float) -> float:
        """Mean shift under the likelihood of the counts and the guess [m]."""
        inside = self._seen[:, self._middle > INSIDE[0]].sum(axis=1)
        most = min(max(float(inside[1]) / max(float(inside.sum()), 1e-9), 0.3), 1.0 - STRAY)
        depth = float(np.interp(most, self._chance, _MET))
        score = self._scores(depth)
        score -= 0.5 * ((self._shifts - guess) / GUESS) ** 2
        chance = exp(score - score.max())
        return float((chance * self._shifts).sum() / chance.sum())

    def _scores(self, depth: float) -> F64:
        """Log-likelihood of the counts [nat], (spreads, shifts), where rays meet `depth` pieces within."""
        self.compile()
        self._depth[0], self._counts[:] = depth, self._seen
        self._launch()
        return self._score.copy()

    def compile(self) -> None:
        """Load the compiled likelihood, some 10 ms the first time: before a run is in step with a clock."""
        if self._launch is not None or self._memory <= 0.0:
            return
        from swath.control.edge.feet.canopy_offset_kernel import score_shifts

        self._depth, self._counts = np.zeros(1), np.zeros((2, len(self._middle)))
        shape = len(self._spreads), len(self._shifts)
        self._score, logs = np.zeros(shape), np.zeros((2, len(self._there)))
        given = (self._depth, np.array([STRAY]), _MET, self._chance, self._there, self._which)
        arrays = [shared(a) for a in (*given, self._counts, logs, self._score)]
        self._launch = repeatable(score_shifts, arrays).launch


def stopped(met: F64, parts: int) -> F64:
    """Chance that a ray which meets `met` pieces of plants on average meets at least `parts` (Poisson)."""
    fewer = term = exp(-met)
    for k in range(1, parts):
        term = term * met / k
        fewer = fewer + term
    return 1.0 - fewer


def height_at(heights: F64, share: F64) -> F64:
    """Heights [m] below which shares of a histogram lie: counts in layers of LAYER from 0 up."""
    reached = np.cumsum(heights) / heights.sum()
    return np.asarray(np.interp(share, reached, LAYER * np.arange(1, len(heights) + 1)))
