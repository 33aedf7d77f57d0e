"""What stands and moves in and beside the field: the truth, and what a machine knows of it."""

from typing import Annotated

from swath.core.frozen import frozen
from swath.core.signal import About, Message, Quantity, Signal
from swath.signals.arrays import F64, U8

OBSTACLE_KINDS = (  # by their number in a sample
    *("unknown", "post", "box", "stone", "mesh"),
    *("person", "animal", "vehicle", "tree", "hedge", "building", "machine"),
)
_MESSAGES = (
    Message("swath_msgs/Obstacles"),
    Message("visualization_msgs/MarkerArray", "a box around each", "/machine/slot/output_markers"),
)
_N = ("obstacle_count",)


@frozen
class Obstacles(Signal, about=About("world", _MESSAGES, is_thinned=True)):
    """Truth about the obstacles of the field, those that go as those that stand; machines are not among them.

    Kinds by number, as in `OBSTACLE_KINDS`.
    """

    kind: Annotated[U8, Quantity("", "what it is", _N)]
    x: Annotated[F64, Quantity("m", "of the middle of its box, east", _N)]
    y: Annotated[F64, Quantity("m", "of the middle of its box, north", _N)]
    z: Annotated[F64, Quantity("m", "of the middle of its box, height", _N)]
    heading: Annotated[F64, Quantity("rad", "of its length, from east, > 0 left", _N)]
    speed: Annotated[F64, Quantity("m/s", "over ground", _N)]
    length: Annotated[F64, Quantity("m", "of its box", _N)]
    width: Annotated[F64, Quantity("m", "of its box", _N)]
    height: Annotated[F64, Quantity("m", "of its box", _N)]
