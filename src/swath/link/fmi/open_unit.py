"""An FMU made ready to run, in this process."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from swath.link.fmi.description import Description, Variable, need_library
from swath.link.fmi.instance import Instance, Steps
from swath.link.fmi.version2 import Instance2
from swath.link.fmi.version3 import Instance3


class Unit(Protocol):
    """What the level needs of an FMU, wherever it runs; a composite of several has the same verbs.

    notes: what the user should know, once it has started
    """

    @property
    def notes(self) -> list[str]: ...
    def start(self, starts: Mapping[str, Any]) -> list[float]: ...
    def run(self, steps: Steps) -> list[float]: ...
    def save(self) -> Any: ...
    def load(self, state: Any) -> None: ...
    def close(self) -> None: ...


def make_instance(
    description: Description,
    name: str,
    inputs: Sequence[Variable],
    outputs: Sequence[Variable],
    folder: Path | None = None,
) -> Instance:
    """An instance in this process. InputError without a binary, FmuError where that cannot be loaded.

    folder: where the caller unpacked it and removes it; None = the instance does both
    """
    need_library(description)
    version = Instance2 if description.major == 2 else Instance3
    return version(description, name, inputs, outputs, folder)
