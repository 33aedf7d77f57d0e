"""Heap level `height_map`: the surface on cells of 0.1 m, nowhere steeper than the angle of repose."""

from swath.core.registry import Level
from swath.machine.heap.open_box import Heap, Params


class HeightMap(Heap):
    """Cells of 0.1 m."""

    cell = 0.1


LEVEL = Level(
    HeightMap,
    Params,
    summary="surface on cells of 0.1 m at the angle of repose, walls, grain that runs over the rim",
    cost="0.2 ms for a stream of five points",
    tolerance="slope within 0.5 deg, first grain over the rim within 2 % of the closed forms",
)
