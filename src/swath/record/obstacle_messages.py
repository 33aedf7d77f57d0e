"""Obstacles as ROS 2 messages: their numbers, and a box around each to look at."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from swath.core.frames import Pose
from swath.record.message_factory import MessageFactory
from swath.record.messages import Sent, Source
from swath.record.own_messages import own_messages
from swath.signals import OBSTACLE_KINDS, Objects, Obstacles

CUBE, TEXT, DELETE_ALL = 1, 9, 3  # visualization_msgs/Marker
LETTERS = 0.4  # height of the text above a box [m]


class Box(NamedTuple):
    """middle, yaw: in the frame of the markers; size: length, width, height [m]; text: above it"""

    middle: Sequence[float]
    yaw: float
    size: Sequence[float]
    text: str


def obstacle_messages(source: Source, seen: Obstacles) -> Iterator[Sent]:
    """swath_msgs/Obstacles, and visualization_msgs/MarkerArray beside it."""
    yield from own_messages(source, seen)
    rows = zip(*(getattr(seen, name).tolist() for name in NAMES), strict=True)
    boxes = [
        Box((x, y, z), heading, (length, width, height), f"{OBSTACLE_KINDS[kind]} {speed:.1f} m/s")
        for kind, x, y, z, heading, speed, length, width, height in rows
    ]
    frame = source.frame_of(type(seen))
    yield Sent(f"{source.topic}_markers", box_markers(source.make, seen.t, frame, boxes, (0.84, 0.37, 0.0)))


def object_messages(source: Source, seen: Objects) -> Iterator[Sent]:
    """swath_msgs/Objects, and visualization_msgs/MarkerArray beside it."""
    yield from own_messages(source, seen)
    names = ("kind", "x", "y", "top", "heading", "length", "width", "confidence")
    rows = zip(*(getattr(seen, name).tolist() for name in names), strict=True)
    boxes = [
        Box((x, y, 0.5 * top), heading, (length, width, top), f"{OBSTACLE_KINDS[kind]} {confidence:.2f}")
        for kind, x, y, top, heading, length, width, confidence in rows
    ]
    frame = source.frame_of(type(seen))
    yield Sent(f"{source.topic}_markers", box_markers(source.make, seen.t, frame, boxes, (0.0, 0.45, 0.70)))


NAMES = ("kind", "x", "y", "z", "heading", "speed", "length", "width", "height")


def box_markers(
    make: MessageFactory, t: int, frame: str, boxes: Sequence[Box], paint: tuple[float, float, float]
) -> Any:
    """visualization_msgs/MarkerArray that replaces the one before: a box and a text each."""
    header = make.header(t, frame)
    colour = make("std_msgs/msg/ColorRGBA", r=paint[0], g=paint[1], b=paint[2], a=0.6)
    kind = "visualization_msgs/msg/Marker"
    markers = [make(kind, header=header, action=DELETE_ALL)]
    for index, box in enumerate(boxes):
        pose = make.pose(Pose.from_euler(list(box.middle), yaw=box.yaw))
        size = make.vector(*box.size)
        common = {"header": header, "pose": pose, "color": colour}
        markers.append(make(kind, ns="boxes", id=index, type=CUBE, scale=size, **common))
        above = make.pose(Pose.from_euler([*box.middle[:2], box.middle[2] + 0.5 * box.size[2] + LETTERS]))
        letters = {"scale": make.vector(0.0, 0.0, LETTERS), "text": box.text}
        markers.append(make(kind, ns="names", id=index, type=TEXT, **{**common, "pose": above}, **letters))
    return make("visualization_msgs/msg/MarkerArray", markers=markers)
