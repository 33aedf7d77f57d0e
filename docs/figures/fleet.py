"""Makes the figure of docs/how-to/fleet.md: `python docs/figures/fleet.py` in the repository root."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

from swath.fleet.files import read_job
from swath.fleet.report import draw
from swath.fleet.schedule import schedule_of
from swath.fleet.worked import by_events

if __name__ == "__main__":
    fig = draw(by_events(schedule_of(read_job("two-combines")[0])))
    fig.savefig(Path(__file__).parent / "fleet.png", dpi=60)
