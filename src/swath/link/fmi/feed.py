"""Numbers for the inputs of an FMU, sub-step by sub-step, so that amounts neither vanish nor double."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from swath.core.component import Inputs
from swath.core.schedule import NS
from swath.link.fmi.errors import FmuError
from swath.link.fmi.wiring import Into
from swath.signals import Signal
from swath.signals.flat import POSE


class Feed:
    """Holds the newest values, and spreads amounts over the sub-steps in which they arose.

    A sample of amounts covers the time (t - dt, t]. What lies before the step of the FMU counts at its start.
    silent: ports of which nothing came
    """

    def __init__(self, inputs: Sequence[Into], starts: Sequence[float]) -> None:
        self._inputs = inputs
        self._readers = [_reader(i.field.name) for i in inputs]
        self._starts = list(starts)
        self._places = _places(inputs)
        self._amounts = [k for k, i in enumerate(inputs) if i.mode != "last"]
        self.reset()

    def reset(self) -> None:
        """Start values, nothing fed."""
        self._numbers = list(self._starts)
        self._samples: dict[str, list[tuple[int, int, Signal]]] = {}
        self.silent: list[str] = []

    def take(self, t: int, dt: int, inputs: Inputs) -> None:
        """The inputs of a step from t to t + dt [ns]."""
        for k, into in enumerate(self._inputs):
            sample = inputs.get(into.port) if into.mode == "last" else None
            if into.mode == "last" and sample is None and into.port not in self.silent:
                self.silent.append(into.port)
            if isinstance(sample, tuple):
                sample = sample[-1] if sample else None
            if sample is not None:
                self._put(k, self._readers[k](sample))
        for port in {self._inputs[k].port for k in self._amounts}:
            self._samples[port] = [_span(s, t, t + dt) for s in inputs.get(port) or ()]

    def numbers(self, a: int, b: int) -> list[float]:
        """All inputs for the sub-step from a to b [ns], arrays element by element."""
        for k in self._amounts:
            into = self._inputs[k]
            total = 0.0
            for start, end, sample in self._samples.get(into.port, ()):
                overlap = min(end, b) - max(start, a)
                if overlap > 0:
                    total += self._readers[k](sample) * (overlap / (end - start))
            self._put(k, total * NS / (b - a) if into.mode == "rate" else total)
        return list(self._numbers)

    def save(self) -> list[float]:
        """The values held."""
        return list(self._numbers)

    def load(self, numbers: Sequence[float]) -> None:
        """Back to them."""
        self._numbers = list(numbers)

    def _put(self, k: int, value: Any) -> None:
        into, (start, stop) = self._inputs[k], self._places[k]
        if into.variable.is_array:
            numbers = np.asarray(value, dtype=np.float64).ravel()
            if len(numbers) != stop - start:
                raise FmuError(
                    f"{into.port}.{into.field.name} has {len(numbers)} numbers, "
                    f"but {into.variable.name} of the FMU takes {stop - start}"
                )
            scaled = numbers if into.scale.is_same else (numbers - into.scale.offset) / into.scale.factor
            self._numbers[start:stop] = scaled.tolist()
        else:
            self._numbers[start] = into.scale.theirs(float(value))


def _span(sample: Signal, start: int, end: int) -> tuple[int, int, Signal]:
    """The time that a sample of amounts covers within a step [ns]."""
    first = sample.t - round(float(getattr(sample, "dt", 0.0)) * NS)
    first, last = max(first, start), min(sample.t, end)
    if last <= first:
        return start, start + 1, sample
    return first, last, sample


def _places(inputs: Sequence[Into]) -> list[tuple[int, int]]:
    places, at = [], 0
    for into in inputs:
        places.append((at, at + into.variable.size))
        at += into.variable.size
    return places


def _reader(name: str) -> Callable[[Any], Any]:
    """A quick way to one number of a sample."""
    first, _, part = name.partition(".")
    if not part:
        return lambda sample: getattr(sample, first)
    index = list(POSE).index(part)
    if index < 3:
        return lambda sample: getattr(sample, first).position[index]
    return lambda sample: getattr(sample, first).euler()[index - 3]
