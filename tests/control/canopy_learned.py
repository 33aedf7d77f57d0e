"""The overhang of a canopy, learned by a launch of its own (`canopy_offset_kernel`), for one detector."""

import math
from dataclasses import dataclass

import numpy as np
import warp as wp

from swath.control.edge.feet import canopy_offset_kernel as kernel
from swath.control.edge.feet.canopy_offset import OFTEN, shapes_of, tables_of
from swath.core.component import KeepsState, State
from swath.kernels import filled, of_worlds, repeatable, shared
from swath.signals import F64

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
ROOM = 1024  # rays of a look, at first


@wp.kernel
def learn(
    offsets: wp.array(dtype=kernel.Offset),
    rays: kernel.Table,
    asked: kernel.Numbers,
    seen: kernel.Table,
    heights: kernel.Numbers,
    scratch: kernel.Numbers,
):
    """rays: rows upper, lower, height; asked: what rays tell, how many there are, then what the shift is."""
    n = int(asked[5])
    asked[6] = kernel.learn_offset(offsets[0], rays[0], rays[1], rays[2], n, asked, seen, heights, scratch)


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
        self.tables = tables_of(parts)
        self.shapes = shapes_of(self.tables)
        self._seen, self._heights = (np.zeros(shape) for shape in self.shapes[:2])
        self._asked, self._rays = np.zeros(7), np.zeros((3, ROOM))
        self._launch = None
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
        self._asked[:] = 0.0, rays.top, rays.limit, self._guess(height), is_due, count, np.nan
        self._launch()
        if np.isfinite(found := float(self._asked[6])):
            self._since, self._shift = 0.0, found

    def shift(self, height: float) -> float:
        """How far the edge of the feet lies behind the detected step [m], of crop `height` [m] tall."""
        return self._shift if np.isfinite(self._shift) else self._guess(height)

    def _guess(self, height: float) -> float:
        return self._lean * max(height, 0.0) + self._spot

    def compile(self) -> None:
        """Load what is compiled, some 10 ms the first time: before a run is in step with a clock."""
        if self._launch is None:
            self._held = filled(kernel.Offset, **self.tables)
            own = self._rays, self._asked, self._seen, self._heights, *map(np.zeros, self.shapes[2:])
            self._launch = repeatable(
                learn, [of_worlds(kernel.Offset, [self._held]), *map(shared, own)]
            ).launch
