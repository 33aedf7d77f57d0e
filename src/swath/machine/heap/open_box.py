"""What all levels of a heap share: the box on its machine, what falls into it, what runs over its rim."""

from dataclasses import dataclass
from math import tan
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port, State
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.units import DEG, PERCENT
from swath.field.grain import GrainReceiver
from swath.field.site_setup import SiteSetup
from swath.field.solids import box_walls, merge
from swath.machine.compensated_sum import Total
from swath.machine.heap.surface import Surface, largest_heap, outside
from swath.signals import F64, HeapState, TrailerState

STATION = 0.5  # between the places of the profile [m]
REPOSE = {"wheat": 25.0, "maize": 23.0, "barley": 28.0, "rye": 25.0}  # degrees, docs/explanation/cart.md
OTHER_REPOSE = 25.0


@dataclass(frozen=True)
class Params:
    """repose_deg: angle of repose, none = of the field's crop (wheat 25, maize 23, barley 28)
    density_kg_m3: of the grain in bulk; start_percent: at the start, level, of the struck box
    """

    repose_deg: Annotated[float, Gt(0), Le(60)] | None = None
    density_kg_m3: Annotated[float, Ge(50), Le(1500)] = 770.0
    start_percent: Annotated[float, Ge(0), Le(100)] = 0.0


class Heap(KeepsState):
    """Grain in the open box of a machine. A level gives `cell`, the side of the cells of its surface [m]."""

    kept = ("_surface", "_caught", "_spilled", "_shown", "_visible")
    cell = 0.1
    inputs = (Port("trailer", TrailerState, optional=True),)
    outputs = (Port("heap", HeapState),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        if setup.machine.box is None:
            raise InputError("level", type(self).__name__, "expected a machine whose data sheet has a `box`")
        self.box = setup.machine.box
        crop = getattr(getattr(setup.field, "crop", None), "name", "")
        repose = REPOSE.get(crop, OTHER_REPOSE) if params.repose_deg is None else params.repose_deg
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
        """In the box [kg]."""
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
        """As full as at the start."""
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
        from swath.field.solids import height_surface

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
