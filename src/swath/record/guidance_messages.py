"""A guidance path as ROS 2 messages: its own, and the one that viewers and navigation know."""

from collections.abc import Iterator
from math import atan2
from typing import Any

from swath.core.frames import Pose
from swath.record.messages import Sent, Source
from swath.record.own_messages import own_messages
from swath.signals import GuidancePath

BESIDE = "_path"  # what the topic of the nav_msgs/Path ends with


def guidance_messages(source: Source, path: GuidancePath) -> Iterator[Sent]:
    """swath_msgs/GuidancePath, and nav_msgs/Path in `map` beside it; no pose where there is no path."""
    yield from own_messages(source, path)
    yield Sent(source.topic + BESIDE, _path(source, path))


def _path(source: Source, path: GuidancePath) -> Any:
    """Each pose looks to the next point, the last one as the one before; heights are 0."""
    make = source.make
    header = make.header(path.t, "map")
    xs, ys = path.x.tolist(), path.y.tolist()
    along = [atan2(d - b, c - a) for a, b, c, d in zip(xs[:-1], ys[:-1], xs[1:], ys[1:], strict=True)]
    headings = [*along, *(along[-1:] or [0.0])]
    poses = [
        make(
            "geometry_msgs/msg/PoseStamped",
            header=header,
            pose=make.pose(Pose.from_euler((x, y, 0.0), yaw=heading)),
        )
        for x, y, heading in zip(xs, ys, headings, strict=False)
    ]
    return make("nav_msgs/msg/Path", header=header, poses=poses)
