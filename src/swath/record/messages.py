"""What a recording knows of a machine, and where the messages of one of its outputs go.

Frames: `map` (world, ENU), `<machine>/base` (ISO 8855, fixed axle on the ground), `<machine>/<sensor slot>`,
`<machine>/<camera slot>_optical` (x right, y down, z forward), `<machine>/odom` (the start pose).
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from swath.core.frames import Pose
from swath.field.projection import Origin
from swath.field.track import EdgeShape
from swath.record.message_factory import MessageFactory
from swath.signals import Signal
from swath.signals.setup import MachineGeometry

OPTICAL_FRAME = "_optical"  # after the name of a camera's own frame, as REP 103 asks


@dataclass(frozen=True)
class RecordedMachine:
    """What the recording needs to know of a machine.

    name: its key in the scenario; geometry: its data sheet; edge_side: `left` or `right`
    mounting: sensor slot (without the machine's name) -> pose_machine_sensor
    origin: where on Earth the world's origin lies, if that is known
    outputs: `slot.output` -> type of its samples, in the order of the slots
    edge: the initial edge that it follows
    """

    name: str
    geometry: MachineGeometry
    edge_side: str
    mounting: Mapping[str, Pose] = field(default_factory=dict)
    origin: Origin | None = None
    outputs: Mapping[str, type[Signal]] = field(default_factory=dict)
    edge: EdgeShape | None = None


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
        return f"{self.machine.name}/base"

    @property
    def odom(self) -> str:
        """Frame of the start pose."""
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
