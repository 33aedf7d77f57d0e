"""A detected crop edge as ROS 2 messages: its numbers, and a line to look at."""

from collections.abc import Iterator
from math import tan
from typing import Any

import numpy as np

from swath.core.frames import Pose
from swath.record.messages import Sent, Source
from swath.signals import CropEdge

BEHIND, AHEAD = 4.0, 6.0  # drawn length of the line about the reference [m]
ABOVE = 0.05  # drawn above the ground [m]
LINE_STRIP, ADD, DELETE = 4, 0, 2  # visualization_msgs/Marker


def edge_messages(source: Source, edge: CropEdge) -> Iterator[Sent]:
    """swath_msgs/CropEdge, and visualization_msgs/Marker beside it."""
    yield Sent(source.topic, source.make.of_signal(edge, source.base))
    yield Sent(f"{source.topic}_marker", _marker(source, edge))


def _marker(source: Source, edge: CropEdge) -> Any:
    """The edge as a line on the ground, deleted when none is seen."""
    make, line = source.make, []
    if edge.is_found:
        heading = edge.heading if np.isfinite(edge.heading) else 0.0
        curvature = edge.curvature if np.isfinite(edge.curvature) else 0.0
        for ahead in np.linspace(-BEHIND, AHEAD, 11):
            y = edge.offset + tan(heading) * ahead + 0.5 * curvature * ahead**2
            line.append(make.point(edge.reference_x + ahead, y, ABOVE))
    return make(
        "visualization_msgs/msg/Marker",
        header=make.header(edge.t, source.base),
        ns="crop_edge",
        type=LINE_STRIP,
        action=ADD if line else DELETE,
        pose=make.pose(Pose.identity()),
        scale=make.vector(0.06),
        color=make("std_msgs/msg/ColorRGBA", r=0.84, g=0.37, b=0.0, a=1.0),
        points=line,
    )
