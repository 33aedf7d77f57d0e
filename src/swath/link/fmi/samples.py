"""Samples of output ports from the numbers of an FMU."""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np

from swath.core.component import Outputs, Port
from swath.link.fmi.errors import FmuError
from swath.link.fmi.wiring import Out, Wiring
from swath.signals import CropAhead, CropEdge, Fix, HeaderState, Scan, ScanTruth, Signal
from swath.signals.flat import build

# Fields in which nan means that there is nothing; `*` = every field.
MAY_BE_NAN: dict[type[Signal], tuple[str, ...]] = {
    CropEdge: ("*",),
    Fix: ("*",),
    CropAhead: ("height", "extinction"),
    Scan: ("ranges", "intensity"),
    ScanTruth: ("points",),
    HeaderState: ("readings",),
}
_ECHOES = ("ranges", "intensity")


class Samples:
    """Builds the samples of a wiring. Raises FmuError where the FMU gives what is not a number."""

    def __init__(self, wiring: Wiring) -> None:
        self._ports = {p.name: p for p in wiring.output_ports}
        self._constants = wiring.constants
        self._outs: dict[str, list[tuple[Out, int, int, bool]]] = {name: [] for name in self._ports}
        at = 0
        for out in wiring.outputs:
            self._outs[out.port].append((out, at, at + out.variable.size, self._may_be_nan(out)))
            at += out.variable.size

    def build(self, t: int, numbers: Sequence[float]) -> Outputs:
        """The outputs at t [ns] from the flat list."""
        made: Outputs = {}
        for name, port in self._ports.items():
            values: dict[str, Any] = dict(self._constants.get(name, {}))
            for out, start, stop, may_be_nan in self._outs[name]:
                values[out.field.name] = self._value(out, numbers[start:stop], may_be_nan)
            made[name] = build(port.signal, t, _shaped(port, values))
        return made

    def _value(self, out: Out, numbers: Sequence[float], may_be_nan: bool) -> Any:
        if not may_be_nan and not all(map(isfinite, numbers)):
            bad = next(x for x in numbers if not isfinite(x))
            raise FmuError(f"its variable {out.variable.name} is {bad}, expected a finite number")
        if out.variable.is_array:
            return np.asarray(numbers, dtype=np.float64) * out.scale.factor + out.scale.offset
        value = numbers[0]
        return value if out.scale.is_same else out.scale.ours(value)

    def _may_be_nan(self, out: Out) -> bool:
        fields = MAY_BE_NAN.get(self._ports[out.port].signal, ())
        return "*" in fields or out.field.name in fields


def _shaped(port: Port, values: Mapping[str, Any]) -> Mapping[str, Any]:
    """Flat arrays of a scan get one row per beam."""
    if port.signal is not Scan:
        return values
    beams = len(values.get("beam_t", ())) or 1
    return {k: np.reshape(v, (beams, -1)) if k in _ECHOES else v for k, v in values.items()}
