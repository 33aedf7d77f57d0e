"""Pairs of measures that must agree: the table of them is judged here, whatever they were read from."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

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
            raise InputError(
                pair.key, pair.shown, f"expected both to agree; {pair.entry}".rstrip("; "), file=file
            )
        if pair.residual > pair.told:
            notes.append(f"{pair.key}: {pair.shown}" + (f"; {pair.entry}" if pair.entry else ""))
    return notes


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
