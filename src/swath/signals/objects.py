"""What a machine knows of the things around it."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from swath.core.frozen import frozen
from swath.core.signal import SHARE, About, Message, Quantity, Signal, TrackColumn
from swath.signals.arrays import F64, U8

_N = ("object_count",)
_COUNT = (TrackColumn("object_count", "-", "objects that the machine knows of", lambda x: float(len(x))),)
_MESSAGES = (
    Message("swath_msgs/Objects"),
    Message("visualization_msgs/MarkerArray", "a box around each", "/machine/slot/output_markers"),
)


@frozen
class Objects(Signal, about=About(messages=_MESSAGES, seen_as="boxes in run.mcap; a column counts them")):
    """Things around the machine that are no crop, in the machine frame (x forward, y left), at the time t.

    Kinds by number, as in `OBSTACLE_KINDS`; 0 where a level reports none.
    """

    number: Annotated[F64, Quantity("", "the same as long as it is followed", _N)]
    kind: Annotated[U8, Quantity("", "what it is", _N)]
    x: Annotated[F64, Quantity("m", "of the middle of its box", _N, columns=_COUNT)]
    y: Annotated[F64, Quantity("m", "of the middle of its box", _N)]
    heading: Annotated[F64, Quantity("rad", "of its length against the x axis, > 0 left", _N)]
    length: Annotated[F64, Quantity("m", "of its box", _N)]
    width: Annotated[F64, Quantity("m", "of its box", _N)]
    top: Annotated[F64, Quantity("m", "of its box above the ground under the fixed axle", _N)]
    velocity_x: Annotated[F64, Quantity("m/s", "over ground, along the x axis of the machine", _N)]
    velocity_y: Annotated[F64, Quantity("m/s", "over ground, along the y axis of the machine", _N)]
    confidence: Annotated[F64, Quantity("", "probability that there is something, 0..1", _N, span=SHARE)]
    hidden: Annotated[
        F64, Quantity("", "share of it that crop and other things hide from the sensor", _N, "not known")
    ]


def objects_of(t: int, rows: Sequence[Sequence[float]]) -> Objects:
    """A sample from a row per object, with its numbers in the order of the fields."""
    columns = np.array(rows, dtype=np.float64).reshape(-1, 12).T.copy()
    return Objects(t, columns[0], columns[1].astype(np.uint8), *columns[2:])
