"""Picture and table of `swath scan --converge`."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swath.report import plots
from swath.signals import F64
from swath.tools.scan.converge import GROUND_M, Settling, Verdict, table

COLOURS = (plots.BLUE, plots.ORANGE, plots.GREEN)
PANELS = (
    ("mean_m", "mean height [m]"),
    ("sd_m", "standard deviation [m]"),
    ("p95_m", "95th percentile [m]"),
    ("ground_share", f"share of echoes below {GROUND_M * 100:.0f} cm"),
)


def write_converge(folder: Path, runs: Sequence[Settling], verdict: Verdict) -> list[Path]:
    """scan.converge.png and scan.converge.csv; returns their paths."""
    rows = table(runs)
    listed = folder / "scan.converge.csv"
    with listed.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()})
    return [_picture(folder / "scan.converge.png", runs, verdict), listed]


def _picture(path: Path, runs: Sequence[Settling], verdict: Verdict) -> Path:
    import matplotlib

    with matplotlib.rc_context(plots.STYLE):
        fig = plots.figure(14.0, 6.2)
        axes = fig.subplots(2, 4).ravel()
        counts = runs[0].counts
        for ax, (name, label) in zip(axes, PANELS, strict=False):
            _lines(ax, [(run, run.statistics()[name]) for run in runs], label)
            last = [run.statistics()[name][-1] for run in runs[:2]]
            ax.axhspan(min(last), max(last), color=plots.FAINT, zorder=0)
        axes[3].set_ylim(0.0, max(0.02, axes[3].get_ylim()[1]))
        axes[0].legend(loc="best")
        changes = [(run, np.r_[run.change()[:-1], np.nan]) for run in runs]
        _lines(axes[4], changes, f"rms change of single beams to {counts[-1]} [m]")
        away = [(run, 1e3 * run.away(runs[0])) for run in runs]
        _lines(axes[5], away, f"W1 of heights from seed {runs[0].seed} with {counts[-1]} [mm]")
        axes[5].axhspan(0.0, 1e3 * verdict.seeds_m, color=plots.FAINT, zorder=0)
        for ax in axes[4:6]:
            ax.set_ylim(bottom=0.0)
        for k, shade in zip(range(len(counts)), np.linspace(0.75, 0.0, len(counts)), strict=True):
            _distribution(axes[6], runs[0].heights[k], str(shade), str(counts[k]))
        axes[6].set_title(f"share of beams below a height, seed {runs[0].seed}", loc="left", fontsize=9.5)
        axes[6].legend(title="sub-rays", loc="upper left")
        for run, colour in zip(runs, COLOURS, strict=False):
            style = "--" if run.detail != runs[0].detail else "-"
            _distribution(axes[7], run.heights[-1], colour, _label(run), style)
        axes[7].set_title(f"the same with {counts[-1]} sub-rays", loc="left", fontsize=9.5)
        said = sentence(verdict, runs).replace(". ", ".\n")
        fig.suptitle(said, x=0.01, ha="left", fontsize=10.5)
        fig.savefig(path, dpi=120, metadata={"Software": None})
    return path


def _lines(ax: Any, curves: list[tuple[Settling, F64]], title: str) -> None:
    """A curve per run over the number of sub-rays."""
    for (run, values), colour in zip(curves, COLOURS, strict=False):
        dashed = run.detail != curves[0][0].detail  # it lies on the first one
        ax.plot(run.counts, values, "o--" if dashed else "o-", color=colour, label=_label(run), ms=4)
    ax.set_title(title, loc="left", fontsize=9.5)
    ax.set_xscale("log")
    ax.set_xticks(curves[0][0].counts, [str(n) for n in curves[0][0].counts])
    ax.minorticks_off()
    ax.set_xlabel("sub-rays per beam")


def _distribution(ax: Any, heights: F64, colour: str, label: str, style: str = "-") -> None:
    heights = np.sort(heights[np.isfinite(heights)])
    part = (np.arange(len(heights)) + 0.5) / max(len(heights), 1)
    ax.plot(heights, part, style, color=colour, lw=1.4, label=label)
    ax.set_xlabel("height of the echo [m]")


def _label(run: Settling) -> str:
    return f"seed {run.seed}" if run.detail == "full" else f"seed {run.seed}, {run.detail}"


def sentence(verdict: Verdict, runs: Sequence[Settling]) -> str:
    """What came out, in words."""
    most = runs[0].counts[-1]
    if verdict.enough is None:
        said = f"No fewer than {most} sub-rays give what {most} give to within the difference of two seeds"
    else:
        said = (
            f"From {verdict.enough} sub-rays on the heights differ from those with {most} by less than 1 cm, "
            "or by less than other plants make (grey: two seeds)"
        )
    other = next((run for run in runs if run.detail != runs[0].detail), None)
    if other is None:
        return said
    moved = 1e3 * float(other.away(runs[0])[-1])
    return (
        f"{said}. Plants of detail `{other.detail}` move the heights by W1 {moved:.1f} mm, "
        f"another seed by {1e3 * verdict.seeds_m:.1f} mm"
    )
