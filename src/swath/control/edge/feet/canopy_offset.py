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

from swath.core.component import KeepsState, State
from swath.core.portable import exp, geomspace
from swath.kernels import filled, of_worlds, repeatable, shared
from swath.signals import F64

FROM, TO, BIN = -0.8, 1.0, 0.025  # m, lateral places whose rays are counted
STEP = 0.005  # m, of which bins and shifts are multiples
TALLEST, LAYER = 4.0, 0.02  # m, of the heights counted within
OFTEN = 0.5  # m of travel from fit to fit
ROOM = 1024  # rays of a look, at first

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


class CanopyOffset(KeepsState):
    """Counts the rays that are stopped in the canopy, across the edge and within the stand; compiled.

    memory_m: travel after which old rays count 1/e
    lean, spot: first guess of the shift, over the height of the crop [1] and whatever that is [m]
    parts: of plants that make an echo together
    """

    kept = ("_seen", "_heights", "_since", "_shift")

    def __init__(self, memory_m: float, lean: float, spot: float = 0.0, *, parts: int = 1) -> None:
        self._memory, self._lean, self._spot = memory_m, lean, spot
        middle, shifts = np.arange(FROM + 0.5 * BIN, TO, BIN), np.arange(-0.1, 0.45, 2 * STEP)
        spreads = geomspace(0.02, 0.3, 8)  # as many as the kernel's SPREADS
        lateral = np.subtract.outer(middle, shifts).T  # of places from shifts, few are distinct
        apart = np.round(lateral / STEP).astype(np.int64)
        which = apart - apart.min()  # [shift, place] -> place of `there`
        steps = STEP * np.arange(apart.min(), apart.max() + 1) + float(lateral[0, 0] - STEP * apart[0, 0])
        there = np.interp(steps / spreads[:, None], _Z, _PHI)  # share of the stand, [spread, ...]
        some, place = np.unique(there, return_inverse=True)  # half of them are the same
        place = np.moveaxis(place.reshape(there.shape)[:, which], 0, -1)
        # what kernels need beside the counts; which: [shift, place, spread] -> place of `there`
        self.tables: dict[str, Any] = {
            "middle": middle,
            "shifts": shifts,
            "met": _MET,
            "chance": stopped(_MET, parts),
        }
        self.tables |= {"there": some, "which": np.ascontiguousarray(place, np.int32)}
        self.tables |= {"first": FROM, "bin": BIN, "layer": LAYER}
        # of rays that went on and that were stopped, by place; of heights; scratch for logs and scores
        self.shapes = (2, len(middle)), (round(TALLEST / LAYER),), (2, len(some)), (8, len(shifts))
        self._seen, self._heights = (np.zeros(shape) for shape in self.shapes[:2])
        self._asked, self._rays = np.zeros(6), np.zeros((3, ROOM))
        self._launch: Any = None
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._seen[:], self._heights[:] = 0.0, 0.0
        self._since, self._shift = 0.0, float("nan")

    def load(self, state: State) -> None:
        """Take on a state that `save` gave."""
        super().load(state)
        self._launch = None

    def move(self, distance: float) -> None:
        """The machine drove so far [m]."""
        if distance > 0.0:
            keep = math.exp(-distance / self._memory)
            self._seen *= keep
            self._heights *= keep
            self._since += distance

    def add(self, rays: Rays, height: float) -> None:
        """Count rays that show the edge; crop height [m]."""
        count = len(rays.height)
        if count > self._rays.shape[1]:
            self._rays, self._launch = np.zeros((3, 2 * count)), None
        self.compile()
        self._rays[:, :count] = rays.upper, rays.lower, rays.height
        is_due = self._since >= OFTEN and height > 0.0
        self._asked[:] = count, rays.top, rays.limit, self._guess(height), is_due, np.nan
        self._launch()
        if np.isfinite(found := float(self._asked[5])):
            self._since, self._shift = 0.0, found

    def shift(self, height: float) -> float:
        """How far the edge of the feet lies behind the detected step [m], of crop `height` [m] tall."""
        return self._shift if np.isfinite(self._shift) else self._guess(height)

    def _guess(self, height: float) -> float:
        return self._lean * max(height, 0.0) + self._spot

    def compile(self) -> None:
        """Load what is compiled, some 10 ms the first time: before a run is in step with a clock."""
        if self._launch is None:
            from swath.control.edge.feet.canopy_offset_kernel import Offset, learn

            self._held = filled(Offset, **self.tables)
            own = self._rays, self._asked, self._seen, self._heights, *map(np.zeros, self.shapes[2:])
            self._launch = repeatable(learn, [of_worlds(Offset, [self._held]), *map(shared, own)]).launch


def stopped(met: F64, parts: int) -> F64:
    """Chance that a ray which meets `met` pieces of plants on average meets at least `parts` (Poisson)."""
    fewer = term = exp(-met)
    for k in range(1, parts):
        term = term * met / k
        fewer = fewer + term
    return 1.0 - fewer
