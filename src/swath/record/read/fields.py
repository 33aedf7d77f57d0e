"""What messages have in common: stamps, numbers by their path, poses; and the makers of samples from them."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import hypot
from typing import Any

import numpy as np

from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.signals import F64, Signal

Maker = Callable[[Any, int], Signal]  # (message, log time [ns]) -> sample on the clock of the log
CLOCKS_AGREE = 60 * NS  # a stamp this far from the log time is on another clock


@dataclass(frozen=True)
class Context:
    """wheelbase [m] of the machine that the samples are for.

    to_local: (n, 3) longitude, latitude [deg], height [m] -> (n, 3) east, north, up [m]; None: the plane at
    the first position
    notes: what had to be assumed of messages, with how often; grows while they are read
    """

    wheelbase: float
    to_local: Callable[[F64], F64] | None = None
    notes: dict[str, int] = field(default_factory=dict)

    def note(self, what: str) -> None:
        """Count an assumption."""
        self.notes[what] = self.notes.get(what, 0) + 1


Makers = dict[tuple[type[Signal], str], Callable[[Context], Maker]]  # (sample type, name of the message)


def stamp_of(message: Any, t: int) -> int:
    """When it was measured: the stamp [ns] where it is on the clock of the log, else the log time `t`."""
    own = stamp_in(message)
    return t if own is None or not is_on_clock(own, t) else min(own, t)


def is_on_clock(stamp: int, t: int) -> bool:
    """Whether a stamp is on the clock of the log time `t`, both [ns]."""
    return abs(stamp - t) < CLOCKS_AGREE


def stamp_in(message: Any) -> int | None:
    """The stamp of a message [ns]; None where it has none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return None if stamp is None else int(stamp.sec) * NS + int(stamp.nanosec)


def number_at(message: Any, path: str) -> float:
    """A number in a message, such as `twist.linear.x` or `data.3`. AttributeError where there is none."""
    value = message
    for part in path.split("."):
        try:
            value = value[int(part)] if part.isdigit() else getattr(value, part)
        except (IndexError, TypeError) as error:
            raise AttributeError(path) from error
    return float(value)


def pose_of(pose: Any) -> Pose:
    """geometry_msgs/Pose; a quaternion that is not a unit one is scaled."""
    return _pose(pose.position, pose.orientation)


def pose_of_transform(transform: Any) -> Pose:
    """geometry_msgs/Transform."""
    return _pose(transform.translation, transform.rotation)


def _pose(position: Any, turn: Any) -> Pose:
    q = np.array([turn.x, turn.y, turn.z, turn.w], float)
    x, y, z, w = q / max(hypot(*q), 1e-12)
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return Pose(np.array([position.x, position.y, position.z], float), rotation)
