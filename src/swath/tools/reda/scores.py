"""Three scores of a sensor in a condition, named after Validation Scores (doi:10.3390/electronics13122396).

Of that paper the abstract was read: scores of usability, availability and reliability from errors place by
place and by statistics. The formulas here are our own.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

from swath.judge.evaluator import mean

Z = 1.96  # of an interval of 95 %


@dataclass(frozen=True)
class Cell:
    """A place. detected: share of the looks at a person there; false: of those at nobody; looks: how many."""

    inside: float
    aside: float
    detected: float
    false: float
    looks: int
    why: str

    @property
    def net(self) -> float:
        """Share of the looks that detect the person, without those that report something there anyway."""
        return max(self.detected - self.false, 0.0) / max(1.0 - self.false, 1e-9)


@dataclass(frozen=True)
class Scores:
    """usability: share of the places that are covered in at least `least` of the looks.

    availability: share of all looks that detect the person
    reliability: lower end of the interval of 95 % of being right, over all looks with a person and without
        (Wilson 1927)
    """

    usability: float
    availability: float
    reliability: float


def scores_of(cells: Sequence[Cell], least: float) -> Scores:
    """Scores of all places of a condition."""
    net = [cell.net for cell in cells]
    right = mean([0.5 * (cell.detected + 1.0 - cell.false) for cell in cells])
    looks = 2 * sum(cell.looks for cell in cells)
    return Scores(mean([float(n >= least) for n in net]), mean(net), lower_end(right, looks))


def lower_end(share: float, count: int) -> float:
    """Lower end of the 95 % interval of a share of so many looks."""
    square = Z * Z / count
    half = Z * sqrt(share * (1.0 - share) / count + 0.25 * square / count)
    return max((share + 0.5 * square - half) / (1.0 + square), 0.0)
