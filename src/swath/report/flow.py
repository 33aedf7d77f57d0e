"""Where the crop went in a combine: bands as wide as the mass that took each way."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from swath.core.number_text import num, percent_of
from swath.core.schedule import NS
from swath.record.charts import shown_charts
from swath.record.message_factory import RecordedMachine
from swath.report import plots
from swath.report.scan_sampler import Sampler
from swath.signals import MachineLoad, OrganLoads, Signal

LOST = ("threshing_loss", "separation_loss", "cleaning_loss")
LOST_AS = ("unthreshed", "lost in the straw", "lost in the chaff")
FLOWS = ("header_flow", "drum_flow", "shoe_flow", "return_flow", *LOST)
INCHES, HIGH, BELOW = 11.0, 3.9, 1.4  # of the drawing, and of a chart below it [inch]
HEADER, DRUM, SHOE, END = 0.85, 3.0, 5.3, 7.6  # where crop is taken in, worked on and left [inch]
FOOT = 0.45  # for the name of the axis of time [inch]
TOP, GAP, AISLE = 0.35, 0.24, 0.45  # above all, between ends, and below the straw [inch]
THIN = 1.2  # width of a band at least [point]


@dataclass
class FlowSampler(Sampler):
    """Observer that adds up what went through a machine. kg: masses by flow of `MachineLoad`."""

    SEEN = (MachineLoad, OrganLoads)

    machine: RecordedMachine
    kg: dict[str, float] = field(default_factory=lambda: dict.fromkeys(FLOWS, 0.0))
    load: MachineLoad | None = None
    tank_mog: float = 0.0

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Watch what `slot` published."""
        for sample in outputs.values():
            if isinstance(sample, OrganLoads):
                self.tank_mog = sample.tank_mog
            elif isinstance(sample, MachineLoad):
                h = 0.0 if self.load is None else (sample.t - self.load.t) / NS
                for name in FLOWS:
                    self.kg[name] += h * getattr(sample, name)
                self.load = sample

    @property
    def shows(self) -> bool:
        """Whether crop went through organs that can be told apart."""
        return self.kg["header_flow"] > 0.0 and self.kg["return_flow"] + self.kg["cleaning_loss"] > 0.0


def flow_figure(found: FlowSampler, tracks: Mapping[str, Any]) -> Any:
    """The ways of the crop, from the header to straw, losses and tank.

    Below them over time what is lost and what was set, so that one is seen to follow from the other.
    """
    charts = shown_charts(tracks, cuts=True, of_flow=True)
    whole = HIGH + BELOW * len(charts) + FOOT
    fig = plots.figure(INCHES, whole, layout=None)
    ax = fig.add_axes((0.0, 1.0 - HIGH / whole, 1.0, HIGH / whole))
    ax.set(xlim=(0.0, INCHES), ylim=(HIGH, 0.0))
    ax.set_axis_off()
    _ways(ax, found)
    left, end = HEADER / INCHES, max(float(tracks["t_s"][-1]), 1.0)
    for k, chart in enumerate(charts, 1):
        low, is_last = BELOW * (len(charts) - k) + FOOT, k == len(charts)
        below = fig.add_axes((left, low / whole, 0.98 - left, (BELOW - 0.4) / whole))
        plots.draw_chart(below, "t_s", {"": tracks}, chart)
        below.set(xlim=(0.0, end), xlabel="time [s]" if is_last else "")
        below.tick_params(labelbottom=is_last)
    return fig


def _ways(ax: Any, found: FlowSampler) -> None:
    kg, load = found.kg, found.load
    assert load is not None
    cut, drum, shoe, back = (kg[f"{name}_flow"] for name in ("header", "drum", "shoe", "return"))
    lost, grain = [kg[name] for name in LOST], load.tank_gain + load.lost_grain
    straw = min(max(drum - shoe - lost[0] - lost[1], 0.0), load.dropped_straw)
    inch = (HIGH - TOP - 5.0 * GAP - 0.1) / max(cut + back, drum)  # per kg

    def across(x: float, y: float, to_x: float, to_y: float, mass: float, colour: str) -> None:
        y, to_y, middle = y + 0.5 * mass * inch, to_y + 0.5 * mass * inch, 0.5 * (x + to_x)
        _band(ax, [(x, y), (middle, y), (middle, to_y), (to_x, to_y)], mass * inch, colour)

    def say(x: float, y: float, label: str, mass: float, share: str = "", ha: str = "left") -> None:
        ax.text(x, y, f"{label} {num(mass)} kg{share}", va="center", ha=ha)

    across(HEADER, TOP, DRUM, TOP, cut, plots.CROP)
    say(HEADER, TOP - 0.14, "cut", cut)
    ends = (
        ("straw", straw, plots.STRAW), ("unthreshed", lost[0], plots.ORANGE),
        ("lost in the straw", lost[1], plots.ORANGE), ("chaff", load.dropped_straw - straw, plots.STRAW),
        ("lost in the chaff", lost[2], plots.ORANGE), ("tank", load.tank_gain + found.tank_mog, plots.GREEN),
    )  # fmt: skip
    x, y, to, organs = DRUM, TOP, TOP, [(DRUM, TOP, "threshing,\nseparation", drum)]
    for label, mass, colour in ends:
        if label == "chaff":
            across(DRUM, y, SHOE, y + AISLE, shoe, plots.CROP)
            x, y = SHOE, y + AISLE
            organs.append((x, y, "cleaning", shoe))
        across(x, y, END, to, mass, colour)
        share = f", {percent_of(mass / grain)} of the grain" if label in LOST_AS and grain > 0.0 else ""
        say(END + 0.08, to + 0.5 * mass * inch, label, mass, share)
        y, to = y + mass * inch, to + mass * inch + GAP
    low, into = y + 0.5 * back * inch, TOP + (cut + 0.5 * back) * inch
    bottom = max(low, into) + 0.5
    right = [(SHOE, low), (SHOE + 0.5, low), (SHOE + 0.5, bottom), (SHOE, bottom)]
    turn = [(DRUM, bottom), (DRUM - 0.5, bottom), (DRUM - 0.5, into), (DRUM, into)]
    _band(ax, [*right, right[-1], turn[0], *turn], back * inch, plots.CROP)
    say(0.5 * (DRUM + SHOE), bottom + 0.17, "returns", back, ha="center")
    for x, y, label, mass in organs:
        ax.plot([x, x], [y, y + mass * inch], color=plots.INK, lw=3.0, solid_capstyle="butt")
        middle = y + 0.5 * mass * inch
        ax.text(x - 0.1, middle, label, ha="right", va="center", color=plots.ON_LIGHT)


def _band(ax: Any, points: list[tuple[float, float]], inches: float, colour: str) -> None:
    """A curve through a start and three points of each of its pieces, so wide."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    path = Path(points, [Path.MOVETO] + [Path.CURVE4] * (len(points) - 1))
    ax.add_patch(PathPatch(path, fc="none", ec=colour, lw=max(72.0 * inches, THIN), capstyle="butt"))
