"""Samples as flat, named numbers with units: what a variable of somebody else's part can be mapped to.

speed, pose.x, pose.yaw ...   plain numbers: float, int or bool
ranges, beam_t ...            whole arrays
"""

from collections.abc import Mapping
from math import prod
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.layout import Field, layout
from swath.core.signal import Quantity, Signal, per_signal

Value = Any  # float, int, bool or an array, as the field's kind says
POSE = {"x": "m", "y": "m", "z": "m", "roll": "rad", "pitch": "rad", "yaw": "rad"}


@per_signal
def flat_fields(signal: type[Signal]) -> dict[str, Field]:
    """The numbers of a sample type by name, in the order of its fields: real, int, bool or array."""
    found: dict[str, Field] = {}
    for whole, field in layout(signal).items():
        if field.kind == "pose":
            for part, unit in POSE.items():
                name = f"{whole}.{part}"
                found[name] = Field(name, "real", Quantity(unit, f"{part} of {field.quantity.meaning}"))
        elif field.is_array or field.kind in ("real", "int", "bool"):
            found[whole] = field
    return found


@per_signal
def amounts(signal: type[Signal]) -> tuple[str, ...]:
    """Fields that belong to the step of their sample and add up over steps."""
    return tuple(name for name, field in flat_fields(signal).items() if field.quantity.is_amount)


@per_signal
def is_bulky(signal: type[Signal]) -> bool:
    """True when a sample has an array of several dimensions: too long for a list of named numbers."""
    return any(len(field.quantity.shape) > 1 for field in layout(signal).values())


def read(sample: Signal, name: str) -> Value:
    """One number of a sample, or an array. Raises InputError for a name it does not have."""
    if name not in flat_fields(type(sample)):
        raise InputError("variable", name, _expected(type(sample)))
    first, _, part = name.partition(".")
    value = getattr(sample, first)
    return pose_number(value, part) if part else value


def pose_number(pose: Pose, part: str) -> float:
    """One of the numbers `POSE` of a pose."""
    index = list(POSE).index(part)
    return float(pose.position[index] if index < 3 else pose.euler()[index - 3])


def build(signal: type[Signal], t: int, values: Mapping[str, Value]) -> Signal:
    """A sample at t [ns] from its flat numbers. Raises InputError where one is unknown or missing."""
    known = flat_fields(signal)
    if unknown := [name for name in values if name not in known]:
        raise InputError("variable", unknown[0], _expected(signal))
    missing = [f.name for f in known.values() if f.default is None and f.name not in values]
    if missing:
        raise InputError(signal.__name__, None, f"expected a value for {', '.join(missing)}")
    lengths, made = _lengths(known, values), dict[str, Any]()
    for name, field in layout(signal).items():
        if field.kind == "pose":
            at = [float(values[f"{name}.{part}"]) for part in POSE]
            made[name] = Pose.from_euler(tuple(at[:3]), roll=at[3], pitch=at[4], yaw=at[5])
        elif name in values:
            made[name] = _typed(values[name], field, lengths)
    return signal(t, **made)


def _lengths(known: Mapping[str, Field], values: Mapping[str, Value]) -> dict[str | int, int]:
    """Length of each dimension by name: a whole number of that name, else what the sizes of arrays leave."""
    found: dict[str | int, int] = {n: round(v) for n, v in values.items() if known[n].kind == "int"}
    for name in sorted(values, key=lambda n: len(known[n].quantity.shape)):
        shape = known[name].quantity.shape
        unknown = [d for d in shape if isinstance(d, str) and d not in found]
        if len(unknown) == 1:
            rest = prod(d if isinstance(d, int) else found[d] for d in shape if d != unknown[0])
            found[unknown[0]] = np.size(values[name]) // rest if rest else 0
    return found


def _typed(value: Value, field: Field, lengths: Mapping[str | int, int]) -> Value:
    if field.kind == "bool":
        return bool(value)
    if field.kind != "array":
        return round(value) if field.kind == "int" else float(value)
    array, shape = np.asarray(value, dtype=field.number), field.quantity.shape
    if array.ndim != 1 or len(shape) < 2:
        return array
    try:  # given row by row
        return array.reshape([d if isinstance(d, int) else lengths.get(d, -1) for d in shape])
    except ValueError:
        dimensions = ", ".join(map(str, shape))
        raise InputError(field.name, array.size, f"expected numbers for ({dimensions})") from None


def _expected(signal: type[Signal]) -> str:
    return f"expected one of {', '.join(flat_fields(signal))} of {signal.__name__}"
