"""The files of a comparison with a recorded log: picture, report, results, data sheet and series."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.files.place import remove
from swath.core.files.whole_file import new_file, write_whole
from swath.core.number_text import num, signed
from swath.documents.json_file import write_json
from swath.documents.yaml_document import dump
from swath.report.html import Figure, Items, Section, Table, write_page
from swath.report.plots import GREY, ORANGE, as_image, figure, styled, write_picture
from swath.signals import F64, Mask
from swath.tools.compare_log.compare import SHOWN, LogComparison

LABELS = {"engine_load": "engine load", "engine_speed": "engine speed", "fuel": "fuel"}
WINDOW = 600  # records of the excerpt


FITTED = ("key", "start", "fitted", "standard error", "unit")
REGRESSION = (
    "Regression: a + b flow + c speed, fitted on the first part, without and with the lag of the highest "
    "correlation. Lag: by how much the measured series is later than the simulated one."
)


def begin_comparison(out: Path, fig: Any, results: Mapping[str, Any]) -> None:
    """Write comparison.png and results.json; what only another kind of comparison writes goes."""
    remove(out / "series.parquet")
    write_picture(out / "comparison.png", fig)
    write_json(out / "results.json", results)


def write_compared(
    out: Path, model: str, lead: str, tables: Sequence[Table], fig: Any, notes: Sequence[str]
) -> None:
    """Write report.html."""
    picture = Figure("Picture", as_image(fig), "Measured and simulated series")
    sections = [*tables, picture, Section("Notes", [Items(notes)])]
    write_page(out / "report.html", sections, heading=model, lead=lead, title=f"{model}, compare log")


def write_comparison(made: LogComparison, out: Path) -> None:
    """Write results.json, comparison.png, report.html, machine.yaml (as fitted), series.parquet."""
    out, fig = Path(out), draw(made)
    begin_comparison(out, fig, made.to_dict())
    fitted = [[f.key, num(f.start), num(f.value), num(f.error), f.unit] for f in made.fitted]
    measured = ["quantity", "records", "model", "count", "R²", "RMSE", "bias", "r", "lag [s]"]
    tables = [
        Table(f"Fitted on {made.fitted_on}", FITTED, fitted, (1, 2, 3)),
        Table("Simulated and measured", measured, statistic_rows(made), range(3, 9), REGRESSION),
    ]
    write_compared(out, made.model, f"compared with {made.log_name}", tables, fig, made.log.notes)
    write_whole(out / "machine.yaml", dump(made.sheet, width=110))
    _write_series(made, out / "series.parquet")


def _write_series(made: LogComparison, path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    log = made.log
    part = np.full(len(log), "", dtype=object)
    for name, mask in made.parts.items():
        part[mask] = name
    columns: dict[str, Any] = {"machine": np.array(log.machine_names)[log.machine], "time_s": log.time}
    columns |= {"speed_m_s": log.speed, "flow_kg_s": log.flow, "grade": log.grade, "part": part.tolist()}
    for q, values in made.measured.items():
        columns |= {f"{q}_measured": values, f"{q}_simulated": made.simulated[q]}
    with new_file(path) as file:
        pq.write_table(pa.table(columns), file)


def draw(made: LogComparison) -> Any:
    """One row per quantity: an excerpt over time, simulated over measured, means over the crop flow."""
    with styled():
        rows = list(made.measured)
        fig = figure(12.5, 2.9 * len(rows))
        grid = fig.add_gridspec(len(rows), 4)
        name, mask = list(made.parts.items())[-1]
        start = _excerpt(mask)
        for i, quantity in enumerate(rows):
            _series(fig.add_subplot(grid[i, :2]), made, quantity, slice(start, start + WINDOW), name, i == 0)
            _scatter(fig.add_subplot(grid[i, 2]), made, quantity, mask)
            _over_flow(fig.add_subplot(grid[i, 3]), made, quantity, mask)
    return fig


def _excerpt(mask: Mask) -> int:
    """Start of the stretch of WINDOW records with most that are compared."""
    count = np.convolve(mask.astype(float), np.ones(min(WINDOW, len(mask))), "valid")
    return int(count.argmax())


def _label(quantity: str) -> str:
    return f"{LABELS[quantity]} [{SHOWN[quantity][0]}]"


def _series(ax: Any, made: LogComparison, quantity: str, span: slice, part: str, has_title: bool) -> None:
    time = made.log.time[span] - made.log.time[span][0]
    ax.plot(time, made.measured[quantity][span], color=GREY, lw=1.0, label="measured")
    ax.plot(time, made.simulated[quantity][span], color=ORANGE, lw=1.1, label="simulated")
    ax.set(xlabel="time [s]", ylabel=_label(quantity), xlim=(0, time[-1]))
    if has_title:
        ax.set_title(f"excerpt, {part}", loc="left", fontsize=10)
        ax.legend(ncol=2, loc="upper right", bbox_to_anchor=(1.0, 1.16))


def _limits(*series: F64) -> tuple[float, float]:
    low = min(float(np.percentile(s, 0.3)) for s in series)
    high = max(float(np.percentile(s, 99.7)) for s in series)
    pad = 0.04 * max(high - low, 1e-9)
    return low - pad, high + pad


def _scatter(ax: Any, made: LogComparison, quantity: str, mask: Mask) -> None:
    real, model = made.measured[quantity][mask], made.simulated[quantity][mask]
    low, high = _limits(real, model)
    ax.hexbin(
        real, model, gridsize=45, extent=(low, high, low, high), bins="log", mincnt=1, cmap="Blues", lw=0
    )
    ax.plot([low, high], [low, high], color=GREY, lw=0.9, ls=(0, (4, 3)))
    ax.set(xlim=(low, high), ylim=(low, high), xlabel="measured", ylabel="simulated")
    found = list(made.statistics[quantity].values())[-1]["model"]
    text = f"R² {num(found.r2)}\nRMSE {num(found.rmse)} {SHOWN[quantity][0]}\nlag {signed(found.lag_s)} s"
    ax.text(0.04, 0.96, text.replace("-", "−"), transform=ax.transAxes, va="top", fontsize=9.5)


def _over_flow(ax: Any, made: LogComparison, quantity: str, mask: Mask) -> None:
    flow = made.log.flow[mask]
    edges = np.linspace(np.percentile(flow, 0.5), np.percentile(flow, 99.5), 16)
    where = np.clip(np.digitize(flow, edges), 1, len(edges) - 1)
    least = min(20.0, len(flow) / len(edges))  # of a bin that is drawn: the fullest always is
    for of, colour, label in ((made.measured, GREY, "measured"), (made.simulated, ORANGE, "simulated")):
        values = of[quantity][mask]
        found = [k for k in range(1, len(edges)) if (where == k).sum() >= least]
        x = [flow[where == k].mean() for k in found]
        y = np.array([np.percentile(values[where == k], [10, 50, 90]) for k in found]).reshape(-1, 3)
        ax.fill_between(x, y[:, 0], y[:, 2], color=colour, alpha=0.16, lw=0)
        ax.plot(x, y[:, 1], color=colour, lw=1.5, label=label, marker="o", ms=2.5)
    ax.set(xlabel="crop flow [kg/s]", ylabel="median, 10–90 %")


def statistic_rows(made: LogComparison) -> list[list[str]]:
    """Quantity, part, model, count, R2, RMSE, bias, r, lag as text."""
    rows = []
    for quantity, parts in made.statistics.items():
        for part, models in parts.items():
            fitted = " (fitted)" if part == made.fitted_on else ""
            for k, f in models.items():
                numbers = [str(f.count), *(num(v) for v in (f.r2, f.rmse, f.bias, f.r))]
                rows.append([_label(quantity), part + fitted, k, *numbers, num(f.lag_s)])
    return rows
