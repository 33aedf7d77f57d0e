"""Numbers for the inputs of an FMU, sub-step by sub-step, so that amounts neither vanish nor double."""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import accumulate
from math import isnan
from typing import Any

import numpy as np

from swath.core.component import Inputs
from swath.core.schedule import NS
from swath.link.fmi.calls import FmuError
from swath.link.fmi.wiring import Into
from swath.signals import Signal
from swath.signals.flat import read


class Feed:
    """Holds the newest values, and spreads amounts over the sub-steps in which they arose.

    A sample of amounts covers the time (t - dt, t]. What lies before the step of the FMU counts at its start.
    A single number that is nan, which says that there is none, leaves the FMU the value before, at first its
    start value; with passes_nan it gets nan.
    silent: ports of which nothing came; unknown: port.field that is nan now -> what nan means
    held: port.field -> steps in which the value before was held
    """

    def __init__(self, inputs: Sequence[Into], starts: Sequence[float], *, passes_nan: bool = False) -> None:
        ends = accumulate(i.variable.size for i in inputs)
        placed = [
            (into, slice(end - into.variable.size, end)) for into, end in zip(inputs, ends, strict=True)
        ]
        self._held = [p for p in placed if p[0].mode in ("last", "known")]
        self._amounts = [p for p in placed if p[0].mode not in ("last", "known")]
        self._starts, self._passes_nan = list(starts), passes_nan
        self.reset()

    def reset(self) -> None:
        """Start values, nothing fed."""
        self._numbers = list(self._starts)
        self._samples: dict[str, list[tuple[int, int, Signal]]] = {}
        self.silent: list[str] = []
        self.unknown: dict[str, str] = {}
        self.held: Counter[str] = Counter()

    def take(self, t: int, dt: int, inputs: Inputs) -> None:
        """The inputs of a step from t to t + dt [ns]."""
        self.unknown = {}
        for into, place in self._held:
            sample = inputs.get(into.port)
            if sample is None and into.port not in self.silent:
                self.silent.append(into.port)
            if isinstance(sample, tuple):
                sample = sample[-1] if sample else None
            if sample is not None:
                self._take(into, place, read(sample, into.field.name))
        for port in {into.port for into, _ in self._amounts}:
            self._samples[port] = [_span(s, t, t + dt) for s in inputs.get(port) or ()]

    def numbers(self, a: int, b: int) -> list[float]:
        """All inputs for the sub-step from a to b [ns], arrays element by element."""
        for into, place in self._amounts:
            total = 0.0
            for start, end, sample in self._samples.get(into.port, ()):
                overlap = min(end, b) - max(start, a)
                if overlap > 0:
                    total += read(sample, into.field.name) * (overlap / (end - start))
            self._put(into, place, total * NS / (b - a) if into.mode == "rate" else total)
        return list(self._numbers)

    def save(self) -> dict[str, Any]:
        """The values held."""
        return {"numbers": list(self._numbers), "held": dict(self.held)}

    def load(self, state: Mapping[str, Any]) -> None:
        """Back to them."""
        self._numbers, self.held = list(state["numbers"]), Counter(state["held"])

    def _take(self, into: Into, place: slice, value: Any) -> None:
        is_known = into.field.kind == "array" or not isnan(value)
        name = f"{into.port}.{into.field.name}"
        if into.mode == "known":
            self._numbers[place.start] = float(is_known)
        elif is_known or not into.field.quantity.nan:
            self._put(into, place, value)
        else:
            self.unknown[name] = into.field.quantity.nan
            if self._passes_nan:
                self._put(into, place, value)
            else:
                self.held[name] += 1

    def _put(self, into: Into, place: slice, value: Any) -> None:
        if not into.variable.is_array:
            self._numbers[place.start] = into.scale.theirs(float(value))
            return
        numbers = np.asarray(value, dtype=np.float64).ravel()
        if len(numbers) != into.variable.size:
            raise FmuError(
                f"{into.port}.{into.field.name} has {len(numbers)} numbers, "
                f"but {into.variable.name} of the FMU takes {into.variable.size}"
            )
        self._numbers[place] = (numbers if into.scale.is_same else into.scale.theirs(numbers)).tolist()


def _span(sample: Signal, start: int, end: int) -> tuple[int, int, Signal]:
    """The time that a sample of amounts covers within a step [ns]."""
    covered = round(float(getattr(sample, "dt", 0.0)) * NS)
    first, last = max(sample.t - covered, start), min(sample.t, end)
    return (start, start + 1, sample) if last <= first else (first, last, sample)
