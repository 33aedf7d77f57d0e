"""What is tuned: numbers and choices of a scenario, each as a share of its range."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp, log
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.number_text import num
from swath.core.typed_numbers import check_text, range_in, range_meant, unit_of
from swath.core.units import rounded
from swath.documents.yaml_document import parse_value
from swath.signals import F64
from swath.tools.function_test.case import Scalar

KINDS = ("whole", "log")  # what may stand behind a range, after colons
EXPECTED = "expected KEY=2..8, KEY=2..8:whole, KEY=0.1..10:log, or choices, KEY=a,b"


@dataclass(frozen=True)
class Parameter:
    """A number from low to high, or one of some choices. key: of the scenario, as after `--set`."""

    key: str
    low: float = 0.0
    high: float = 1.0
    is_whole: bool = False
    is_log: bool = False
    choices: tuple[Scalar, ...] = ()

    def value_at(self, share: float) -> Scalar:
        """Its value at a share of the range, 0..1."""
        if self.choices:
            return self.choices[round(share * (len(self.choices) - 1))]
        low, high = self._ends
        value = low + min(1.0, max(0.0, share)) * (high - low)
        value = exp(value) if self.is_log else value
        return round(value) if self.is_whole else min(self.high, max(self.low, rounded(value, 6)))

    def share_of(self, value: Scalar) -> float:
        """The share of the range at which a value lies."""
        if self.choices:
            return self.choices.index(value) / (len(self.choices) - 1)
        low, high = self._ends
        return ((log(float(value)) if self.is_log else float(value)) - low) / (high - low)

    @property
    def text(self) -> str:
        """Its range or choices in words."""
        if self.choices:
            return ", ".join(map(str, self.choices))
        kinds = [" whole numbers"] * self.is_whole + [" on a log scale"] * self.is_log
        return f"{num(self.low)} to {num(self.high)}{','.join(kinds)}"

    @property
    def _ends(self) -> tuple[float, float]:
        return (log(self.low), log(self.high)) if self.is_log else (self.low, self.high)


def read_parameter(text: str) -> Parameter:
    """A parameter as after `--param`. Raises InputError."""
    key, equals, said = text.partition("=")
    if not equals or not key or not said:
        raise InputError("--param", text, EXPECTED)
    unit, (ends, *kinds) = unit_of(key), said.split(":")
    meant = range_meant(ends, unit) or range_meant(said, unit)
    if ".." not in said.replace("../", "") and not meant:
        choices = tuple(_choice(key, part) for part in said.split(","))
        if len(set(choices)) < max(2, len(choices)) or any(isinstance(c, list | dict) for c in choices):
            raise InputError(f"--param {key}", said, "expected two choices or more, all different: a,b")
        return Parameter(key, choices=choices)
    try:
        low, high = range_in(ends, unit)
    except ValueError as error:
        raise InputError("--param", text, f"{EXPECTED}{str(error) or meant}") from None
    if set(kinds) - set(KINDS):
        raise InputError(f"--param {key}", said, f"expected {' or '.join(KINDS)} behind the colon")
    if "log" in kinds and low <= 0.0:
        raise InputError(f"--param {key}", said, "expected ends above 0 on a log scale")
    if "whole" in kinds and not (low.is_integer() and high.is_integer()):
        raise InputError(f"--param {key}", said, "expected whole numbers as ends")
    return Parameter(key, low, high, "whole" in kinds, "log" in kinds)


def _choice(key: str, text: str) -> Scalar:
    value: Scalar = parse_value(text, f"--param {key}")
    check_text(f"--param {key}", key, text, value)
    return value


def as_text(key: str, told: str | Sequence[Any]) -> str:
    """A parameter of `swath.tune` as after `--param`: `2..8:log` as it is, or choices."""
    return f"{key}={told if isinstance(told, str) else ','.join(map(str, told))}"


def sets_at(parameters: Sequence[Parameter], shares: F64) -> dict[str, Scalar]:
    """Scenario keys and values at shares of the ranges, (d,)."""
    return {p.key: p.value_at(float(share)) for p, share in zip(parameters, shares, strict=True)}


def snapped(parameters: Sequence[Parameter], shares: F64) -> F64:
    """Shares (n, d) of the values that there are: whole numbers and choices are few."""
    out = np.array(shares, dtype=float)
    for column, parameter in enumerate(parameters):
        if parameter.is_whole or parameter.choices:
            out[:, column] = [parameter.share_of(parameter.value_at(float(s))) for s in out[:, column]]
    return out


def as_sets(values: Mapping[str, Scalar]) -> list[str]:
    """Changes as after `--set`."""
    import json

    return [f"{key}={json.dumps(value)}" for key, value in values.items()]
