"""An FMU as a component: feeds it, steps it, builds samples, and says in one line what went wrong."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.component import Inputs, Outputs, State
from swath.core.errors import SwathError
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.link.fmi.calls import FmuError
from swath.link.fmi.feed import Feed
from swath.link.fmi.unit import Unit
from swath.link.fmi.wiring import KNOWN, Wiring
from swath.signals.flat import build
from swath.signals.setup import LinkSetup


class FmuPart:
    """Fills a slot with an FMU, or with a composite that looks like one.

    step: of the FMU within the slot's period [ns]; notes: about the FMU itself
    """

    def __init__(
        self,
        wiring: Wiring,
        unit: Unit,
        setup: LinkSetup,
        file: Path,
        step: int,
        notes: Sequence[str],
        *,
        passes_nan: bool = False,
    ) -> None:
        self.inputs, self.outputs = wiring.input_ports, wiring.output_ports
        self._wiring, self._unit, self._step_ns = wiring, unit, step
        self._slot, self._file, self._who = setup.slot, file.name, f"{setup.name}: {file.name}"
        self._notes = (*notes, *wiring.notes)
        starts = [i.variable.numbers(wiring.starts.get(i.variable.name)) for i in wiring.inputs]
        flat = [x for numbers in starts for x in numbers]
        self._feed = Feed(wiring.inputs, flat, passes_nan=passes_nan)

    @property
    def notes(self) -> list[str]:
        """What the user should know about the run."""
        silent = [f"nothing comes from {port}, its slot is off or silent" for port in self._feed.silent]
        held = [
            f"{name} was nan in {count} steps: the FMU got the value before; {name}{KNOWN} would tell it"
            for name, count in self._feed.held.items()
            if not self._is_told(name)
        ]
        notes = (*self._notes, *self._unit.notes, *silent, *held)
        return [f"{self._slot}: {self._file}: {note}" for note in notes]

    def reset(self, stream: Stream) -> Outputs:
        """The FMU initialised with its start values; its outputs at t = 0."""
        self._feed.reset()
        with self._named(" at the start"):
            return samples_of(self._wiring, 0, self._unit.start(self._wiring.starts))

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The FMU from t to t + dt, in sub-steps when they are shorter."""
        with self._named(f" at t = {t / NS:.4g} s" if t else " at the start"):
            self._feed.take(t, dt, inputs)
            end = t + dt
            spans = pairwise([*range(t, end, self._step_ns), end])
            steps = [(at / NS, (to - at) / NS, self._feed.numbers(at, to)) for at, to in spans]
            numbers = self._unit.run(steps)
            try:
                return samples_of(self._wiring, end, numbers)
            except FmuError as error:
                nan = [f"{name} is nan ({means})" for name, means in self._feed.unknown.items()]
                raise FmuError("; ".join([str(error), *nan])) from error

    def _is_told(self, name: str) -> bool:
        """Whether the FMU has an input that says so when it holds a value."""
        return any(i.mode == "known" and f"{i.port}.{i.field.name}" == name for i in self._wiring.inputs)

    def save(self) -> State:
        """The state of the FMU. SwathError for an FMU that cannot save it."""
        with self._named():
            return {"fmu": self._unit.save(), "feed": self._feed.save()}

    def load(self, state: State) -> None:
        """Back to a saved moment."""
        self._feed.load(state["feed"])
        with self._named():
            self._unit.load(state["fmu"])

    def close(self) -> None:
        """Let go of the FMU."""
        self._unit.close()

    @contextmanager
    def _named(self, when: str = "") -> Iterator[None]:
        """Errors of the FMU with slot, file and time."""
        try:
            yield
        except FmuError as error:
            raise SwathError(f"{self._who}{when}: {error}") from error


def samples_of(wiring: Wiring, t: int, numbers: Sequence[float]) -> Outputs:
    """The outputs at t [ns] from the flat list. FmuError where the FMU gives what is not a number."""
    values = {p.name: dict(wiring.constants.get(p.name, {})) for p in wiring.output_ports}
    at = 0
    for out in wiring.outputs:
        variable, scale = out.variable, out.scale
        own, at = numbers[at : at + variable.size], at + variable.size
        if not out.field.quantity.nan and not all(map(isfinite, own)):
            bad = next(x for x in own if not isfinite(x))
            raise FmuError(f"its variable {variable.name} is {bad}, expected a finite number")
        if variable.is_array:
            value: Any = scale.ours(np.asarray(own, dtype=np.float64))
        else:
            value = own[0] if scale.is_same else scale.ours(own[0])
        values[out.port][out.field.name] = value
    return {p.name: build(p.signal, t, values[p.name]) for p in wiring.output_ports}
