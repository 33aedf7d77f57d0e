"""Straw and grain of a process from elsewhere: it knows masses but no field, so they are laid here."""

from collections.abc import Sequence
from typing import Any

from swath.core.abilities import Closes, HasNotes, StepsAnyLength
from swath.core.component import Component, Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.together import plain
from swath.field.site_setup import SiteSetup
from swath.machine.process.straw_outlet import StrawOutlet
from swath.machine.process.unloading_pipe import UnloadingPipe
from swath.signals import MachineLoad, MachineState

WIDTH, STEP = 1.4, 0.25  # of the swath [m], as the built-in levels have it


class LaidStraw(KeepsState):
    """A process, and what its load grows by: `dropped_straw` laid as a swath behind the machine,
    `unloaded_grain` poured out at the end of the unloading pipe.
    """

    kept = ("part", "_outlet", "_left")

    def __init__(self, part: Component, setup: SiteSetup) -> None:
        self.part = part
        self.outputs = part.outputs
        self._passes_state = any(p.name == "state" for p in part.inputs)
        own = () if self._passes_state else (Port("state", MachineState),)
        self.inputs = (*part.inputs, *own)
        self._outlet = StrawOutlet(setup.field, setup.machine.body[0], WIDTH, STEP, True)
        self._pipe = UnloadingPipe(setup)
        self._left = 0.0, 0.0

    @property
    def notes(self) -> Sequence[str]:
        """Notes of the process."""
        return self.part.notes if isinstance(self.part, HasNotes) else ()

    @property
    def steps_any_length(self) -> bool:
        """Whether the process takes steps of any length."""
        return isinstance(self.part, StepsAnyLength) and self.part.steps_any_length

    def reset(self, stream: Stream) -> Outputs:
        """Nothing laid."""
        self._outlet.reset()
        outputs = self.part.reset(stream)
        self._left = _left(outputs)
        return outputs

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Step the process, lay what it dropped and pour out what it unloaded."""
        passed = inputs if self._passes_state else {k: v for k, v in inputs.items() if k != "state"}
        outputs = self.part.step(t, dt, passed)
        before, self._left = self._left, _left(outputs)
        state = inputs.get("state")
        if isinstance(state, tuple) and state:
            state = state[-1]
        if isinstance(state, MachineState):
            self._outlet.drop(max(self._left[0] - before[0], 0.0), plain(state.pose))
            self._pipe.pour(max(self._left[1] - before[1], 0.0), state)
        return outputs

    def close(self) -> None:
        """Let go of the process."""
        if isinstance(self.part, Closes):
            self.part.close()


def _left(outputs: dict[str, Any]) -> tuple[float, float]:
    """Straw dropped and grain unloaded so far [kg]."""
    load = outputs.get("load")
    return (load.dropped_straw, load.unloaded_grain) if isinstance(load, MachineLoad) else (0.0, 0.0)
