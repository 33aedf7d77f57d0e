"""Samples of output ports from the numbers of an FMU."""

from collections.abc import Sequence
from math import isfinite
from typing import Any

import numpy as np

from swath.core.component import Outputs
from swath.link.fmi.errors import FmuError
from swath.link.fmi.wiring import Out, Wiring
from swath.signals.flat import build


class Samples:
    """Builds the samples of a wiring. Raises FmuError where the FMU gives what is not a number."""

    def __init__(self, wiring: Wiring) -> None:
        self._ports = {p.name: p for p in wiring.output_ports}
        self._constants = wiring.constants
        self._outs: dict[str, list[tuple[Out, int, int, bool]]] = {name: [] for name in self._ports}
        at = 0
        for out in wiring.outputs:
            self._outs[out.port].append((out, at, at + out.variable.size, bool(out.field.quantity.nan)))
            at += out.variable.size

    def build(self, t: int, numbers: Sequence[float]) -> Outputs:
        """The outputs at t [ns] from the flat list."""
        made: Outputs = {}
        for name, port in self._ports.items():
            values: dict[str, Any] = dict(self._constants.get(name, {}))
            for out, start, stop, may_be_nan in self._outs[name]:
                values[out.field.name] = self._value(out, numbers[start:stop], may_be_nan)
            made[name] = build(port.signal, t, values)
        return made

    def _value(self, out: Out, numbers: Sequence[float], may_be_nan: bool) -> Any:
        if not may_be_nan and not all(map(isfinite, numbers)):
            bad = next(x for x in numbers if not isfinite(x))
            raise FmuError(f"its variable {out.variable.name} is {bad}, expected a finite number")
        if out.variable.is_array:
            return np.asarray(numbers, dtype=np.float64) * out.scale.factor + out.scale.offset
        value = numbers[0]
        return value if out.scale.is_same else out.scale.ours(value)
