"""Numbers of a crop card in SI, with the limits of what a crop can be."""

from collections.abc import Mapping
from typing import Any, TypeVar

from swath.core.errors import InputError
from swath.core.units import CM, DEG, GRAM, MM, PERCENT
from swath.documents.data_sheets import Card

UNITS = {
    "1": 1.0,
    "1/m2": 1.0,
    "kg/m3": 1.0,
    "m": 1.0,
    "cm": CM,
    "mm": MM,
    "deg": DEG,
    "%": PERCENT,
    "g": GRAM,
}
LENGTH, RATIO, ANGLE = ("m", "cm", "mm"), ("1", "%"), ("deg",)
CV = (RATIO, 0.0, 0.5)  # of a coefficient of variation
Limits = tuple[tuple[str, ...], float, float]  # units it may have, lowest and highest value [SI]
T = TypeVar("T")


def number(card: Card, key: str, units: tuple[str, ...], low: float, high: float) -> float:
    """A number of the card in SI. InputError when it has another unit or lies outside low..high [SI]."""
    value = card.number(key)
    unit = str(card.entry(key).get("unit"))
    if unit not in units:
        raise InputError(f"{key}.unit", unit, f"expected {' or '.join(units)}", file=card.path)
    factor = UNITS[unit]
    slack = 1e-12 * max(abs(low), abs(high))
    if not low - slack <= value * factor <= high + slack:
        limits = f"expected {low / factor:g} to {high / factor:g} {unit if unit != '1' else ''}".rstrip()
        raise InputError(key, value, limits, file=card.path)
    return value * factor


def section(card: Card, name: str, facts: type[T], limits: Mapping[str, Limits]) -> T:
    """The facts of one section of the card: a field per key of `limits`. Fields named count_* or per_* and
    `drawn` are whole numbers.
    """
    found: dict[str, Any] = {key: number(card, f"{name}.{key}", *limit) for key, limit in limits.items()}
    whole = {k: round(v) for k, v in found.items() if k.startswith(("count_", "per_")) or k == "drawn"}
    found.update(whole)
    for key, least in ((k, k.replace("_max", "_min")) for k in found if k.endswith("_max")):
        if found[key] < found[least]:
            expected = f"expected at least {name}.{least} = {found[least]:g}"
            raise InputError(f"{name}.{key}", found[key], expected, file=card.path)
    return facts(**found)
