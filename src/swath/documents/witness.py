"""What measures say of each other: tables of witnesses are asked and judged here, whatever was read."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError


@dataclass(frozen=True)
class Pair:
    """Two measures of one thing. The words of an error are those of `InputError`: key = value: expected."""

    key: str
    """What the user would change: a column, a topic, a flag."""
    shown: str
    """What both say, in words with their units."""
    residual: float
    """How far they are apart, 0 = they agree, nan = one of them is not there."""
    told: float
    """Residual above which the user gets a note."""
    refused: float = np.inf
    """Residual above which nothing can be made of it."""
    entry: str = ""
    """What to write where one of them is wrong."""
    is_stated: bool = False
    """The user says what is contradicted: it is noted, not refused."""
    expected: str = "expected both to agree"

    @property
    def agrees(self) -> bool:
        """Whether both are there and say the same."""
        return self.residual <= self.told

    @property
    def contradicts(self) -> bool:
        """Whether nothing can be made of both together."""
        return self.residual > self.refused


def outside(value: float, limits: tuple[float, float]) -> float:
    """Residual of a measure > 0 and what it can be: how far it lies outside, as a ratio less 1; 0 within."""
    return max(limits[0] / value, value / limits[1], 1.0) - 1.0 if 0.0 < value < np.inf else np.nan


def ratio(one: float, other: float) -> float:
    """Residual of two measures that are greater than 0: how far the larger over the smaller lies above 1."""
    return max(one / other, other / one) - 1.0 if one > 0.0 and other > 0.0 else np.nan


def judge(pairs: Iterable[Pair], file: Path | None = None) -> list[str]:
    """What the pairs in doubt say, as notes. Raises InputError for the first pair that is refused."""
    notes = []
    for pair in pairs:
        if pair.contradicts and not pair.is_stated:
            raise InputError(pair.key, pair.shown, f"{pair.expected}; {pair.entry}".rstrip("; "), file=file)
        if pair.residual > pair.told:
            notes.append(f"{pair.key}: {pair.shown}" + (f"; {pair.entry}" if pair.entry else ""))
    return notes


@dataclass(frozen=True)
class Witness:
    """A row of a table of witnesses: what numbers of one source may say, alone or together.

    of: measures that it asks; it is silent where one is missing
    find: of these measures the residual, as of `Pair`, and what `shown` says of it; key: of `reasons`
    """

    of: tuple[str, ...]
    find: Callable[..., tuple[float, ...]]
    shown: str
    entry: str
    told: float = 0.0
    refused: float = np.inf
    key: str = "plausible"
    expected: str = "expected numbers that agree"

    def pair(self, measures: Mapping[str, Any]) -> Pair:
        """What it says of the measures."""
        residual, *facts = self.find(*(measures[name] for name in self.of))
        shown = self.shown.format(*facts)
        bounds = self.told, self.refused
        return Pair(self.key, shown, residual, *bounds, self.entry, expected=self.expected)


def ask(table: Iterable[Witness], measures: Mapping[str, Any], file: Path | None = None) -> list[str]:
    """Notes of the witnesses whose measures are there. Raises as `judge`."""
    return judge((row.pair(measures) for row in table if all(n in measures for n in row.of)), file)


@dataclass(frozen=True)
class Estimate:
    """A number that data show, and its standard error, both in the same unit."""

    value: float
    error: float


def agreed(parts: Sequence[Estimate], slack: float = 0.0, sigmas: float = 3.0) -> Estimate | None:
    """What the parts of an estimate say together; None where there is none, or two of them disagree.

    slack: by which parts differ for reasons that their errors do not know. The error is that of the mean, and
    at least what the spread of the parts makes it.
    """
    if not parts:
        return None
    value, error = (np.array([getattr(part, key) for part in parts]) for key in ("value", "error"))
    apart = np.abs(value[:, None] - value) - sigmas * np.hypot(error[:, None], error)
    if (apart > slack).any():
        return None
    weight = 1.0 / np.maximum(error, 1e-9) ** 2
    mean = float(np.average(value, weights=weight))
    spread = float(np.average((value - mean) ** 2, weights=weight)) / len(parts)
    return Estimate(mean, float(np.sqrt(max(1.0 / weight.sum(), spread))))
