"""Where a sensor sits: exactly in recordings of swath, by /tf_static in any other."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from swath.core.frames import Pose
from swath.record.formats import ABOUT, read_about
from swath.record.read.fields import pose_of_transform
from swath.record.read.files import Log

BASES = ("base_link", "base_footprint", "base")


def own_mounting(log: Log, slot: str) -> Pose | None:
    """pose_machine_sensor of a slot (`combine.lidar`) of a recording of swath, to the last bit."""
    try:
        found = read_about(log.attachment(ABOUT))["mounting"][slot]
        return Pose(np.array(found["position"], dtype=float), np.array(found["rotation"], dtype=float))
    except (ValueError, KeyError, TypeError):
        return None


def static_mounting(log: Log, scans: str, machine: str) -> Pose | None:
    """pose_machine_sensor from /tf_static: from the frame of the scans up to the machine's own."""
    links: dict[str, tuple[str, Pose]] = {}
    frame = ""
    for topic, _, message in log.messages(("/tf_static",), also_first=scans):
        if topic == scans:
            frame = message.header.frame_id.lstrip("/")
        else:
            for link in message.transforms:
                parent = link.header.frame_id.lstrip("/")
                links[link.child_frame_id.lstrip("/")] = (parent, pose_of_transform(link.transform))
    return chain(links, frame, (f"{machine}/base_link", f"{machine}/base", *BASES))


def chain(links: Mapping[str, tuple[str, Pose]], frame: str, ends: Any) -> Pose | None:
    """The pose of a frame in the first of `ends` above it; None where none is."""
    pose, at = Pose.identity(), frame
    for _ in range(len(links) + 1):
        if at in ends:
            return pose
        if at not in links:
            return None
        parent, link = links[at]
        pose, at = link @ pose, parent
    return None
