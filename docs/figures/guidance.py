"""Makes the figure of docs/explanation/steering.md."""

import tempfile
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import pyarrow.parquet as pq

from swath.runtime.job import run_job
from swath.scenario.scenario import load_scenario

HERE = Path(__file__).parent
QUALITIES = ("none", "single", "dgps", "float", "fix")
LOST, LED = "#c2185b", "#2a7f3e"


def columns() -> dict[str, np.ndarray]:
    """Columns of the tracks of `gnss-lost`."""
    with tempfile.TemporaryDirectory() as folder:
        run_job(load_scenario("gnss-lost"), Path(folder) / "run")
        table = pq.read_table(Path(folder) / "run" / "tracks.parquet").to_pydict()
    return {name: np.array(values, dtype=float) for name, values in table.items() if name != "machine"}


def outage_figure() -> None:
    """Quality of the fix, error of the pose beside what it says, and the header end beside its line."""
    c = columns()
    t = c["t_s"]
    figure, axes = plt.subplots(3, 1, figsize=(8.0, 6.4), sharex=True, height_ratios=(1.0, 1.6, 1.6))
    axes[0].step(t, c["fix_quality"], color="#333333", where="post")
    axes[0].set_yticks(range(5), QUALITIES)
    axes[0].set_ylabel("fix")
    off = 100.0 * np.hypot(c["pose_x_m"] - c["x_m"], c["pose_y_m"] - c["y_m"])
    said = 100.0 * 2.0 * np.maximum(c["pose_x_sd_m"], c["pose_y_sd_m"])
    axes[1].fill_between(t, 0.0, said, color="#dddddd", label="2 sd of the filter")
    axes[1].plot(t, off, color="#1f4e99", label="error of the pose")
    axes[1].set_ylabel("cm")
    axes[1].legend(loc="upper left", frameon=False)
    axes[2].plot(t, 100.0 * c["lateral_error_m"], color="#333333", label="header end beside its line")
    axes[2].axhline(0.0, color="#999999", linewidth=0.6)
    axes[2].set_ylabel("cm")
    axes[2].set_xlabel("time, s")
    axes[2].set_ylim(-15.0, 15.0)
    axes[2].legend(loc="upper left", frameon=False)
    for axis in axes:
        axis.axvspan(25.0, 45.0, color=LOST, alpha=0.10, linewidth=0)
        led = c["path_following"] > 0.5
        axis.axvspan(t[led][0], t[led][-1], color=LED, alpha=0.20, linewidth=0)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].text(25.3, 4.35, "receiver silent", color=LOST, fontsize=9)
    axes[0].text(36.4, 1.2, "steered\nby pose", color=LED, fontsize=9)
    figure.tight_layout()
    figure.savefig(HERE / "gnss-lost.png", dpi=110)


if __name__ == "__main__":
    outage_figure()
