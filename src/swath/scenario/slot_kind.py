"""What a kind of slot is."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from swath.core.component import Port


@dataclass(frozen=True)
class SlotKind:
    """One kind of slot.

    packages: where its levels lie; level: the default one; rate_hz: the default rate
    outputs: ports that every level of it has; more: that some levels have
    wires: input port -> (slot kind, output port) of the same machine
    is_control: told the geometry of the machine, never the truth
    is_plural: a machine may have several of it, each named `kind_something`
    is_exchangeable: its level may change while a run goes on, it keeps nothing of motion and masses
    link_adapter: `module:Class` that completes a part from elsewhere (FMU, ROS 2 node, log) in this slot
    """

    name: str
    packages: tuple[str, ...]
    level: str
    rate_hz: float
    outputs: tuple[Port, ...]
    wires: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    more: tuple[Port, ...] = ()
    is_control: bool = False
    is_plural: bool = False
    is_exchangeable: bool = False
    link_adapter: str = ""
