"""What the charts of a function test's page show: margins over parameters, and the Stanford diagram."""

from collections.abc import Sequence
from itertools import pairwise
from math import log1p

from swath.core.number_text import num, span
from swath.judge.evaluators.edge_detection import WRONG_M as ALERT_M
from swath.report.chart import Chart
from swath.tools.function_test.cells import Cell
from swath.tools.function_test.judging.integrity import (
    BIN_COUNT,
    BIN_M,
    episodes_per_km,
    pooled,
)
from swath.tools.function_test.judging.judged import UNCOUNTED

COLOURS = (
    *("var(--blue)", "var(--orange)", "var(--green)"),
    *("#cc79a7", "#e69f00", "#56b4e9", "#b8a800"),
    "var(--ink)",
)
WIDTH, HEIGHT, SIDE = 340.0, 150.0, 300.0  # of a chart and of the Stanford diagram [px]
PAD = 0.06  # of a chart that is left free at its sides
MISTAKES = 0.1  # largest share of runs on the wrong side of a boundary that is drawn


def colour(number: int) -> str:
    """Colour of a candidate, the same in every chart."""
    return COLOURS[number % len(COLOURS)]


def over_parameters(cells: Sequence[Cell]) -> list[Chart]:
    """Charts of one case, one for each parameter with several numbers. cells: its candidates, in order."""
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
        said = "" if found is None else f": passes {found[1]} {num(found[0])}"
        chart = Chart(WIDTH, HEIGHT, f"margin over {name}", caption=f"**{name}** {span([low, high])}{said}")
        chart.line(0.0, 0.5, 1.0, 0.5, "3 3")
        for at, text, down in ((1.0, "1", 12.0), (0.5, "0", -2.0), (0.0, "-1", -2.0)):
            chart.text(0.0, at, text, right=1.0, down=down)

        def across(value: float, low: float = low, high: float = high) -> float:
            return PAD + (1.0 - 2.0 * PAD) * (value - low) / (high - low)

        if found is not None:
            chart.line(across(found[0]), 0.0, across(found[0]), 1.0, "1 3")
        for number, value, run in drawn:
            title = f"{name} {num(value)}, seed {run.seed}: {run.reason or 'passes'}"
            up = 0.5 + 0.43 * min(1.0, max(-1.0, run.margin))
            chart.dot(across(value), up, title=title, fill=colour(number))
        charts.append(chart)
    return charts


def boundary(runs: Sequence[tuple[float, bool]]) -> tuple[float, str] | None:
    """The value that separates passing from failing runs best, and the side on which they pass.

    None where no value is right for nine of ten runs. runs: (value, passes)
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


def stanford(cells: Sequence[Cell], number: int) -> Chart | None:
    """The diagram of one candidate over all its cases; None where no run has an edge detector."""
    whole = pooled(cell.integrity for cell in cells)
    if not whole["samples"]:
        return None
    name = cells[0].candidate
    rate = episodes_per_km(whole["episodes"], whole["km"])
    caption = (
        f"**{name}**: {whole['episodes']} hazardous episodes in {num(whole['km'])} km: "
        f"{num(rate)} per km or fewer (95 %); the longest {num(whole['longest_m'])} m"
    )
    chart = Chart(SIDE, SIDE, f"Stanford diagram of {name}", caption=caption)
    alert, cell = ALERT_M / (BIN_M * BIN_COUNT), 1.0 / BIN_COUNT
    chart.area("hazard", (alert, 0.0), (alert, alert), (1.0, 1.0), (1.0, 0.0))
    most = log1p(max(count for _, _, count in whole["bins"]))
    for error, reported, count in whole["bins"]:
        chart.box(error * cell, reported * cell, cell, cell, fill=colour(number), opacity=log1p(count) / most)
    chart.line(0.0, 0.0, 1.0, 1.0)
    chart.line(alert, 0.0, alert, 1.0, "3 3")
    chart.line(0.0, alert, 1.0, alert, "3 3")
    chart.text(alert, 0.0, f"{num(ALERT_M)} m", right=3.0, down=-13.0)
    chart.text(1.0, 0.0, f"error {num(BIN_M * BIN_COUNT)} m", anchor="end", right=-3.0, down=-3.0)
    chart.text(1.0, alert, f"{num(ALERT_M)} m", anchor="end", right=-3.0, down=-3.0)
    chart.text(alert, 1.0, f"stated {num(BIN_M * BIN_COUNT)} m", right=3.0, down=14.0)
    return chart
