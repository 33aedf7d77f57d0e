"""A path to drive along in the field's frame, and how a machine lies to it."""

from typing import Annotated

from swath.core.frozen import frozen
from swath.core.signal import About, Message, Quantity, Signal
from swath.signals.arrays import F64

_POINTS = ("point_count",)


_PATH = (
    Message("swath_msgs/GuidancePath"),
    Message("nav_msgs/Path", "to look at; heights are 0", "/machine/slot/output_path"),
)


@frozen
class GuidancePath(Signal, about=About("world", _PATH)):
    """A path for the middle of the fixed axle: points with straight lines between them.

    Curves stand as points that are close together, 0.25 m or so. Without a point there is no path.
    """

    x: Annotated[F64, Quantity("m", "of the points, east", _POINTS)]
    y: Annotated[F64, Quantity("m", "of the points, north", _POINTS)]
    number: Annotated[int, Quantity("", "another one for every other path", column="path_number")] = 0


@frozen
class GuidanceState(Signal):
    """How the machine lies to the path that it is steered along, by its own measured pose."""

    is_following: Annotated[bool, Quantity("", "it is steered along the path", column="path_following")]
    lateral: Annotated[
        float, Quantity("m", "of the machine to the left of the path", nan="no pose", column="path_lateral_m")
    ]
    heading: Annotated[
        float,
        Quantity("rad", "of the machine against the path", nan="no pose", column="path_heading_rad"),
    ]
    way: Annotated[float, Quantity("m", "along the path from its begin", nan="no pose", column="path_way_m")]
    remaining: Annotated[float, Quantity("m", "to the path's end, < 0 beyond", nan="no pose")]
    number: Annotated[int, Quantity("", "of the path, as in GuidancePath; -1 = that of the scenario")] = -1
