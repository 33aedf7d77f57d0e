"""What a recording knows of a machine, and where the messages of one of its outputs go.

Frames (REP 105): `map` (world, ENU), `<machine>/odom` (the same place, in which odometry counts),
`<machine>/base_link` (ISO 8855, fixed axle on the ground), `<machine>/<sensor slot>`,
`<machine>/<camera slot>_optical` (x right, y down, z forward).
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np

from swath.core.frames import Pose
from swath.field.projection import Origin
from swath.field.track import EdgeShape
from swath.record.message_factory import Draft, MessageFactory, plain_names
from swath.signals import F64, Signal
from swath.signals.setup import MachineGeometry

UNKNOWN = 1e6  # variance of what nobody knows
EXACT = 1e-12  # variance of what is exact: ROS 2 reads a covariance of zeros as unknown
OPTICAL_FRAME = "_optical"  # after the name of a camera's own frame, as REP 103 asks


@dataclass(frozen=True)
class RecordedMachine:
    """What the recording needs to know of a machine.

    name: its key in the scenario; geometry: its data sheet; edge_side: `left` or `right`
    mounting: sensor slot (without the machine's name) -> pose_machine_sensor
    origin: where on Earth the world's origin lies, if that is known
    outputs: `slot.output` -> type of its samples, in the order of the slots
    edge: the initial edge that it follows; start: where it stood at first
    scanners: slot -> (time from scan to scan [s], least range, greatest range [m]) of its data sheet
    lines: what a viewer draws on the field, name -> points (n, 3) in the world [m]
    is_first: of the machines of the run
    errors: slot -> `KnowsErrors.errors` of its part, where that knows how far off it may be
    triangles: of its body where that is from a file, in the machine frame (n, 3, 3) [m]
    """

    name: str
    geometry: MachineGeometry
    edge_side: str
    mounting: Mapping[str, Pose] = field(default_factory=dict)
    origin: Origin | None = None
    outputs: Mapping[str, type[Signal]] = field(default_factory=dict)
    edge: EdgeShape | None = None
    start: Pose = field(default_factory=Pose.identity)
    scanners: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    errors: Mapping[str, Callable[[Any], Mapping[str, tuple[float, float]]]] = field(default_factory=dict)
    lines: Mapping[str, F64] = field(default_factory=dict)
    is_first: bool = True
    triangles: F64 = field(default_factory=lambda: np.zeros((0, 3, 3)))


@dataclass(frozen=True)
class Source:
    """An output of a slot of a machine, and what makes messages of its samples."""

    make: MessageFactory
    machine: RecordedMachine
    slot: str
    output: str

    @property
    def slot_topic(self) -> str:
        """`/machine/slot`."""
        return f"/{self.machine.name}/{self.slot.replace('.', '/')}"

    @property
    def topic(self) -> str:
        """`/machine/slot/output`."""
        return f"{self.slot_topic}/{self.output}"

    @property
    def base(self) -> str:
        """Frame of the machine."""
        return f"{self.machine.name}/base_link"

    @property
    def odom(self) -> str:
        """Frame in which odometry counts."""
        return f"{self.machine.name}/odom"

    @property
    def frame(self) -> str:
        """Frame of the sensor."""
        return f"{self.machine.name}/{self.slot}"

    def frame_of(self, signal: type[Signal]) -> str:
        """The frame that a signal declares."""
        frames = {"base": self.base, "sensor": self.frame, "world": "map"}
        return frames.get(signal.about.frame, self.frame + OPTICAL_FRAME)


class Sent(NamedTuple):
    """A message of a topic, or its draft.

    delivery: `latched` stays for late readers, `announced` only says it will come
    """

    topic: str
    message: Any
    delivery: Literal["", "latched", "announced"] = ""


Maker = Callable[[Source], Callable[[Any], Iterator[Sent]]]  # called with each sample of one output


def own_messages(source: Source, signal: Signal) -> Iterator[Sent]:
    """Any sample as one `swath_msgs/msg/<Class>` with all its fields, in the frame that it declares."""
    names = plain_names(type(signal))

    def build() -> Any:
        return source.make.of_signal(signal, source.frame_of(type(signal)))

    if names is None:
        yield Sent(source.topic, build())
    else:
        yield Sent(source.topic, Draft(signal.t, names, [getattr(signal, name) for name in names], build))
