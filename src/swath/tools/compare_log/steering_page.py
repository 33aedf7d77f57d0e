"""The files of a comparison of steering and motion: picture, report, results and the fitted data sheet."""

from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.files.whole_file import write_whole
from swath.core.number_text import num, span
from swath.documents.yaml_document import dump
from swath.report.html import Table
from swath.report.plots import BLUE, GREY, ORANGE, figure, styled
from swath.signals import F64
from swath.tools.compare_log.page import begin_comparison, write_compared
from swath.tools.compare_log.steering_fit import FittedWith, PartFit, SteeringComparison

EXCERPT = 40.0  # s
FITTED = ("part", "key", "data sheet", "fitted", "95 % interval", "unit")
INTERVAL = "Interval: bootstrap over the passes of the log."
RESIDUALS = (
    *("part", "compared with", "passes", "RMSE, data sheet", "fitted"),
    *("predicted by the other passes", "unit"),
)


def fitted_rows(made: SteeringComparison) -> list[list[str]]:
    """Part, key, number of the data sheet, fitted number, its interval, unit, as text."""
    return [
        [p.name, f.key, num(f.start), num(f.value) if f.is_seen else "-", _interval(f), f.unit]
        for p in made.parts
        for f in p.fitted
    ]


def left_rows(made: SteeringComparison) -> list[list[str]]:
    """Part, quantity, passes, RMSE of the data sheet, as fitted and predicted, unit, as text."""
    return [[p.name, p.quantity, str(p.block_count), *(num(v) for v in p.rmse), p.unit] for p in made.parts]


def write_steering(made: SteeringComparison, out: Path) -> None:
    """Write results.json, comparison.png, report.html and machine.yaml (as fitted)."""
    out, fig = Path(out), draw(made)
    begin_comparison(out, fig, made.to_dict())
    tables = [
        Table("Fitted numbers", FITTED, fitted_rows(made), (2, 3), INTERVAL),
        Table("Residuals", RESIDUALS, left_rows(made), range(2, 6)),
    ]
    lead = f"steering and motion, fitted to {made.log_name}"
    write_compared(out, made.model, lead, tables, fig, made.notes)
    write_whole(out / "machine.yaml", dump(made.sheet.document.data, width=110))


def draw(made: SteeringComparison) -> Any:
    """One row per part: an excerpt over time, and what is left of every pass."""
    with styled():
        fig = figure(12.5, 3.1 * len(made.parts))
        grid = fig.add_gridspec(len(made.parts), 4)
        for i, part in enumerate(made.parts):
            _excerpt(fig.add_subplot(grid[i, :3]), made, part)
            _by_pass(fig.add_subplot(grid[i, 3]), made, part)
    return fig


def _excerpt(ax: Any, made: SteeringComparison, part: PartFit) -> None:
    known = np.flatnonzero(np.isfinite(part.after))
    time = made.log.time
    begin = time[known[len(known) // 2]]
    rows = known[(time[known] >= begin) & (time[known] < begin + EXCERPT)]
    rows = rows if len(rows) > 1 else known
    x = time[rows] - time[rows[0]]
    cut = np.flatnonzero(np.diff(rows) > 1) + 1  # lines end where nothing is compared

    def line(values: F64, **style: Any) -> None:
        ax.plot(np.insert(x, cut, np.nan), np.insert(values[rows], cut, np.nan), **style)

    if part.quantity != "position":
        line(part.measured, color=GREY, lw=2.4, alpha=0.55, label="measured")
    line(part.before, color=BLUE, lw=1.0, label="data sheet")
    line(part.after, color=ORANGE, lw=1.2, label="fitted")
    name = "distance from the measured position" if part.quantity == "position" else part.quantity
    ax.set(xlabel="time [s]", ylabel=f"{name} [{part.unit}]", xlim=(0, x[-1]))
    ax.set_title(f"{part.name}, excerpt", loc="left", fontsize=10)
    ax.legend(ncol=3, loc="upper right", bbox_to_anchor=(1.0, 1.16))


def _by_pass(ax: Any, made: SteeringComparison, part: PartFit) -> None:
    offset = np.zeros_like(part.after) if part.quantity == "position" else part.measured
    blocks = [b for b in np.unique(made.log.block) if np.isfinite(part.after[made.log.block == b]).any()]
    for series, colour, label in ((part.before, BLUE, "data sheet"), (part.after, ORANGE, "fitted")):
        error = [np.sqrt(np.nanmean((series - offset)[made.log.block == b] ** 2)) for b in blocks]
        ax.plot(range(1, len(error) + 1), error, "o", ms=3.5, color=colour, label=label)
    ax.set(xlabel="pass", ylabel=f"RMSE [{part.unit}]", ylim=(0, None))


def _interval(f: FittedWith) -> str:
    if not f.is_seen:
        return "not shown by this log"
    if isfinite(f.low) and isfinite(f.high):
        return span([f.low, f.high])
    return f"at least {num(f.low)}" if isfinite(f.low) else f"at most {num(f.high)}"
