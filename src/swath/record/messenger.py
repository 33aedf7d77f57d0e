"""From samples to ROS 2 messages: which maker serves which signal.

A signal without a maker becomes one `swath_msgs/msg/<Class>` with all its fields, in the frame it declares.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from swath.core.blocks import Block
from swath.record.detection_messages import edge_messages, object_messages, obstacle_messages, radar_messages
from swath.record.mcap_file import McapFile
from swath.record.message_factory import (
    Draft,
    Maker,
    Many,
    RecordedMachine,
    Sent,
    Source,
    Uneven,
    own_messages,
    plain_names,
)
from swath.record.motion_messages import OdometryMessages, StateMessages, speed_messages, steering_messages
from swath.record.positioning_messages import fix_messages, imu_messages, pose_messages
from swath.record.scan_messages import image_messages, scan_messages, truth_messages, window_messages
from swath.signals import (
    CropEdge,
    Fix,
    Image,
    Inertial,
    MachineState,
    Objects,
    Obstacles,
    Odometry,
    PoseEstimate,
    Scan,
    ScanTruth,
    Signal,
    SpeedCommand,
    SteerState,
    WindowState,
)
from swath.signals.radar import RadarTargets

MAKERS: dict[type[Signal], Maker] = {
    MachineState: StateMessages,
    Odometry: OdometryMessages,
    SteerState: lambda source: partial(steering_messages, source),
    SpeedCommand: lambda source: partial(speed_messages, source),
    Scan: lambda source: partial(scan_messages, source),
    ScanTruth: lambda source: partial(truth_messages, source),
    WindowState: lambda source: partial(window_messages, source),
    Image: lambda source: partial(image_messages, source),
    Fix: lambda source: partial(fix_messages, source),
    PoseEstimate: lambda source: partial(pose_messages, source),
    Inertial: lambda source: partial(imu_messages, source),
    CropEdge: lambda source: partial(edge_messages, source),
    RadarTargets: lambda source: partial(radar_messages, source),
    Objects: lambda source: partial(object_messages, source),
    Obstacles: lambda source: partial(obstacle_messages, source),
}

TAKE_MANY = (steering_messages, speed_messages, imu_messages, own_messages)  # samples at once


def _takes_many(maker: Any, kind: type[Signal]) -> bool:
    """Whether it makes the messages of many samples at once."""
    if not isinstance(maker, partial):
        return bool(getattr(maker, "takes_many", False))
    return maker.func in TAKE_MANY and (maker.func is not own_messages or plain_names(kind) is not None)


class Messenger:
    """Writes the samples of one machine to a file as messages."""

    def __init__(self, machine: RecordedMachine, file: McapFile) -> None:
        self.machine, self.file = machine, file
        self._makers: dict[tuple[str, str, type[Signal]], Callable[[Any], Iterator[Sent]]] = {}

    def write(self, slot: str, output: str, t: int, signal: Signal) -> None:
        """Write one sample published at t [ns] by `slot` (the part after the machine's name)."""
        for topic, message, delivery in self._maker(slot, output, type(signal))(signal):
            if delivery == "announced":
                self.file.announce(topic, message)
            else:
                self.file.write(topic, t, message, is_latched=delivery == "latched")

    def rows(
        self, slot: str, output: str, block: Block, which: Sequence[int]
    ) -> Sequence[Sequence[tuple[str, bytes]] | None]:
        """Topics and bytes of the messages of some samples of a block; None of those that `write` makes."""
        each = [None] * len(which)
        maker = self._maker(slot, output, block.kind)
        if not _takes_many(maker, block.kind) or len(which) < 2:
            return each
        try:
            sent = [*maker(Many(block, which))]
        except Uneven:
            return each
        made = [self.file.rows(topic, draft) for topic, draft, _ in sent if isinstance(draft, Draft)]
        if None in made or len(made) < len(sent):
            return each
        topics = [topic for topic, _, _ in sent]
        return [[*zip(topics, data, strict=True)] for data in zip(*made, strict=True)]

    def save(self) -> dict[tuple[str, str, type[Signal]], dict[str, Any]]:
        """What the makers remember, by slot, output and type of the sample."""
        made = {key: maker for key, maker in self._makers.items() if not isinstance(maker, partial)}
        return {key: {k: v for k, v in vars(m).items() if k != "source"} for key, m in made.items()}

    def load(self, state: dict[tuple[str, str, type[Signal]], dict[str, Any]]) -> None:
        """Take on a state that `save` gave."""
        for key, kept in state.items():
            vars(self._maker(*key)).update(kept)

    def _maker(self, slot: str, output: str, kind: type[Signal]) -> Callable[[Any], Iterator[Sent]]:
        key = (slot, output, kind)
        if key not in self._makers:
            source = Source(self.file.make, self.machine, slot, output)
            maker = MAKERS.get(kind)
            self._makers[key] = partial(own_messages, source) if maker is None else maker(source)
        return self._makers[key]
