"""Where a sensor sits: exactly in recordings of swath, by /tf_static in any other."""

from math import hypot
from typing import Any

import numpy as np

from swath.core.frames import Pose, rotation_of
from swath.record.formats import ABOUT, read_about
from swath.record.read.files import Log

GROUND = ("base_footprint", "base_link", "base")
"""Names of a machine's own frame, without those of a robot before them; the first stands on the ground."""

Links = dict[str, tuple[str, Pose]]  # frame -> the frame above it, pose_parent_child


def own_mounting(log: Log, slot: str) -> Pose | None:
    """pose_machine_sensor of a slot (`combine.lidar`) of a recording of swath, to the last bit."""
    try:
        found = read_about(log.attachment(ABOUT))["mounting"][slot]
        return Pose(np.array(found["position"], dtype=float), np.array(found["rotation"], dtype=float))
    except (ValueError, KeyError, TypeError):
        return None


def static_links(log: Log, topic: str) -> tuple[Links, Any]:
    """/tf_static, and the first message on a topic; None where there is none."""
    links: Links = {}
    first = None
    for name, _, message in log.messages(("/tf_static",), also_first=topic):
        if name == topic:
            first = first or message
        else:
            links |= _links_of(message)
    return links, first


def _links_of(message: Any) -> Links:
    """The links of a tf2_msgs/TFMessage."""
    return {
        link.child_frame_id.lstrip("/"): (
            link.header.frame_id.lstrip("/"),
            pose_of_transform(link.transform),
        )
        for link in message.transforms
    }


def is_own(frame: str) -> bool:
    """Whether a frame is a machine's own, by its name."""
    return frame.rpartition("/")[2] in GROUND


def ground_frame(links: Links, frame: str, machine: str = "") -> str | None:
    """The frame of the machine that carries `frame`, on the ground where the links know one.

    It may lie above, below or beside the frame. Where there are several of a name (robots in one recording),
    the one above the frame counts, or the machine's own.
    """
    above, root = _up(links, frame)
    tree = [*above, *(name for name in links if name not in above and _up(links, name)[1] == root)]
    for wanted in GROUND:
        found = [name for name in tree if name.rpartition("/")[2] == wanted]
        over = [name for name in found if name in above or name == f"{machine}/{wanted}"]
        if len(over or found) >= 1 and (over or len(found) == 1):
            return (over or found)[0]
    return None


def pose_between(links: Links, frame: str, other: str) -> Pose | None:
    """The pose of `other` in `frame`, over the frame above both; None where nothing leads from one to the
    other.
    """
    a, b = _to_root(links, frame), _to_root(links, other)
    return None if a[1] != b[1] else a[0].inverse() @ b[0]


def static_mounting(links: Links, frame: str, machine: str) -> tuple[str, Pose] | None:
    """pose_machine_sensor from /tf_static, and the frame that stands for the machine."""
    ground = ground_frame(links, frame, machine)
    pose = None if ground is None else pose_between(links, ground, frame)
    return None if ground is None or pose is None else (ground, pose)


def _up(links: Links, frame: str) -> tuple[list[str], str]:
    """A frame and those above it; the last of them."""
    found = [frame]
    while found[-1] in links and (parent := links[found[-1]][0]) not in found:
        found.append(parent)
    return found, found[-1]


def _to_root(links: Links, frame: str) -> tuple[Pose, str]:
    """The pose of a frame in the last one above it."""
    path, root = _up(links, frame)
    pose = Pose.identity()
    for name in path[:-1]:
        pose = links[name][1] @ pose
    return pose, root


def frame_of(message: Any, *, own: bool = False) -> str:
    """The frame of a message, own: that of the child whose motion it has; '' where it does not say."""
    source = message if own else getattr(message, "header", None)
    return str(getattr(source, "child_frame_id" if own else "frame_id", "")).lstrip("/")


def pose_of(pose: Any) -> Pose:
    """geometry_msgs/Pose; a quaternion that is not a unit one is scaled, one of zeros is no turn: nan."""
    return _pose(pose.position, pose.orientation)


def pose_of_transform(transform: Any) -> Pose:
    """geometry_msgs/Transform."""
    return _pose(transform.translation, transform.rotation)


def _pose(position: Any, turn: Any) -> Pose:
    q = np.array([turn.x, turn.y, turn.z, turn.w], float)
    rotation = rotation_of(*(q / (hypot(*q) or np.nan)))
    return Pose(np.array([position.x, position.y, position.z], float), rotation)
