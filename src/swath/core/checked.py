"""What a part that is not swath's own sends is checked before anybody reads it: types, finiteness, ranges.

A part of a user, of a package or behind a link may give anything. swath's own parts are held by tests, so
that only the others pay for this.
"""

from collections.abc import Callable, Sequence
from math import inf, isfinite
from typing import Any

import numpy as np

from swath.core.component import Outputs, Port
from swath.core.errors import InputError, shortened
from swath.core.fault import NOTHING, Fault, FaultyOutput
from swath.core.frames import Pose
from swath.core.layout import layout
from swath.core.signal import Quantity, Signal, per_signal, span_of

Check = Callable[[Any], bool]


class CheckedOutput(FaultyOutput):
    """Checks the outputs of one slot before a fault is at work on them, if one is.

    slot: its full name
    part: where the component comes from, `file.py:Class` or a level
    """

    def __init__(self, slot: str, part: str, outputs: Sequence[Port], fault: Fault = NOTHING) -> None:
        super().__init__(fault, outputs)
        self.slot, self.part = slot, part
        self._signals = {port.name: port.signal for port in outputs}

    def pass_on(self, t: int, outputs: Outputs) -> Outputs:
        """As `FaultyOutput`. InputError for what no sample can hold."""
        if not isinstance(outputs, dict) or not outputs.keys() <= self._signals.keys():
            raise self._error("", outputs, f"expected a dict of {', '.join(self._signals)}")
        for name, sample in outputs.items():
            signal = self._signals[name]
            if not isinstance(sample, signal):
                raise self._error(f".{name}", sample, f"expected a {signal.__name__}")
            if (wrong := misfit(sample)) is not None:
                field, expected = wrong
                raise self._error(f".{name}.{field}", _wrong(sample, field), f"expected {expected}")
        return outputs if self.fault is NOTHING else super().pass_on(t, outputs)

    def _error(self, key: str, value: Any, expected: str) -> InputError:
        given = value if isinstance(value, float | int) else shortened(repr(value), 80)
        return InputError(f"{self.slot}{key}", given, expected, file=self.part)


def misfit(sample: Signal) -> tuple[str, str] | None:
    """The first field of a sample that holds what it cannot, and what was expected there."""
    for field, fits, expected in _checks(type(sample)):
        try:
            is_right = fits(getattr(sample, field))
        except (TypeError, ValueError, AttributeError):
            is_right = False
        if not is_right:
            return field, expected
    return None


def _wrong(sample: Signal, field: str) -> Any:
    """The value of a field; of an array the first number that is out of range, if that is what is wrong."""
    value, (low, high) = getattr(sample, field), span_of(field, layout(type(sample))[field].quantity)
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
        outside = value[(value < low) | (value > high)]
        return outside[0].item() if outside.size else value
    return value


@per_signal
def _checks(signal: type[Signal]) -> list[tuple[str, Check, str]]:
    """For each field of a sample type: its name, what holds for a right value, and that in words."""
    found = list[tuple[str, Check, str]]()
    for name, field in layout(signal).items():
        if not field.is_noted:
            continue
        kind, quantity = field.kind, field.quantity
        low, high = span_of(name, quantity)
        what = "finite" if (low, high) == (-inf, inf) else f"from {low:g} to {high:g}"
        nan = f", or nan: {quantity.nan}" if quantity.nan else ""
        if kind == "bool":
            found.append((name, lambda value: value in (True, False), "true or false"))
        elif kind in ("real", "int"):
            found.append((name, _number(low, high, bool(nan)), f"a number, {what}{nan}"))
        elif kind == "pose":
            found.append((name, _pose(low, high), f"a Pose, its place {what}"))
        elif kind == "array":
            shape = f"({', '.join(map(str, quantity.shape))})"
            found.append((name, _array(low, high, quantity), f"an array {shape}, {what}{nan}"))
    return found


def _number(low: float, high: float, may_be_nan: bool) -> Check:
    if may_be_nan:
        return lambda value: (isfinite(value) and low <= value <= high) or value != value
    return lambda value: isfinite(value) and low <= value <= high


def _array(low: float, high: float, quantity: Quantity) -> Check:
    dimensions, least = len(quantity.shape), np.fmin.reduce if quantity.nan else np.minimum.reduce
    most = np.fmax.reduce if quantity.nan else np.maximum.reduce

    def fits(value: Any) -> bool:
        if value.dtype.kind not in "fiub" or value.ndim != dimensions:
            return False
        if value.dtype.kind == "u" and high == np.iinfo(value.dtype).max:
            return True  # of a picture: no pixel is looked at
        if value.dtype.kind in "iu":
            return value.size == 0 or bool(low <= value.min() and value.max() <= high)
        ends = least(value, axis=None, initial=inf), most(value, axis=None, initial=-inf)
        return bool(-inf != ends[0] >= low and inf != ends[1] <= high)

    return fits


def _pose(low: float, high: float) -> Check:
    def fits(value: Pose) -> bool:
        place = value.position
        is_within = ((low <= place) & (place <= high) & np.isfinite(place)).all()
        return bool(is_within and np.isfinite(value.rotation).all())

    return fits
