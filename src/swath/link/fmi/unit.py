"""An FMU made ready to run: in this process, or in one of its own."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from swath.link.fmi.child_process import ChildProcess
from swath.link.fmi.description import Description, Variable, need_library
from swath.link.fmi.instance import Steps
from swath.link.fmi.make_instance import make_instance


class Unit(Protocol):
    """What the level needs of an FMU, wherever it runs; a composite of several has the same verbs.

    notes: what the user should know, once it has started; after `close`, `start` begins anew
    """

    @property
    def notes(self) -> Sequence[str]:
        """Whole sentences for the user."""

    def start(self, starts: Mapping[str, Any]) -> list[float]:
        """Outputs at the start, after setting start values."""

    def run(self, steps: Steps) -> list[float]:
        """Outputs after the steps."""

    def save(self) -> Any:
        """State of the unit."""

    def load(self, state: Any) -> None:
        """Take on a state."""

    def close(self) -> None:
        """End the unit."""


def make_unit(
    fmu: Description,
    name: str,
    inputs: Sequence[Variable],
    outputs: Sequence[Variable],
    *,
    own: bool,
    timeout_s: float,
) -> Unit:
    """One FMU. own: in a process of its own, whose answers may take timeout_s.

    Foreign code runs when it is started, not here. An FMU that allows one instance per process gets its own
    process. InputError without a binary for this system.
    """
    need_library(fmu)
    if fmu.one_per_process and not own:
        note = "it allows one instance per process and runs in its own process"
        return ChildProcess(fmu, name, inputs, outputs, timeout_s, [note])
    if own:
        return ChildProcess(fmu, name, inputs, outputs, timeout_s)
    return make_instance(fmu, name, inputs, outputs)
