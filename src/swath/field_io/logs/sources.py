"""Which of several sources of one quantity counts: columns of a table, channels of two buses, two sensors."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.number_text import num, percent_of

Array = NDArray[np.float64]
SAME = 0.02  # ratio less 1 by which two sources may differ and say the same
MOST_OTHER = 0.02  # of the rows that hold both, in which copies may differ: rounding, a sample later
MORE = 1.1  # times the values of another source: more complete than it
WITNESSED = ("speed", "header_width")  # quantities that way and passes show, too
FEWEST_BOTH = 25  # rows that hold both; with fewer the means are compared


@dataclass(frozen=True)
class Choice:
    """name: of the source that counts; notes: on the others; open: those that differ, of a quantity that way
    and passes show, too.
    """

    name: str
    notes: tuple[str, ...] = ()
    open: tuple[str, ...] = ()


def choose(
    quantity: str,
    sources: Mapping[str, Array],
    entry: Callable[[str], str],
    *,
    size: float | None = None,
    file: Path | None = None,
    lesser: Collection[str] = (),
) -> Choice:
    """The source that counts.

    sources: name -> values in one unit on the same rows, shape (n,), nan = none; the best name first
    entry: the line of --columns that chooses a name
    size: what SAME is a share of where that is not each value: of positions, heights
    lesser: names that say less surely than the first what they are: they count only where they hold more
    A width that varies counts before that of the whole header. Raises InputError where equally complete
    sources differ in the mean by more than SAME, and nothing else shows the quantity.
    """
    held = {name: int((np.isfinite(v) & (v != 0.0)).sum()) for name, v in sources.items()}
    best = next(name for name in held if MORE * held[name] >= max(held.values()))
    whole = _whole_width(sources) if quantity == "header_width" else {}
    best = next((name for name in held if name in whole), best)
    notes, undecided = [], list[str]()
    for other in [name for name in held if name != best]:
        same, over = _beside(sources[best], sources[other], size)
        differ = "" if size is not None else f", {num(over)} of it in the mean"
        if other in whole.get(best, ()):
            notes.append(f"derived: {quantity}: {best} is what is in use of {other}, and counts")
        elif same >= 1.0 - MOST_OTHER:
            notes.append(f"copies: {quantity}: {other} says the same as {best}, which counts")
        elif MORE * held[other] < held[best]:
            less = f"{other} has {num(held[other])} values for {num(held[best])}{differ * (over > 0.0)}"
            notes.append(f"sources: {quantity}: {best} counts; {less}")
        elif size is not None or abs(over - 1.0) <= SAME:
            notes.append(
                f"sources: {quantity}: {best} counts; {other} differs in {percent_of(1.0 - same)}{differ}"
            )
        elif quantity in WITNESSED:
            undecided.append(other)
        elif other in lesser and best not in lesser:
            notes.append(f"sources: {quantity}: {best} counts by its name; {other} is {num(over)} of it")
        else:
            text = f"expected one, the second is {num(over)} of the first; in --columns:"
            expected = f"{text} {entry(best)} or {entry(other)}"
            raise InputError("sources", f"{best}, {other}", expected, file=file)
    return Choice(best, tuple(notes), tuple(undecided))


def _whole_width(sources: Mapping[str, Array]) -> dict[str, list[str]]:
    """Widths in use -> those of the whole header: constant, and as wide as the widest in use."""
    held = {name: v[np.isfinite(v) & (v > 0.0)] for name, v in sources.items()}
    ends = {name: (float(v.min()), float(v.max())) for name, v in held.items() if len(v)}
    constant = [name for name, (low, high) in ends.items() if high <= low * (1.0 + SAME)]
    made = {
        name: [c for c in constant if abs(ends[name][1] / ends[c][1] - 1.0) <= SAME]
        for name in ends
        if name not in constant
    }
    return {name: of for name, of in made.items() if of}


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
