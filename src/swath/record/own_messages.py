"""Any sample as one `swath_msgs/msg/<Class>` with all its fields, in the frame that it declares."""

from collections.abc import Iterator
from typing import Any

from swath.record.message_factory import plain_names
from swath.record.messages import Sent, Source
from swath.record.templates import Draft
from swath.signals import Signal


def own_messages(source: Source, signal: Signal) -> Iterator[Sent]:
    """`swath_msgs/msg/<Class>` of any signal."""
    names = plain_names(type(signal))

    def build() -> Any:
        return source.make.of_signal(signal, source.frame_of(type(signal)))

    if names is None:
        yield Sent(source.topic, build())
    else:
        yield Sent(source.topic, Draft(signal.t, names, [getattr(signal, name) for name in names], build))
