"""The picture of a job: the field with its passes in the order of working, and what each machine did when."""

from typing import Any

import numpy as np

from swath.job.timeline import STATES
from swath.job.work import JobResult
from swath.report.plots import BLUE, CROP, GREEN, GREY, INK, ORANGE, PURPLE, SKY, STYLE, figure

COLOURS = dict(zip(STATES, (CROP, SKY, PURPLE, ORANGE, GREY, GREEN), strict=True))
LABELS = {
    "cut": "cut", "turn": "turn", "unload": "unload, standing", "wait": "wait", "transport": "transport",
    "load": "cart is filled",
}  # fmt: skip


def draw(r: JobResult) -> Any:
    """Map above, timelines below."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        fig = figure(11.0, 7.6 + 0.5 * len(r.machines))
        grid = fig.add_gridspec(2, 1, height_ratios=(6.0, 0.9 + 0.5 * len(r.machines)))
        _map(fig, fig.add_subplot(grid[0]), r)
        _timelines(fig.add_subplot(grid[1]), r)
    return fig


def _map(fig: Any, ax: Any, r: JobResult) -> None:
    """Passes coloured by when they were cut; dashed where no cart may drive on the left; paths of turns."""
    import matplotlib as mpl

    plan = r.plan
    ring = np.concatenate([plan.boundary, plan.boundary[:1]])
    ax.fill(ring[:, 0], ring[:, 1], color="#F7F4EC", zorder=0)
    ax.plot(ring[:, 0], ring[:, 1], color=INK, lw=1.2)
    for hole in plan.holes:
        ax.fill(hole[:, 0], hole[:, 1], color="white", ec=INK, lw=0.8)
    shades = mpl.colormaps["viridis"]
    last = r.harvest_time
    order = sorted(r.pass_times, key=lambda i: r.pass_times[i][0])
    for i in order:
        p = plan.passes[i]
        colour = shades(0.92 * r.pass_times[i][0] / last)
        dashes = "-" if p.cart_beside else (0, (4, 2))
        ax.plot(p.line[:, 0], p.line[:, 1], color=colour, lw=1.6, ls=dashes)
    driven = zip(r.machines, r.ways, strict=True) if r.level == "sensors" else ()
    for m, way in driven:
        shade = INK if m.kind == "combine" else ORANGE
        ax.plot(way[:, 0], way[:, 1], color=shade, lw=0.8, label=f"way of {m.name}")
    for k, way in enumerate(r.ways if r.level != "sensors" else ()):
        ax.plot(way[:, 0], way[:, 1], color=GREY, lw=0.6, label=None if k else "turns, ways between passes")
    for k, ring in enumerate(r.ground.pieces if r.ground is not None else ()):
        name = "no knife went there" if k == 0 else None
        ax.fill(ring[:, 0], ring[:, 1], color=ORANGE, lw=0.5, zorder=4, label=name)
    spots = [spot for pair in r.contacts for spot in pair.places]
    if spots:
        x, y = zip(*spots, strict=True)
        ax.plot(x, y, marker="x", ms=5, mew=1.2, color=INK, ls="none", zorder=5, label="bodies touch")
    truck = r.file.truck
    ax.plot([truck.x_m], [truck.y_m], marker="s", ms=8, color=BLUE, ls="none", label="truck")
    ax.plot([], [], color=GREY, ls=(0, (4, 2)), label="standing crop or boundary on the left: no cart there")
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=4)
    ax.set_aspect("equal")
    ax.grid(visible=False)
    ax.set(xlabel="east [m]", ylabel="north [m]")
    scale = mpl.cm.ScalarMappable(mpl.colors.Normalize(0.0, last / 3600.0), shades)
    fig.colorbar(scale, ax=ax, label="cut after [h]", shrink=0.8, pad=0.01)


def _timelines(ax: Any, r: JobResult) -> None:
    """A bar per machine."""
    names = [m.name for m in r.machines]
    for row, m in enumerate(r.machines):
        for state in STATES:
            bars = [
                (s.start / 3600.0, (s.end - s.start) / 3600.0) for s in m.timeline.spans if s.state == state
            ]
            ax.broken_barh(bars, (row - 0.36, 0.72), color=COLOURS[state], lw=0)
    for state in STATES:
        ax.barh([0], [0], color=COLOURS[state], label=LABELS[state])
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.set(xlabel="time [h]", xlim=(0.0, r.duration / 3600.0))
    ax.grid(visible=False)
    ax.legend(ncol=6, loc="lower left", bbox_to_anchor=(0.0, 1.0))
