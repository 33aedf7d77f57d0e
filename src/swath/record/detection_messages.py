"""What detectors find as ROS 2 messages: all their numbers, and beside them what a viewer can show.

A crop edge is a line, obstacles are boxes, detections of a radar a cloud.
"""

from collections.abc import Iterable, Iterator, Sequence
from math import isfinite, tan
from typing import Any, NamedTuple

import numpy as np

from swath.core.frames import Pose
from swath.record.message_factory import Draft, Sent, Source, own_messages
from swath.record.scan_messages import cloud_message
from swath.signals import OBSTACLE_KINDS, CropEdge, Objects, Obstacles
from swath.signals.radar import RadarTargets

STEPS = [float(x) for x in range(-4, 7)]  # of the drawn line, ahead of the reference [m]
LINE = tuple(f"points.{i}.{axis}" for i in range(len(STEPS)) for axis in ("x", "y", "z"))
ABOVE = 0.05  # drawn above the ground [m]
CUBE, LINE_STRIP, TEXT = 1, 4, 9  # types of visualization_msgs/Marker
ADD, DELETE, DELETE_ALL = 0, 2, 3  # and its actions
LETTERS = 0.4  # height of the text above a box [m]
# Fields of clouds as smartmicro's driver names them, and the quantities that they hold.
FIELDS = {
    "radial_speed": "radial_speed",
    "rcs": "rcs",
    "snr": "snr",
    "azimuth_angle": "azimuth",
    "elevation_angle": "elevation",
    "range": "range",
}
RETURN = ("range", "azimuth", "elevation", "doppler_velocity", "amplitude")  # of radar_msgs/RadarReturn


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
    header, points = source.make.header(edge.t, source.base), np.reshape(line, (-1, 3)).tolist()
    action = ADD if line else DELETE
    colour = (0.84, 0.37, 0.0, 1.0)
    return source.make.marker(header, "crop_edge", LINE_STRIP, colour, (0.06,), points=points, action=action)


class Box(NamedTuple):
    """middle, yaw: in the frame of the markers; size: length, width, height [m]; text: above it."""

    middle: Sequence[float]
    yaw: float
    size: Sequence[float]
    text: str


def obstacle_messages(source: Source, seen: Obstacles) -> Iterator[Sent]:
    """swath_msgs/Obstacles, and visualization_msgs/MarkerArray beside it."""
    names = ("kind", "x", "y", "z", "heading", "speed", "length", "width", "height")
    boxes = [
        Box((x, y, z), heading, (length, width, height), f"{OBSTACLE_KINDS[kind]} {speed:.1f} m/s")
        for kind, x, y, z, heading, speed, length, width, height in _rows(seen, names)
    ]
    yield from _with_boxes(source, seen, boxes, (0.84, 0.37, 0.0, 0.6))


def object_messages(source: Source, seen: Objects) -> Iterator[Sent]:
    """swath_msgs/Objects, and visualization_msgs/MarkerArray beside it."""
    names = ("kind", "x", "y", "top", "heading", "length", "width", "confidence")
    boxes = [
        Box((x, y, 0.5 * top), heading, (length, width, top), f"{OBSTACLE_KINDS[kind]} {confidence:.2f}")
        for kind, x, y, top, heading, length, width, confidence in _rows(seen, names)
    ]
    yield from _with_boxes(source, seen, boxes, (0.0, 0.45, 0.70, 0.6))


def _rows(seen: Any, names: Sequence[str]) -> Iterable[Any]:
    return zip(*(getattr(seen, name).tolist() for name in names), strict=True)


def _with_boxes(
    source: Source, seen: Obstacles | Objects, boxes: Sequence[Box], colour: Sequence[float]
) -> Iterator[Sent]:
    """The sample, and visualization_msgs/MarkerArray that replaces the one before: a box and a text each."""
    yield from own_messages(source, seen)
    make = source.make
    header = make.header(seen.t, source.frame_of(type(seen)))
    markers = [make("visualization_msgs/msg/Marker", header=header, action=DELETE_ALL)]
    for index, box in enumerate(boxes):
        pose = Pose.from_euler(list(box.middle), yaw=box.yaw)
        above = Pose.from_euler([*box.middle[:2], box.middle[2] + 0.5 * box.size[2] + LETTERS])
        size = (0.0, 0.0, LETTERS)
        markers.append(make.marker(header, "boxes", CUBE, colour, box.size, pose=pose, id=index))
        markers.append(make.marker(header, "names", TEXT, colour, size, pose=above, id=index, text=box.text))
    yield Sent(f"{source.topic}_markers", make("visualization_msgs/msg/MarkerArray", markers=markers))


def radar_messages(source: Source, seen: RadarTargets) -> Iterator[Sent]:
    """swath_msgs/RadarTargets, and beside it sensor_msgs/PointCloud2 and radar_msgs/RadarScan."""
    yield from own_messages(source, seen)
    columns = {name: getattr(seen, quantity) for name, quantity in FIELDS.items()}
    cloud = cloud_message(source, seen.t, source.frame_of(type(seen)), seen.points(), columns)
    yield Sent(f"{source.topic}_points", cloud)
    yield Sent(f"{source.topic}_returns", _returns(source, seen))


def _returns(source: Source, seen: RadarTargets) -> Any:
    """radar_msgs/RadarScan: an elevation that is not measured is 0, amplitude is signal to noise [dB]."""
    columns = (seen.range, seen.azimuth, np.nan_to_num(seen.elevation), seen.radial_speed, seen.snr)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    returns = [
        source.make("radar_msgs/msg/RadarReturn", **dict(zip(RETURN, row, strict=True))) for row in rows
    ]
    header = source.make.header(seen.t, source.frame_of(type(seen)))
    return source.make("radar_msgs/msg/RadarScan", header=header, returns=returns)
