"""Makes the figure of docs/how-to/fleet.md: `python docs/figures/fleet.py` in the repository root."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

from swath.job.fleet import read_fleet
from swath.job.work import work_off
from swath.tools.fleet.picture import draw

if __name__ == "__main__":
    fig = draw(work_off(read_fleet("echelon")[0]))
    fig.savefig(Path(__file__).parent / "fleet.png", dpi=90)
