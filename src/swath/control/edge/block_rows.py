"""What is known of an edge from its blocks: one row of numbers a world, as the structs of *.cpp have them."""

from typing import Any

import numpy as np

from swath.control.edge.canopy_classes import CLASSES, LAYERS
from swath.control.edge.detector_rows import POINTS, RETURNS
from swath.control.edge.feet.canopy_offset import BINS, HEIGHTS

COLUMNS = 4  # of a point of the edge: x, u [m], variance [m2], distance along it [m]
KEPT, WALLS = 12, 64  # earlier states of a track; blocks that show a wall, the newest
RAMP_PLACES = 96  # beside the edge, of `CELL`
VAGUE = 0.15  # m, standard deviation from which on a point does not show the edge: lodged crop
USUAL_HEIGHT = 0.85  # m, of a crop that was not seen yet
USUAL = 0.09  # of the crop's height: overhang of cereals


def _row(*fields: str | tuple[Any, ...]) -> np.dtype[Any]:
    """Numbers by their names, and longer fields as numpy has them."""
    made: list[Any] = []
    for field in fields:
        made += [(name, np.float64) for name in field.split()] if isinstance(field, str) else [field]
    return np.dtype(made)


def _numbers(name: str, count: int) -> tuple[str, type[np.float64], int]:
    return name, np.float64, count


ARC = _row("x u angle bend", _numbers("covariance", 9), "distance unseen")
EDGE_POINTS = _row("count return_count", _numbers("rows", POINTS * COLUMNS), _numbers("returns", RETURNS))
ARC_TRACK = _row("has_arc past_count", ("arc", ARC), ("past", ARC, KEPT))
POPULATIONS = _row(_numbers("counts", 5 * CLASSES))
INNER_EDGE = _row("count", _numbers("rows", 5 * WALLS))
EDGE_BREAKS = _row(
    "hole beside outside_count outside_first outside_since outside_last", ("inner", INNER_EDGE)
)
WALLS_BEHIND = _row("count", _numbers("rows", 4 * WALLS))
JAGGED_WALL = _row("variance usual")
LODGING = _row("is_lodged blocks stubble usual")
LEAN_RAMP = _row(_numbers("counts", RAMP_PLACES * LAYERS))
ACCEPTED = _row(
    "is_seen beside height angle heading"
)  # a block's edge that was followed: what its feet are learned by
CANOPY_FEET = _row(
    "lean foot slope cosine sine noise rows turned since overhang",
    _numbers("seen", 2 * BINS),
    _numbers("heights", HEIGHTS),
    ("ramp", LEAN_RAMP),
)
BLOCK_TRACK = _row(
    "spread forget spacing view",
    "is_done height agreed scatter blank followed bite turn_sd is_broken scatter_count has_lost headed bends",
    _numbers("scatters", 3 * KEPT),
    ("lost", ARC),
    ("track", ARC_TRACK),
    ("points", EDGE_POINTS),
    ("populations", POPULATIONS),
    ("breaks", EDGE_BREAKS),
    ("lodging", LODGING),
    ("jagged", JAGGED_WALL),
    ("walls", WALLS_BEHIND),
    ("accepted", ACCEPTED),
    ("feet", CANOPY_FEET),
)
# of the structs of C++ that have such rows, by them
NAMES = {
    row: "".join(map(str.title, name.split("_")))
    for name, row in list(globals().items())
    if isinstance(row, np.dtype)
}
