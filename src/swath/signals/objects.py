"""What a machine knows of the things around it."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from swath.core.frozen import frozen
from swath.core.signal import About, Message, Quantity, Signal, TrackColumn
from swath.signals.arrays import F64, U8
from swath.signals.obstacles import KIND
from swath.signals.ranges import FAR, HEADING, MEASURED_SPEED, NUMBER, SHARE, SIZE, TOP

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

    number: Annotated[F64, Quantity("", "the same as long as it is followed", _N, span=NUMBER)]
    kind: Annotated[U8, Quantity("", "what it is", _N, span=KIND)]
    x: Annotated[F64, Quantity("m", "of the middle of its box", _N, columns=_COUNT, span=FAR)]
    y: Annotated[F64, Quantity("m", "of the middle of its box", _N, span=FAR)]
    heading: Annotated[F64, Quantity("rad", "of its length against the x axis, > 0 left", _N, span=HEADING)]
    length: Annotated[F64, Quantity("m", "of its box", _N, span=SIZE)]
    width: Annotated[F64, Quantity("m", "of its box", _N, span=SIZE)]
    top: Annotated[F64, Quantity("m", "of its box above the ground under the fixed axle", _N, span=TOP)]
    velocity_x: Annotated[
        F64, Quantity("m/s", "over ground, along the x axis of the machine", _N, span=MEASURED_SPEED)
    ]
    velocity_y: Annotated[
        F64, Quantity("m/s", "over ground, along the y axis of the machine", _N, span=MEASURED_SPEED)
    ]
    confidence: Annotated[F64, Quantity("", "probability that there is something, 0..1", _N, span=SHARE)]
    hidden: Annotated[
        F64,
        Quantity(
            "", "share of it that crop and other things hide from the sensor", _N, "not known", span=SHARE
        ),
    ]


def objects_of(t: int, rows: Sequence[Sequence[float]]) -> Objects:
    """A sample from a row per object, with its numbers in the order of the fields."""
    columns = np.array(rows, dtype=np.float64).reshape(-1, 12).T.copy()
    return Objects(t, columns[0], columns[1].astype(np.uint8), *columns[2:])
