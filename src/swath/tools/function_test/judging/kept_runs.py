"""What is kept of very many runs: a few numbers of each of some of them, the worst ones, and regions."""

from bisect import insort
from collections.abc import Mapping
from dataclasses import dataclass, field

from swath.core.number_text import num
from swath.tools.function_test.case import Scalar
from swath.tools.function_test.stored_line import Result

GOLDEN = 0x9E3779B97F4A7C15  # 2**64 divided by the golden ratio: spreads numbers evenly (Knuth 6.4)
NAME_DIGITS = 16  # hexadecimal, of a run; a shadow has the candidate behind them


@dataclass(frozen=True, slots=True)
class Kept:
    """A run. point: of the parameters; margin: to its nearest limit, -2 for an error."""

    id: str
    point: Mapping[str, Scalar]
    seed: int
    verdict: str
    reason: str
    margin: float


def kept(result: Result, margin: float) -> Kept:
    """What is kept of a result."""
    return Kept(result["id"], result["point"], result["seed"], result["verdict"], result["reason"], margin)


@dataclass
class Worst:
    """The runs with the least margins, worst first; of equal ones those that came first. most: how many."""

    most: int
    runs: list[Kept] = field(default_factory=list)
    count: int = 0

    def add(self, run: Kept) -> None:
        """Take in a run that counts; it is kept while there are no worse ones."""
        self.count += 1
        if len(self.runs) < self.most or run.margin < self.runs[-1].margin:
            insort(self.runs, run, key=lambda other: other.margin)
            del self.runs[self.most :]


@dataclass
class Sample:
    """Some runs, chosen by their names, which are hashes, so by no pattern of points or seeds.

    one_in: of how many
    """

    one_in: int
    runs: list[Kept] = field(default_factory=list)

    def add(self, run: Kept) -> None:
        """Take in a run."""
        mixed = int(run.id[:NAME_DIGITS], 16) * GOLDEN % 2**64  # no share of a plan is a part of this one
        if mixed * self.one_in < 2**64:
            self.runs.append(run)


@dataclass
class Region:
    """Where some runs lie: the range of each parameter that is a number, the values of the others."""

    count: int = 0
    values: dict[str, set[Scalar]] = field(default_factory=dict)  # of a number the least and the greatest

    def add(self, point: Mapping[str, Scalar]) -> None:
        """Take in the point of a run."""
        self.count += 1
        for name, value in point.items():
            here = self.values.setdefault(name, set())
            here.add(value)
            if len(here) > 2 and (numbers := _numbers(here)):
                self.values[name] = {min(numbers), max(numbers)}

    @property
    def text(self) -> str:
        """`speed_kmh 4 to 10; side left, right`."""
        parts = []
        for name, values in self.values.items():
            if numbers := sorted(set(_numbers(values))):
                upto = f" to {num(numbers[-1])}" if len(numbers) > 1 else ""
                parts.append(f"{name} {num(numbers[0])}{upto}")
            else:
                parts.append(f"{name} {', '.join(sorted(map(str, values)))}")
        return "; ".join(parts) or "everywhere"


def _numbers(values: set[Scalar]) -> list[int | float]:
    """The values where all are numbers, else none."""
    found = [v for v in values if isinstance(v, int | float) and not isinstance(v, bool)]
    return found if len(found) == len(values) else []
