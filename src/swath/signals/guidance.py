"""How a machine lies to the path that it drives along."""

from typing import Annotated

from swath.core.frozen import frozen
from swath.core.signal import Quantity, Signal
from swath.signals.ranges import FAR, HEADING, WAY


@frozen
class GuidanceState(Signal):
    """How the machine lies to the path that it is steered along, by its own measured pose."""

    is_following: Annotated[bool, Quantity("", "it is steered along the path", column="path_following")]
    lateral: Annotated[
        float,
        Quantity(
            "m", "of the machine to the left of the path", nan="no pose", column="path_lateral_m", span=FAR
        ),
    ]
    heading: Annotated[
        float,
        Quantity(
            "rad", "of the machine against the path", nan="no pose", column="path_heading_rad", span=HEADING
        ),
    ]
    way: Annotated[
        float, Quantity("m", "along the path from its begin", nan="no pose", column="path_way_m", span=WAY)
    ]
    remaining: Annotated[float, Quantity("m", "to the path's end, < 0 beyond", nan="no pose", span=WAY)]
