"""The crop as the machine perceives it: its edge, and what stands ahead."""

from math import isfinite
from typing import Annotated

from swath.core.frozen import frozen
from swath.core.signal import About, Message, Quantity, Signal
from swath.signals.ranges import AHEAD, ANGLE, ASIDE, CANOPY, CURVATURE, DEVIATION, EXTINCTION, SHARE

_NAN = float("nan")
_EDGE = (
    Message("swath_msgs/CropEdge"),
    Message("visualization_msgs/Marker", "a line on the ground", "/machine/slot/output_marker"),
)


@frozen
class CropEdge(Signal, about=About(messages=_EDGE, track_order=5, time_column="edge_t_s")):
    """The crop edge as detected, in the machine frame (x forward, y left, on the ground).

    What is reported is the line to be steered along: across a hole the edge that goes on behind it, in row
    crops half a row spacing outside the outer row.
    """

    offset: Annotated[
        float,
        Quantity(
            "m",
            "y of the detected edge at x = reference_x, > 0 left",
            nan="no edge",
            column="edge_offset_m",
            span=ASIDE,
        ),
    ]
    heading: Annotated[
        float,
        Quantity(
            "rad",
            "angle of the detected edge against the x axis, > 0 bears left",
            nan="no edge",
            column="edge_heading_rad",
            span=ANGLE,
        ),
    ]
    curvature: Annotated[
        float,
        Quantity("1/m", "> 0 when the edge bends left; 0 when not estimated", nan="no edge", span=CURVATURE),
    ]
    reference_x: Annotated[
        float,
        Quantity(
            "m",
            "where ahead of the fixed axle the offset holds",
            nan="no edge",
            column="edge_reference_m",
            span=AHEAD,
        ),
    ]
    confidence: Annotated[
        float,
        Quantity("", "P(|offset error| <= 0.10 m), 0..1; 0 = no edge", column="edge_confidence", span=SHARE),
    ]
    crop_height: Annotated[
        float,
        Quantity(
            "m", "of the crop above the ground", nan="unknown", column="edge_crop_height_m", span=CANOPY
        ),
    ]
    stubble_height: Annotated[
        float, Quantity("m", "of the stubble above the ground", nan="unknown", span=CANOPY)
    ]
    offset_sd: Annotated[
        float,
        Quantity("m", "1 sigma of the offset", nan="not known", column="edge_offset_sd_m", span=DEVIATION),
    ] = _NAN
    heading_sd: Annotated[
        float, Quantity("rad", "1 sigma of the heading", nan="not known", span=DEVIATION)
    ] = _NAN
    seen_to: Annotated[
        float, Quantity("m", "x of the farthest place where the edge is seen", nan="unknown", span=AHEAD)
    ] = _NAN
    is_held: Annotated[bool, Quantity("", "held from earlier scans, not seen in this one")] = False
    other_offset: Annotated[
        float,
        Quantity(
            "m",
            "y at x = reference_x of the edge if the crop leans out, or does not, against what is likelier",
            nan="no other place",
            column="edge_other_offset_m",
            span=ASIDE,
        ),
    ] = _NAN
    other_chance: Annotated[
        float, Quantity("", "chance of the other place, 0..1", column="edge_other_chance", span=SHARE)
    ] = 0.0

    @property
    def is_found(self) -> bool:
        """True when there is an edge to steer by."""
        return self.confidence > 0.0 and isfinite(self.offset)


@frozen
class CropAhead(Signal):
    """The standing crop ahead of the header, averaged over its width."""

    ahead: Annotated[float, Quantity("m", "where in front of the fixed axle it was seen", span=AHEAD)]
    height: Annotated[
        float, Quantity("m", "top of the canopy above the ground", nan="nothing seen", span=CANOPY)
    ]
    extinction: Annotated[
        float,
        Quantity(
            "1/m", "hits of a ray per metre of way through the canopy", nan="nothing seen", span=EXTINCTION
        ),
    ]

    @property
    def amount(self) -> float:
        """Surface of plants over ground, up to a factor: height * extinction; nan = nothing seen."""
        return self.height * self.extinction
