"""What messages have in common, and the makers of samples from them.

A `Context` says of each message when it was measured, on the clock of the log, and where its machine was.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import hypot
from typing import Any

from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.record.read.clocks import Clocks
from swath.record.read.frames import Links, frame_of, is_own, pose_of, static_mounting
from swath.signals import F64, Signal

Maker = Callable[[Any, int], Signal | None]
"""(message, log time [ns]) -> sample on the clock of the log; None where nothing is in it."""


@dataclass(frozen=True)
class Context:
    """wheelbase [m] of the machine that the samples are for.

    to_local: (n, 3) longitude, latitude [deg], height [m] -> (n, 3) east, north, up [m]; None: the plane at
        the first position
    links: by /tf_static
    machine: its name in there
    notes: what had to be assumed of messages, with how often; grows while they are read
    """

    wheelbase: float
    to_local: Callable[[F64], F64] | None = None
    links: Links = field(default_factory=dict)
    machine: str = ""
    notes: dict[str, int] = field(default_factory=dict)
    clocks: Clocks = field(default_factory=Clocks)
    _below: dict[str, Pose | None] = field(default_factory=dict)

    def again(self) -> "Context":
        """Begin another pass through the recording."""
        return replace(self, clocks=self.clocks.again(), _below={})

    def note(self, what: str) -> None:
        """Count an assumption."""
        self.notes[what] = self.notes.get(what, 0) + 1

    def time(self, message: Any, t: int) -> int:
        """When it was measured, on the clock of the log, where it was received at `t` [ns]; `t` where it does
        not say.
        """
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        if stamp is None:
            return t
        of = f"{frame_of(message)} ({type(message).__name__.rpartition('_')[2]})"
        return self.clocks.time(of, int(stamp.sec) * NS + int(stamp.nanosec), t, self.note)

    def stamp(self, message: Any, t: int) -> int:
        """`time`, not after it was received."""
        return min(self.time(message, t), t)

    def pose(self, message: Any) -> Pose:
        """Pose of the machine from a message with its pose, or that of a frame that `below` knows."""
        pose, below = pose_of(getattr(message.pose, "pose", message.pose)), self.below(message)
        return pose if below is None else pose @ below

    def below(self, message: Any) -> Pose | None:
        """The machine's own frame, in that of its child whose motion a message has; None where it is the
        same, or /tf_static does not know.
        """
        child = frame_of(message, own=True)
        if child not in self._below:
            found = static_mounting(self.links, child, self.machine)
            self._below[child] = below = None if found is None or found[0] == child else found[1].inverse()
            if below is not None and found is not None:
                x, y, z = below.position
                away = f" and {hypot(x, y):.2f} m beside" if hypot(x, y) > 0.005 else ""
                self.note(f"derived: poses of {child} brought down to {found[0]}, {-z:.2f} m below it{away}")
            elif found is None and child and not is_own(child):
                self.note(
                    f"reference: poses of {child} count as the machine's, /tf_static knows none of its frames"
                )
        return self._below[child]


Makers = dict[tuple[type[Signal], str], Callable[[Context], Maker]]  # (sample type, name of the message)


def number_at(message: Any, path: str) -> float:
    """A number in a message, such as `twist.linear.x` or `data.3`. AttributeError where there is none."""
    value = message
    for part in path.split("."):
        try:
            value = value[int(part)] if part.isdigit() else getattr(value, part)
        except (IndexError, TypeError) as error:
            raise AttributeError(path) from error
    return float(value)
