"""What a scenario may choose from: the levels of every slot, and the parts of a field."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from swath.core.registry import Registry
from swath.scenario.machine_types import MACHINE_TYPES
from swath.scenario.slots import FIELD_LEVELS, REGISTRY, SLOTS, SlotKind, kind_of


@dataclass(frozen=True)
class Catalogue:
    """registry: levels by slot kind; slots: of a machine, in execution order

    field_levels: the default level of `terrain` and `stand`
    parts: `edge`, `obstacles` and `boundary` -> `module:NAME` of the type that describes one; `evaluators`
    and `bodies` -> of the functions that list them
    machine_types: type -> slot -> level of what a machine of the type has unasked
    """

    registry: Registry
    slots: tuple[SlotKind, ...]
    field_levels: Mapping[str, str]
    parts: Mapping[str, str]
    machine_types: Mapping[str, Mapping[str, str]]

    def part(self, name: str) -> Any:
        """The type of an edge, an obstacle or a boundary."""
        module, _, attribute = self.parts[name].partition(":")
        return getattr(import_module(module), attribute)

    def judged(self, own: Sequence[str] = (), base: Path | None = None) -> Any:
        """What evaluators make known: metrics, columns and events. own: those of a scenario, `file.py:Class`.

        InputError where one cannot be had.
        """
        return self.part("evaluators")(own, base)

    def default_level(self, kind: str) -> str:
        """The level that a slot, `terrain` or `stand` has when a scenario does not say."""
        return self.field_levels.get(kind) or self.slot(kind).level

    def slot(self, name: str) -> SlotKind:
        """The kind of slot of a name."""
        return next(s for s in self.slots if s.name == name)

    def kind_of(self, instance: str) -> SlotKind | None:
        """The kind of a slot by the name of an instance, such as `lidar_left`; None for no slot."""
        return kind_of(instance, self.slots)


PARTS = {
    "edge": "swath.field.edge:Edge",
    "obstacles": "swath.field.obstacles:Obstacle",
    "boundary": "swath.field.edge:Boundary",
    "evaluators": "swath.judge.catalogue:load_evaluators",
    "bodies": "swath.field.site_setup:known_as",
}
CATALOGUE = Catalogue(REGISTRY, SLOTS, FIELD_LEVELS, PARTS, MACHINE_TYPES)
