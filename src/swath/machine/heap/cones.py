"""Heap level `cones`: as `height_map`, on cells of 0.5 m, one cone each."""

from swath.core.registry import Level
from swath.machine.heap.open_box import Heap, Params


class Cones(Heap):
    """Cells of 0.5 m."""

    cell = 0.5


LEVEL = Level(
    Cones,
    Params,
    summary="one cone for every 0.5 m of the box, walls, grain that runs over the rim",
    cost="20 us for a stream of five points",
    tolerance="first grain over the rim within 4 % of height_map",
)
