"""Draws docs/figures/fleet-hours.png from the table of docs/fleet-hours.md: how far hours of driven machines
are off those of events, for the same passes of each combine.

python docs/figures/fleet_hours.py
"""

import re
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

HERE = Path(__file__).parent
INK, GRID, SHADE = "#33373d", "#d9dbde", "#eef3ea"
RUST, PALE = "#c2571a", "#fbf3ec"
KINDS = (  # fill, edge
    ("kinematic machines", "#7a8794", "#7a8794", "o"),
    ("with sensors", RUST, RUST, "D"),
    ("with sensors, speeds up to 1 % off", PALE, RUST, "D"),
)
CARTS = {"one": -1, "two": 0, "three": 1}
Row = tuple[str, int, float | None, float | None, float | None]


def rows_of(page: str) -> list[Row]:
    """Layout and combines, place among its numbers of carts, hours off those by events, with kinematic
    machines, with sensors and with speeds a little off [%].
    """
    found = []
    for line in page.splitlines():
        cells = [c.strip() for c in line.strip().strip("|").split("|")]
        head = re.match(r"(\d+), [\d.]+ ha, (\w+); (\w+)", cells[0])
        if head is None:
            continue
        layout, combines, carts = head.groups()
        hours = [_seconds(cell) for cell in cells[3:7]]
        if hours[0] is not None:
            off = [None if h is None else 100.0 * (h / hours[0] - 1.0) for h in hours[1:]]
            found.append((f"{layout}\n{combines}", CARTS[carts], *off))
    return found


def _seconds(cell: str) -> float | None:
    match = re.match(r"(\d+) s", cell)
    return float(match[1]) if match else None


def draw(rows: list[Row]) -> plt.Figure:
    """A column for each layout, with its numbers of carts from left to right."""
    fig, ax = plt.subplots(figsize=(11, 3.6), layout="constrained")
    ax.axhspan(-5.0, 5.0, color=SHADE, zorder=0)
    ax.axhline(0.0, color=INK, lw=0.8, zorder=1)
    names = list(dict.fromkeys(row[0] for row in rows))
    for n, name in enumerate(names):
        for row in (row for row in rows if row[0] == name):
            x = n + 0.24 * row[1]
            for (_, fill, edge, mark), off in zip(KINDS, row[2:], strict=True):
                if off is not None:
                    ax.plot(x, off, mark, mfc=fill, mec=edge, ms=5, zorder=3)
    for label, fill, edge, mark in KINDS:
        ax.plot([], [], mark, mfc=fill, mec=edge, ms=5, label=label)
    ax.set_xticks(range(len(names)), names)
    ax.set_xlim(-0.6, len(names) - 0.4)
    most = max(abs(off) for row in rows for off in row[2:] if off is not None)
    ax.set_ylim(-most - 2.0, most + 2.0)
    ax.set_ylabel("hours, off those by events [%]")
    ax.set_xlabel("layout, combines; one to three carts from left to right")
    ax.grid(axis="y", color=GRID, lw=0.6)
    ax.legend(frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    return fig


if __name__ == "__main__":
    page = (HERE.parent / "fleet-hours.md").read_text(encoding="utf-8")
    draw(rows_of(page)).savefig(HERE / "fleet-hours.png", dpi=90, metadata={"Software": None})
