"""Which of several sources of one quantity counts: columns of a table, channels of two buses, two sensors."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError

Array = NDArray[np.float64]
SAME = 0.02  # ratio less 1 by which two sources may differ and say the same
MOST_OTHER = 0.02  # of the rows that hold both, in which copies may differ: rounding, a sample later
MORE = 1.1  # times the values of another source: more complete than it
FEWEST_BOTH = 25  # rows that hold both; with fewer the means are compared


@dataclass(frozen=True)
class Choice:
    """name: of the source that counts; notes: on the others."""

    name: str
    notes: tuple[str, ...] = ()


def choose(
    quantity: str,
    sources: Mapping[str, Array],
    entry: Callable[[str], str],
    *,
    size: float | None = None,
    file: Path | None = None,
) -> Choice:
    """The source that counts.

    sources: name -> values in one unit on the same rows, shape (n,), nan = none; the best name first
    entry: the line of --columns that chooses a name
    size: what SAME is a share of where that is not each value: of positions, heights
    Raises InputError where equally complete sources differ in the mean by more than SAME.
    """
    held = {name: int((np.isfinite(v) & (v != 0.0)).sum()) for name, v in sources.items()}
    best = next(name for name in held if MORE * held[name] >= max(held.values()))
    notes = []
    for other in [name for name in held if name != best]:
        same, over = _beside(sources[best], sources[other], size)
        differ = "" if size is not None else f", {over:.3g} of it in the mean"
        if same >= 1.0 - MOST_OTHER:
            notes.append(f"copies: {quantity}: {other} says the same as {best}, which counts")
        elif MORE * held[other] < held[best]:
            less = f"{other} has {held[other]:,} values for {held[best]:,}{differ * (over > 0.0)}"
            notes.append(f"sources: {quantity}: {best} counts; {less}")
        elif size is not None or abs(over - 1.0) <= SAME:
            notes.append(f"sources: {quantity}: {best} counts; {other} differs in {1.0 - same:.0%}{differ}")
        else:
            text = (
                f"expected one {quantity}: {other} says {over:.3g} of {best} in the mean; --columns MAP.yaml"
            )
            raise InputError(
                "sources", f"{best}, {other}", f"{text} takes one: {entry(best)} or {entry(other)}", file=file
            )
    return Choice(best, tuple(notes))


def _beside(one: Array, other: Array, size: float | None) -> tuple[float, float]:
    """Share of the rows with both that say the same, nan = too few, and the mean of the other over one's."""
    both = np.isfinite(one) & np.isfinite(other)
    if both.sum() < FEWEST_BOTH:
        means = [float(np.mean(v[np.isfinite(v)])) if np.isfinite(v).any() else 0.0 for v in (one, other)]
        return np.nan, means[1] / means[0] if means[0] else np.nan
    a, b = one[both], other[both]
    scale = np.maximum(np.abs(a), np.abs(b)) if size is None else size
    same = float((np.abs(a - b) <= SAME * scale).mean())
    return same, float(b.sum() / a.sum()) if a.sum() else np.nan
