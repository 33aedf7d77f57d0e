"""What the charts of a function test's page show: margins over parameters, and the Stanford diagram."""

from collections.abc import Sequence
from itertools import pairwise
from math import log1p
from typing import Any

from swath.judge.evaluators.edge_detection import EPISODE_M
from swath.judge.evaluators.edge_detection import WRONG_M as ALERT_M
from swath.tools.function_test.cells import Cell
from swath.tools.function_test.integrity import (
    BIN_COUNT,
    BIN_M,
    episodes_per_km,
    pooled,
)
from swath.tools.function_test.judged import UNCOUNTED

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442", "#22262b")
WIDTH, HEIGHT, PAD = 250.0, 110.0, 14.0  # of a chart [px]
SIDE, CELL = 200.0, 200.0 / BIN_COUNT  # of the Stanford diagram [px]
MISTAKES = 0.1  # share of runs on the wrong side of a boundary that is drawn


def colour(number: int) -> str:
    """Of a candidate, the same in every chart."""
    return COLOURS[number % len(COLOURS)]


def over_parameters(cells: Sequence[Cell]) -> list[dict[str, Any]]:
    """Charts of one case, one for each parameter with several numbers. cells: its candidates, in order"""
    case, charts = cells[0].case, []
    for name in case.file.vary:
        drawn = [
            (number, float(run.point[name]), run)
            for number, cell in enumerate(cells)
            for run in cell.drawn.runs
            if run.verdict not in UNCOUNTED
            and not case.known(run.point)
            and isinstance(run.point.get(name), int | float)
        ]
        values = [value for _, value, _ in drawn]
        if len(set(values)) < 2:
            continue
        low, high = min(values), max(values)
        found = boundary([(value, run.margin >= 0.0) for number, value, run in drawn if number == 0])
        charts.append(
            {
                "name": name,
                "low": f"{low:g}",
                "high": f"{high:g}",
                "dots": [
                    {"x": _x(value, low, high), "y": _y(run.margin), "colour": colour(number),
                     "title": f"{name} {value:g}, seed {run.seed}: {run.reason or 'passes'}"}
                    for number, value, run in drawn
                ],
                "boundary": None if found is None else _x(found[0], low, high),
                "text": "" if found is None else f"passes {found[1]} {found[0]:.3g}",
            }
        )  # fmt: skip
    return charts


def boundary(runs: Sequence[tuple[float, bool]]) -> tuple[float, str] | None:
    """The value that parts passing from failing runs best, and on which side they pass; None where there is
    none that is right for nine of ten.

    runs: (value, passes)
    """
    values = sorted({value for value, _ in runs})
    if len({passes for _, passes in runs}) < 2:
        return None
    best: tuple[float, float, str] | None = None
    for a, b in pairwise(values):
        middle = 0.5 * (a + b)
        below = sum((value < middle) != passes for value, passes in runs) / len(runs)
        for wrong, side in ((below, "below"), (1.0 - below, "above")):
            if best is None or wrong < best[0]:
                best = wrong, middle, side
    passed = sum(passes for _, passes in runs)
    allowed = min(MISTAKES, 0.5 * min(passed, len(runs) - passed) / len(runs))
    return None if best is None or best[0] > allowed else (best[1], best[2])


def stanford(cells: Sequence[Cell], number: int) -> dict[str, Any] | None:
    """The diagram of one candidate over all its cases; None where no run has an edge detector."""
    whole = pooled(cell.integrity for cell in cells)
    if not whole["samples"]:
        return None
    most = log1p(max(count for _, _, count in whole["bins"]))
    rate = episodes_per_km(whole["episodes"], whole["km"])
    return {
        "candidate": cells[0].candidate,
        "side": SIDE,
        "cell": CELL,
        "alert": ALERT_M / BIN_M * CELL,
        "limit": f"{ALERT_M:g}",
        "end": f"{BIN_M * BIN_COUNT:g}",
        "episode": f"{EPISODE_M:g}",
        "colour": colour(number),
        "squares": [
            {"x": error * CELL, "y": SIDE - (told + 1) * CELL, "opacity": round(log1p(count) / most, 3)}
            for error, told, count in whole["bins"]
        ],
        "text": f"{whole['episodes']} hazardous episodes in {whole['km']:.3g} km: "
        f"{rate:.3g} per km or fewer (95 %); the longest {whole['longest_m']:.2g} m",
    }


def _x(value: float, low: float, high: float) -> float:
    return round(PAD + (value - low) / (high - low) * (WIDTH - 2.0 * PAD), 1)


def _y(share: float) -> float:
    return round(HEIGHT / 2.0 - min(1.0, max(-1.0, share)) * (HEIGHT / 2.0 - 8.0), 1)
