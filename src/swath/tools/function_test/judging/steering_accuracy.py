"""How accurately a machine steers, in the form in which tests of steering systems give it.

The lateral error of the header end at even steps of the way, in classes of 1 cm by its size: the root mean
square over all runs of a point, and the class up to which 95 % lie (as DLG TestService reports automatic
steering; ISO 12188-2 asks for the 95th percentile of the unsigned error).
"""

from collections.abc import Iterable, Mapping, Sequence
from math import fsum, sqrt
from typing import Any

import numpy as np

from swath.judge.evaluator import even_path
from swath.judge.evaluators.lateral_error import LateralError

SUMMARY = "steering"
CLASS_M, CLASS_COUNT = 0.01, 100  # the last class takes what is beyond
HELD = 0.95  # share that lies up to the class that is reported


def steering_in(judges: Sequence[LateralError]) -> dict[str, Any]:
    """`steering`: classes of the lateral error of all machines with a header; nothing without one."""
    classes = [classes_of(judge) for judge in judges if judge.metrics()]
    return {SUMMARY: pooled(classes)} if classes else {}


def classes_of(judge: LateralError) -> dict[str, Any]:
    """Classes of one run: `classes`, pairs of class and steps; `squares`, the sum of squared errors [m2]."""
    series = judge.series()
    error = even_path(series.distance, series.lateral, start=judge.setup.settling_m)[1]
    error = np.abs(error[np.isfinite(error)])
    at, counts = np.unique(np.minimum(error // CLASS_M, CLASS_COUNT - 1).astype(int), return_counts=True)
    return {
        "classes": [[int(a), int(n)] for a, n in zip(at, counts, strict=True)],
        "squares": fsum((error**2).tolist()),
    }


def pooled(runs: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Several runs together."""
    classes: dict[int, int] = {}
    squares = []
    for run in runs:
        squares.append(run["squares"])
        for number, count in run["classes"]:
            classes[number] = classes.get(number, 0) + count
    return {"classes": [[a, n] for a, n in sorted(classes.items())], "squares": fsum(squares)}


def accuracy(counts: Mapping[str, Any]) -> tuple[float, int] | None:
    """Root mean square [m], and the upper end [cm] of the class up to which 95 % lie; None of nothing."""
    classes: Sequence[Sequence[int]] = counts["classes"]
    count = sum(n for _, n in classes)
    if not count:
        return None
    within = 0
    for number, n in classes:
        within += n
        if within >= HELD * count:
            return sqrt(counts["squares"] / count), number + 1
    raise AssertionError("classes hold all steps")
