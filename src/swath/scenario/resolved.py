"""What a scenario chose: levels with their parameters, machines, the field."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swath.core.asked import unasked
from swath.core.registry import Level
from swath.documents.validation import adapter_of
from swath.scenario.sections import (
    FieldCommon,
    Limit,
    MachineCommon,
    RealTime,
    SlotCommon,
    StartAlongEdge,
    StartPose,
)
from swath.scenario.slots import SlotKind


@dataclass(frozen=True)
class UnreadParams:
    """Parameters of a level whose code was left unread, as they were written."""

    data: Mapping[str, Any]


@dataclass(frozen=True)
class LevelChoice:
    """A chosen level and its validated parameters; `level` is the name, or `/path/file.py:Class`."""

    level: str
    found: Level
    params: Any

    def make(self, setup: Any) -> Any:
        """The component, or the field part, of this level."""
        return self.found.component(self.params, setup)

    @unasked
    def plain(self) -> dict[str, Any]:
        """Give the keys as a file would have them."""
        return {"level": self.level, **_plain(self.params)}


@dataclass(frozen=True)
class SlotChoice(LevelChoice):
    """A chosen level in a slot of a machine.

    kind: kind of the slot
    wires: by input port (full slot name such as `combine.lidar`, output port): the wires of the kind, with
        those that the scenario states (`common.wires`) in their place
    """

    common: SlotCommon
    kind: SlotKind
    wires: Mapping[str, tuple[str, str]] = dataclasses.field(default_factory=dict)

    @unasked
    def plain(self) -> dict[str, Any]:
        """Give the keys as a file would have them."""
        common = self.common.model_dump(mode="json", exclude_none=True)
        common["wires"] = {name: ".".join(self.wires[name]) for name in self.common.wires}
        return {"level": self.level, **common, **_plain(self.params)}


@dataclass(frozen=True)
class MachineSection:
    """One machine.

    slots: its slots in execution order
    off: slots of its type that it lacks
    sheet: its data sheet
    present: names of all its slots, also where only some of them are built
    """

    name: str
    common: MachineCommon
    sheet: Path
    start: StartAlongEdge | StartPose
    slots: Mapping[str, SlotChoice]
    off: tuple[str, ...] = ()
    present: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.present:
            object.__setattr__(self, "present", tuple(self.slots))

    def has(self, kind: str) -> bool:
        """True where it has a slot of a kind."""
        return any(choice.kind.name == kind for choice in self.slots.values())

    @unasked
    def plain(self) -> dict[str, Any]:
        """Give the keys as a file would have them."""
        written: dict[str, Any] = {name: choice.plain() for name, choice in self.slots.items()}
        start = self.start.model_dump(mode="json")
        written |= dict.fromkeys(self.off, "off")
        return {**self.common.model_dump(mode="json"), "start": start, **written}


@dataclass(frozen=True)
class Expectation:
    """A limit.

    subject: a machine's name, or `field`
    name: name of a metric, or of a column of the tracks
    former: its name in the file where that is an earlier one
    """

    subject: str
    name: str
    limit: Limit
    former: str = field(default="", compare=False)


@dataclass(frozen=True)
class RealTimeSection:
    """How a run is paced.

    cheaper: (full slot name such as `combine.lidar`, level to take instead), in this order
    """

    common: RealTime
    cheaper: tuple[tuple[str, SlotChoice], ...] = ()

    @unasked
    def plain(self) -> dict[str, Any]:
        """Give the keys as a file would have them."""
        steps = [{"slot": s, "level": c.level, **_plain(c.params)} for s, c in self.cheaper]
        return {**self.common.model_dump(mode="json", exclude_none=True), "degrade": steps}


@dataclass(frozen=True)
class FieldSection:
    """The field.

    folder: an imported field, from which terrain and stand come unless written here
    edges: the initial edges of the crop by name, `edge` where there is the one of `field.edge`
    common: the other keys; the seed None = that of the run
    """

    folder: Path | None
    terrain: LevelChoice | None
    stand: LevelChoice | None
    edges: Mapping[str, Any]
    obstacles: tuple[Any, ...] = ()
    boundary: Any = None
    weather: Any = None
    common: FieldCommon = dataclasses.field(default_factory=FieldCommon)

    @unasked
    def plain(self) -> dict[str, Any]:
        """Give the keys as a file would have them."""
        written = {
            **self.common.model_dump(mode="json", exclude_none=True),
            "folder": None if self.folder is None else str(self.folder),
            "terrain": None if self.terrain is None else self.terrain.plain(),
            "stand": None if self.stand is None else self.stand.plain(),
            **self._plain_edges(),
            "obstacles": [_plain(o) for o in self.obstacles],
            "boundary": None if self.boundary is None else _plain(self.boundary),
            "weather": None if self.weather is None else _plain(self.weather),
        }
        return {key: value for key, value in written.items() if value not in (None, [], {})}

    def _plain_edges(self) -> dict[str, Any]:
        plain = {name: _plain(edge) for name, edge in self.edges.items()}
        return plain if list(plain) == ["edge"] else {"edges": plain}


def _plain(params: Any) -> dict[str, Any]:
    if isinstance(params, UnreadParams):
        return dict(params.data)
    if params is None or not dataclasses.is_dataclass(params):
        return {}
    written: dict[str, Any] = adapter_of(params.__class__).dump_python((params,), mode="json")[0]
    return {f.name: written[f.name] for f in dataclasses.fields(params) if f.init}
