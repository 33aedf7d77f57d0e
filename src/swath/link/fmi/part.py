"""An FMU as a component: feeds it, steps it, builds samples, and says in one line what went wrong."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from swath.core.component import Inputs, Outputs, State
from swath.core.errors import SwathError
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.link.fmi.errors import FmuError
from swath.link.fmi.feed import Feed
from swath.link.fmi.open_unit import Unit
from swath.link.fmi.samples import Samples
from swath.link.fmi.wiring import Wiring
from swath.signals.setup import LinkSetup


class FmuPart:
    """Fills a slot with an FMU, or with a composite that looks like one.

    step: of the FMU within the slot's period [ns]; notes: about the FMU itself
    """

    def __init__(
        self, wiring: Wiring, unit: Unit, setup: LinkSetup, file: Path, step: int, notes: Sequence[str]
    ) -> None:
        self.inputs, self.outputs = wiring.input_ports, wiring.output_ports
        self._wiring, self._unit, self._step_ns = wiring, unit, step
        self._slot, self._who = setup.slot, f"{setup.name}: {file.name}"
        self._file = file.name
        self._notes = (*notes, *wiring.notes)
        self._feed = Feed(wiring.inputs, start_numbers(wiring))
        self._samples = Samples(wiring)

    @property
    def notes(self) -> list[str]:
        """What the user should know about the run."""
        silent = [f"nothing comes from {port}, its slot is off or silent" for port in self._feed.silent]
        notes = (*self._notes, *self._unit.notes, *silent)
        return [f"{self._slot}: {self._file}: {note}" for note in notes]

    def reset(self, stream: Stream) -> Outputs:
        """The FMU initialised with its start values; its outputs at t = 0."""
        self._feed.reset()
        made: Outputs = self._guarded(
            0, lambda: self._samples.build(0, self._unit.start(self._wiring.starts))
        )
        return made

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The FMU from t to t + dt, in sub-steps when they are shorter."""
        made: Outputs = self._guarded(t, lambda: self._run(t, dt, inputs))
        return made

    def save(self) -> State:
        """The state of the FMU. SwathError for an FMU that cannot save it."""
        state = self._guarded(None, self._unit.save)
        return {"fmu": state, "feed": self._feed.save()}

    def load(self, state: State) -> None:
        """Back to a saved moment."""
        self._feed.load(state["feed"])
        self._guarded(None, lambda: self._unit.load(state["fmu"]))

    def close(self) -> None:
        """Let go of the FMU."""
        self._unit.close()

    def _run(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        self._feed.take(t, dt, inputs)
        steps, at, end = [], t, t + dt
        while at < end:
            to = min(at + self._step_ns, end)
            steps.append((at / NS, (to - at) / NS, self._feed.numbers(at, to)))
            at = to
        return self._samples.build(end, self._unit.run(steps))

    def _guarded(self, t: int | None, what: Any) -> Any:
        try:
            return what()
        except FmuError as error:
            when = "" if t is None else f" at t = {t / NS:.4g} s" if t else " at the start"
            raise SwathError(f"{self._who}{when}: {error}") from error


def start_numbers(wiring: Wiring) -> list[float]:
    """Start values of all inputs, as the FMU has them or as the scenario sets them; 0 where there is none."""
    found: list[float] = []
    for into in wiring.inputs:
        value = wiring.starts.get(into.variable.name, into.variable.start)
        numbers = [float(x) for x in value] if isinstance(value, list) else [float(value or 0.0)]
        found += numbers if len(numbers) == into.variable.size else numbers[:1] * into.variable.size
    return found
