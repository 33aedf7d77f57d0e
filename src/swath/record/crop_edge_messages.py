"""A detected crop edge as ROS 2 messages: its numbers, and a line to look at."""

from collections.abc import Iterator
from math import isfinite, tan
from typing import Any

from swath.core.frames import Pose
from swath.record.messages import Sent, Source
from swath.record.own_messages import own_messages
from swath.record.templates import Draft
from swath.signals import CropEdge

STEPS = [float(x) for x in range(-4, 7)]  # of the drawn line, ahead of the reference [m]
LINE = tuple(f"points.{i}.{axis}" for i in range(len(STEPS)) for axis in ("x", "y", "z"))
ABOVE = 0.05  # drawn above the ground [m]
LINE_STRIP, ADD, DELETE = 4, 0, 2  # visualization_msgs/Marker


def edge_messages(source: Source, edge: CropEdge) -> Iterator[Sent]:
    """swath_msgs/CropEdge, and visualization_msgs/Marker beside it."""
    yield from own_messages(source, edge)
    line = _line(edge)
    draft = Draft(edge.t, LINE if line else (), line, lambda: _marker(source, edge, line), bool(line))
    yield Sent(f"{source.topic}_marker", draft)


def _line(edge: CropEdge) -> list[float]:
    """x, y, z of the points of the line one after the other [m], nothing where no edge is seen."""
    if not edge.is_found:
        return []
    slope = tan(edge.heading) if isfinite(edge.heading) else 0.0
    bend = 0.5 * edge.curvature if isfinite(edge.curvature) else 0.0
    line: list[float] = []
    for ahead in STEPS:
        line += (edge.reference_x + ahead, edge.offset + slope * ahead + bend * ahead**2, ABOVE)
    return line


def _marker(source: Source, edge: CropEdge, line: list[float]) -> Any:
    """The edge as a line on the ground, deleted when none is seen."""
    make = source.make
    return make(
        "visualization_msgs/msg/Marker",
        header=make.header(edge.t, source.base),
        ns="crop_edge",
        type=LINE_STRIP,
        action=ADD if line else DELETE,
        pose=make.pose(Pose.identity()),
        scale=make.vector(0.06),
        color=make("std_msgs/msg/ColorRGBA", r=0.84, g=0.37, b=0.0, a=1.0),
        points=[make.point(*line[i : i + 3]) for i in range(0, len(line), 3)],
    )
