"""What stands and moves in and beside the field: the truth, and what a machine knows of it."""

from typing import Annotated

from swath.core.frozen import frozen
from swath.core.signal import About, Message, Quantity, Signal
from swath.signals.arrays import F64, U8
from swath.signals.ranges import HEADING, HEIGHT, MEASURED_SPEED, PLACE, SIZE

OBSTACLE_KINDS = (  # by their number in a sample
    *("unknown", "post", "box", "stone", "mesh"),
    *("person", "animal", "vehicle", "tree", "hedge", "building", "machine"),
)
KIND = 0, len(OBSTACLE_KINDS) - 1  # range of a kind's number
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

    kind: Annotated[U8, Quantity("", "what it is", _N, span=KIND)]
    x: Annotated[F64, Quantity("m", "of the middle of its box, east", _N, span=PLACE)]
    y: Annotated[F64, Quantity("m", "of the middle of its box, north", _N, span=PLACE)]
    z: Annotated[F64, Quantity("m", "of the middle of its box, height", _N, span=HEIGHT)]
    heading: Annotated[F64, Quantity("rad", "of its length, from east, > 0 left", _N, span=HEADING)]
    speed: Annotated[F64, Quantity("m/s", "over ground", _N, span=MEASURED_SPEED)]
    length: Annotated[F64, Quantity("m", "of its box", _N, span=SIZE)]
    width: Annotated[F64, Quantity("m", "of its box", _N, span=SIZE)]
    height: Annotated[F64, Quantity("m", "of its box", _N, span=SIZE)]
