"""Picture and table of `swath scan --converge`."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from swath.study.converge import GROUND_M, Settling, Verdict, table
from swath.view import plots

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
        fig = plots.figure(11.0, 6.2)
        axes = fig.subplots(2, 3).ravel()
        colours = (plots.BLUE, plots.ORANGE, plots.GREEN)
        counts = runs[0].counts
        for ax, (name, label) in zip(axes, PANELS, strict=False):
            for run, colour in zip(runs, colours, strict=False):
                ax.plot(counts, run.statistics()[name], "o-", color=colour, label=f"seed {run.seed}", ms=4)
            last = [run.statistics()[name][-1] for run in runs]
            ax.axhspan(min(last), max(last), color=plots.FAINT, zorder=0)
            ax.set_title(label, loc="left", fontsize=9.5)
        for run, colour in zip(runs, colours, strict=False):
            axes[4].plot(counts[:-1], run.change()[:-1], "o-", color=colour, ms=4)
        axes[4].set_title(f"rms change of single beams to {counts[-1]} [m]", loc="left", fontsize=9.5)
        axes[3].set_ylim(0.0, max(0.02, axes[3].get_ylim()[1]))
        axes[4].set_ylim(bottom=0.0)
        for ax in axes[:5]:
            ax.set_xscale("log")
            ax.set_xticks(counts, [str(n) for n in counts])
            ax.minorticks_off()
            ax.set_xlabel("sub-rays per beam")
        for k, shade in zip(range(len(counts)), np.linspace(0.75, 0.0, len(counts)), strict=True):
            heights = np.sort(runs[0].heights[k][np.isfinite(runs[0].heights[k])])
            part = (np.arange(len(heights)) + 0.5) / max(len(heights), 1)
            axes[5].plot(heights, part, color=str(shade), lw=1.4, label=str(counts[k]))
        axes[5].set_title(f"share of beams below a height, seed {runs[0].seed}", loc="left", fontsize=9.5)
        axes[5].set_xlabel("height of the echo [m]")
        axes[5].legend(title="sub-rays", loc="upper left")
        axes[0].legend(loc="best")
        fig.suptitle(sentence(verdict, runs), x=0.01, ha="left", fontsize=10.5)
        fig.savefig(path, dpi=120, metadata={"Software": None})
    return path


def sentence(verdict: Verdict, runs: Sequence[Settling]) -> str:
    """What came out, in words."""
    most = runs[0].counts[-1]
    if verdict.enough is None:
        return f"No fewer than {most} sub-rays give what {most} give to within the difference of two seeds"
    return (
        f"From {verdict.enough} sub-rays on the heights differ from those with {most} by less than 1 cm, "
        "or by less than other plants make (grey: two seeds)"
    )
