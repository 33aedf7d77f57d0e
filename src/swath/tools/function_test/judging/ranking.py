"""Candidates beside each other: who passes how many runs, of which kind, how well, how surely, how fast."""

from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from math import fsum, inf, isfinite, nan
from statistics import median
from typing import Any

from swath.core.number_text import num, percent_of, signed
from swath.tools.function_test.judging.paired import ALPHA, caveat, difference, mean_interval

METRICS = {"edge_rmse_m": "edge RMSE", "lateral_rms_m": "lateral RMS"}  # that are ranked by [m]
SURE_WRONG, EDGE_US = "sure_wrong_share", "edge_us"  # a metric; of a result: time of an edge detector's step
HEAD = ("rank", "candidate", "runs pass", *(f"{name}, mean (95 %)" for name in METRICS.values()),
        *(f"{name} less the first's (95 %)" for name in METRICS.values()),
        "sure and wrong, mean", "runs above 1 %", "time a scan")  # fmt: skip


@dataclass
class Measured:
    """What the runs of a cell measured, in their order. keys: which point and seed each had."""

    keys: "array[int]" = field(default_factory=lambda: array("q"))
    values: "Mapping[str, array[float]]" = field(
        default_factory=lambda: {name: array("d") for name in (*METRICS, SURE_WRONG, EDGE_US)}
    )

    def add(self, result: Mapping[str, Any]) -> None:
        """Take in a run."""
        self.keys.append(hash((str(sorted(result["point"].items())), result["seed"])))
        for name, values in self.values.items():
            value = result.get(name) if name == EDGE_US else result["metrics"].get(name)
            values.append(nan if value is None else value)

    def by_key(self, name: str) -> dict[int, float]:
        """The values of a metric that are there, by point and seed."""
        pairs = zip(self.keys, self.values[name], strict=True)
        return {key: value for key, value in pairs if isfinite(value)}


def ranking(cells: Sequence[Any]) -> list[list[str]]:
    """Rows of HEAD, the best candidate first: by runs that pass, then by the mean of the first metric."""
    names = list(dict.fromkeys(cell.candidate for cell in cells))
    of = {name: [cell for cell in cells if cell.candidate == name] for name in names}
    first = next(iter(METRICS))
    order = sorted(names, key=lambda name: (-_passed(of[name])[0], _mean(_all(of[name], first))))
    return [[str(rank), name, *_row(of[name], of[names[0]])] for rank, name in enumerate(order, 1)]


def by_tag(cells: Sequence[Any]) -> tuple[list[str], list[list[str]]]:
    """Head and rows: how many runs of the cases with each tag pass, by candidate."""
    names = list(dict.fromkeys(cell.candidate for cell in cells))
    tagged = sorted(((tag, cell) for cell in cells for tag in cell.case.file.tags), key=lambda pair: pair[0])
    rows = []
    for tag, found in groupby(tagged, key=lambda pair: pair[0]):
        some = [cell for _, cell in found]
        rows.append([tag, *(_of(_passed([c for c in some if c.candidate == name])) for name in names)])
    return ["cases with the tag", *names], rows


def _row(mine: Sequence[Any], first: Sequence[Any]) -> list[str]:
    wrong = _all(mine, SURE_WRONG)
    cost = [v for v in _all(mine, EDGE_US) if isfinite(v)]
    means = [_with_interval(_all(mine, name)) for name in METRICS]
    apart = [_apart(mine, first, name) if mine[0] is not first[0] else "" for name in METRICS]
    known = [value for value in wrong if isfinite(value)]
    return [
        _of(_passed(mine)), *means, *apart,
        percent_of(sum(known) / len(known)) if known else "",
        _of((sum(value > 0.01 for value in known), len(known))) if known else "",
        f"{num(median(cost))} us" if cost else "",
    ]  # fmt: skip


def _passed(cells: Sequence[Any]) -> tuple[int, int]:
    return sum(cell.passed for cell in cells), sum(cell.counted for cell in cells)


def _of(counts: tuple[int, int]) -> str:
    return f"{counts[0]} of {counts[1]}" if counts[1] else ""


def _all(cells: Sequence[Any], name: str) -> list[float]:
    return [value for cell in cells for value in cell.measured.values[name]]


def _mean(values: Sequence[float]) -> tuple[int, float]:
    """How many were not measured, which counts before all others, and the mean of the rest."""
    known = [value for value in values if isfinite(value)]
    return len(values) - len(known), fsum(known) / max(1, len(known))


def _with_interval(values: Sequence[float]) -> str:
    """Mean of what was measured, with its interval."""
    known = [value for value in values if isfinite(value)]
    return _told(_mean(known)[1], *(mean_interval(known) if len(known) > 1 else (-inf, inf))) if known else ""


def _apart(mine: Sequence[Any], first: Sequence[Any], name: str) -> str:
    """What the pairs of runs say: the same case, point and seed."""
    pairs = []
    for cell, other in zip(mine, first, strict=True):
        there = other.measured.by_key(name)
        pairs += [value - there[key] for key, value in cell.measured.by_key(name).items() if key in there]
    if not pairs:
        return ""
    found = difference(pairs)
    told = _told(found.estimate, found.low, found.high, signed)
    if found.p > ALPHA:
        return f"{told}, not shown"
    worst = f"worst tenth {signed(found.worst_tenth('lower'))} m"
    return f"{told}; {caveat(found.count, worst)}" if found.estimate < 0.0 else told


def _told(middle: float, low: float, high: float, say: Callable[..., str] = num) -> str:
    """A value with its interval [m]."""
    around = f" ({say(low)} to {say(high)})" if isfinite(low) and isfinite(high) else ""
    return f"{say(middle)} m{around}"
