"""Makes the figure of docs/how-to/devices.md: `python docs/figures/devices.py` in the repository root."""

import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import pyarrow.parquet as pq

from swath.core.foreign_code import allow_code
from swath.runtime.job import run_job
from swath.scenario.scenario import load_scenario

HERE = Path(__file__).parent
EXAMPLES = HERE.parents[1] / "examples" / "devices"


def tracks(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Distance [m] and lateral error [cm] of a run of an example."""
    with tempfile.TemporaryDirectory() as folder, allow_code(None):
        run_job(load_scenario(EXAMPLES / f"{name}.yaml"), Path(folder) / "run")
        table = pq.read_table(
            Path(folder) / "run" / "tracks.parquet", columns=["distance_m", "lateral_error_m"]
        )
    distance, error = (np.array(column, dtype=float) for column in table.to_pydict().values())
    return distance, 100.0 * error


def main() -> None:
    """Both runs, the box in a process of its own for one of them."""
    with subprocess.Popen([sys.executable, str(EXAMPLES / "my_box.py")]):
        wire = tracks("wire")
    figure, axes = plt.subplots(figsize=(8.0, 2.8))
    axes.plot(*tracks("memory"), color="#1f4e99", lw=2.4, label="inside the run")
    axes.plot(*wire, color="#c2185b", lw=1.0, label="in a process of its own, over TCP and UDP")
    axes.set(xlabel="distance [m]", ylabel="lateral error [cm]")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    figure.tight_layout()
    figure.savefig(HERE / "devices.png", dpi=110)


if __name__ == "__main__":
    main()
