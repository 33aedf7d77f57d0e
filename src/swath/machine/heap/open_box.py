"""What all levels of a heap share: the box on its machine, what falls into it, what runs over its rim.

The surface of grain poured slowly into a box with walls is nowhere steeper than the angle of repose. Grain
poured on a point p builds a cone of slope tan(a) about it, as far as that rises above what lies there:

    h(x) = max(h(x), H - tan(a) |x - p|)

with H by the volume. From a surface that is nowhere steeper than a this is the exact growth of a sand pile
(Prigozhin 1996, Eur. J. Appl. Math. 7:225, for a source in a point); walls only bound it. The cone reaches
the rim, at the wall nearest to p, when H = depth + tan(a) distance: more than that runs over there.
"""

from dataclasses import dataclass
from math import floor, tan
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port, State
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.units import DEG, PERCENT
from swath.field.grain import GrainReceiver
from swath.field.site_setup import SiteSetup
from swath.field.solid.solids import box_walls, merge
from swath.machine.compensated_sum import Total
from swath.signals import F64, HeapState, TrailerState
from swath.signals.setup import OpenBox

BESIDE = 0.15  # how far from the wall grain lands that ran over the rim [m]


class Surface(KeepsState):
    """Heights above the floor at the middles of square cells, x along the box, y to the left of its middle.

    box: its measures
    slope: tangent of the angle of repose
    cell: wanted side of a cell [m]
    """

    kept = ("heights",)

    def __init__(self, box: OpenBox, slope: float, cell: float) -> None:
        self.box, self.slope = box, slope
        self._nx = max(1, round(box.length / cell))
        self._ny = max(1, round(box.width / cell))
        dx, dy = box.length / self._nx, box.width / self._ny
        self.x = (np.arange(self._nx) + 0.5) * dx - 0.5 * box.length
        self.y = (np.arange(self._ny) + 0.5) * dy - 0.5 * box.width
        self.area = dx * dy
        self.heights = np.zeros((self._nx, self._ny))

    def level(self, volume: float) -> None:
        """An even surface of so much grain [m3]."""
        self.heights[:] = volume / (self.box.length * self.box.width)

    @property
    def volume(self) -> float:
        """Grain under the surface [m3]."""
        return float(self.heights.sum()) * self.area

    def pour(self, volume: float, x: float, y: float) -> float:
        """Pour grain [m3] on a point of the box [m]; returns what runs over the rim."""
        away = self.slope * np.sqrt((self.x[:, None] - x) ** 2 + (self.y[None, :] - y) ** 2)
        foot = (self.heights + away).ravel()
        order = np.sort(foot)
        count = np.arange(1, len(order) + 1)
        # volume below a cone with its top at the k-th foot; the top lies between two of them
        under = (count * order - np.cumsum(order)) * self.area
        k = int(np.searchsorted(under, volume, side="right"))
        top = (volume / self.area + float(np.cumsum(order)[k - 1])) / k
        most = self.top_at_rim(x, y)
        spilled = 0.0
        if top > most:
            top = max(most, float(order[0]))
            spilled = volume - float(np.maximum(top - foot, 0.0).sum()) * self.area
        np.maximum(self.heights, top - away, out=self.heights)
        return max(spilled, 0.0)

    def top_at_rim(self, x: float, y: float) -> float:
        """Height above the floor of a cone about a point whose foot lies on the rim [m]."""
        beside = min(0.5 * self.box.length - abs(x), 0.5 * self.box.width - abs(y))
        return self.box.depth + self.slope * max(beside, 0.0)

    def at(self, x: float, y: float) -> float:
        """Height of the surface above the floor at a point of the box, of the nearest cell [m]."""
        i = floor((x / self.box.length + 0.5) * self._nx)
        j = floor((y / self.box.width + 0.5) * self._ny)
        return float(self.heights[min(max(i, 0), self._nx - 1), min(max(j, 0), self._ny - 1)])

    def profile(self, x: F64) -> F64:
        """Heights along the middle line at places of the box [m]."""
        half = self._ny // 2
        middle = 0.5 * (self.heights[:, half] + self.heights[:, (self._ny - 1) // 2])
        return np.asarray(np.interp(x, self.x, middle))

    @property
    def lean(self) -> float:
        """How much higher grain stands at the left wall than at the right one, the mean [m]."""
        return float((self._at_wall(-1, -2) - self._at_wall(0, 1)).mean())

    def freeboard(self, count: int) -> F64:
        """Rim above the grain at the nearest walls, the least in each of `count` parts of the length [m]."""
        sides = np.maximum(self._at_wall(0, 1), self._at_wall(-1, -2))
        if self._nx > 1:
            for end, inner in ((0, 1), (-1, -2)):
                at_end = self.heights[end] + 0.5 * (self.heights[end] - self.heights[inner])
                sides[end] = max(sides[end], float(at_end.max()))
        part = np.minimum((np.arange(self._nx) * count) // self._nx, count - 1)
        found = np.zeros(count)
        np.maximum.at(found, part, sides)
        return np.asarray(self.box.depth - found)

    def _at_wall(self, last: int, inner: int) -> F64:
        """Heights at a side wall, (nx,) [m]: half a cell beyond the last cells, as the surface falls."""
        if self._ny < 2:
            return np.asarray(self.heights[:, last])
        beside = self.heights[:, last]
        return np.asarray(beside + 0.5 * (beside - self.heights[:, inner]))


def outside(box: OpenBox, x: float, y: float) -> tuple[float, float]:
    """Where grain comes down that runs over the wall nearest to a point of the box [m]."""
    along, across = 0.5 * box.length - abs(x), 0.5 * box.width - abs(y)
    if along < across:
        return (0.5 * box.length + BESIDE) * (1.0 if x >= 0.0 else -1.0), y
    return x, (0.5 * box.width + BESIDE) * (1.0 if y >= 0.0 else -1.0)


def largest_heap(box: OpenBox, slope: float) -> float:
    """The most that stands on the rim, a hip roof [m3]: L W D + tan(a) W^2 / 4 (L - W / 3)."""
    long, wide = max(box.length, box.width), min(box.length, box.width)
    return long * wide * box.depth + slope * wide**2 / 4.0 * (long - wide / 3.0)


def slope_of(repose: float) -> float:
    """Tangent of an angle of repose [rad]."""
    return tan(repose)


STATION = 0.5  # between the places of the profile [m]
REPOSE = {"maize": 23.0, "barley": 28.0}  # degrees, docs/explanation/cart.md
OTHER_REPOSE = 25.0


@dataclass(frozen=True)
class Params:
    """Grain in an open box.

    repose_deg: angle of repose; none = that of the field's crop (maize 23, barley 28, else 25)
    density_kg_m3: bulk density of the grain
    start_percent: filling at the start, with a level surface, of the struck box
    """

    repose_deg: Annotated[float, Gt(0), Le(60)] | None = None
    density_kg_m3: Annotated[float, Ge(50), Le(1500)] = 770.0
    start_percent: Annotated[float, Ge(0), Le(100)] = 0.0


class Heap(KeepsState):
    """Grain in the open box of a machine. A level gives `cell`, the side of the cells of its surface [m]."""

    kept = ("start", "density", "_surface", "_caught", "_spilled", "_shown", "_visible")
    cell = 0.1
    inputs = (Port("trailer", TrailerState, optional=True),)
    outputs = (Port("heap", HeapState),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        if setup.machine.box is None:
            raise InputError("level", type(self).__name__, "expected a machine whose data sheet has a `box`")
        self.box = setup.machine.box
        repose = params.repose_deg or REPOSE.get(setup.field.stand.crop, OTHER_REPOSE)
        self.slope, self.density = tan(repose * DEG), params.density_kg_m3
        self.largest = largest_heap(self.box, self.slope)
        self.start = params.start_percent * PERCENT * self.box.length * self.box.width * self.box.depth
        self._count = max(1, round(self.box.length / STATION))
        self._stations = ((np.arange(self._count) + 0.5) / self._count - 0.5) * self.box.length
        self._body, self._bodies = setup.carrier, setup.bodies
        self._clear()
        self._bodies.boxes[self._body] = self

    def _clear(self) -> None:
        self._surface = Surface(self.box, self.slope, self.cell)
        self._surface.level(self.start)
        self._caught, self._spilled, self._shown = Total(), Total(), -1.0
        self._visible = self._surface.heights.copy()

    @property
    def grain(self) -> float:
        """Grain in the box [kg]."""
        return self.start * self.density + self._caught.value

    @property
    def gained(self) -> float:
        """Grain that came in since the start and stayed [kg]."""
        return self._caught.value

    def pour(self, mass: float, x: float, y: float, ground: GrainReceiver, pose: Any) -> float:
        """Take grain [kg] that comes down on a point of the box's frame [m]; returns what stays.

        What runs over the rim goes to the ground beside it. pose: of the body that carries the box
        """
        over = min(self._surface.pour(mass / self.density, x, y) * self.density, mass)
        self._caught.add(mass - over)
        if over > 0.0:
            self._spilled.add(over)
            ox, oy = outside(self.box, x, y)
            ground.receive(over, pose.apply([ox + self.box.x, oy, 0.0]))
        return mass - over

    def surface_at(self, x: float, y: float) -> float:
        """Height of the grain above the ground at a point of the box [m]."""
        return self.box.floor + self._surface.at(x, y)

    def reset(self, stream: Stream) -> Outputs:
        """Fill the box as at the start."""
        self._clear()
        return {"heap": self._state(0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """What came in since the last step is there already; sensors see the new surface."""
        return {"heap": self._state(t + dt)}

    def _state(self, t: int) -> HeapState:
        self._show()
        profile = self._surface.profile(self._stations)
        level = self.grain / self.density / self.largest
        return HeapState(
            t, self.grain, level, self._spilled.value, float(self._surface.heights.max()), profile,
            self._surface.freeboard(self._count), self._surface.lean,
        )  # fmt: skip

    def _show(self) -> None:
        """Walls and grain for rays, anew when it rose by 0.1 m3."""
        volume = self.grain / self.density
        if abs(volume - self._shown) < 0.1:
            return
        self._shown, self._visible = volume, self._surface.heights.copy()
        self._draw()

    def load(self, state: State) -> None:
        """Back to a saved moment; sensors see the surface that they saw then."""
        super().load(state)
        self._draw()

    def _draw(self) -> None:
        self._bodies.show(self._body, merge(box_walls(self.box), self._surface_solids()))

    def _surface_solids(self) -> Any:
        from swath.field.solid.solids import height_surface

        s, box = self._surface, self.box
        rows = np.linspace(0, len(s.x) - 1, max(2, min(len(s.x), 25))).round().astype(int)
        columns = np.linspace(0, len(s.y) - 1, max(2, min(len(s.y), 13))).round().astype(int)
        x, y = np.array(s.x[rows]), np.array(s.y[columns])
        x[[0, -1]], y[[0, -1]] = [-0.5 * box.length, 0.5 * box.length], [-0.5 * box.width, 0.5 * box.width]
        heights: F64 = to_walls(self._visible)[np.ix_(rows, columns)]
        return height_surface(x + box.x, y, box.floor + heights)


def to_walls(cells: F64) -> F64:
    """Heights of cells (nx, ny), of the outer ones at the walls: half a cell on, as the surface falls."""
    found = cells.copy()
    for table in (found, found.T):
        if len(table) > 2:
            table[0] += 0.5 * (table[0] - table[1])
            table[-1] += 0.5 * (table[-1] - table[-2])
    return found
