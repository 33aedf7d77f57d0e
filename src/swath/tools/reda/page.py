"""What `swath reda` writes: report.html, reda.csv, scores.csv and a figure per condition."""

from pathlib import Path
from typing import Any

import numpy as np

from swath.core.files.whole_file import write_csv
from swath.core.number_text import num
from swath.report import plots
from swath.report.html import Facts, Figure, Section, Table, write_page
from swath.report.plots import CROP, FAINT, INK, ON_DARK, ON_LIGHT, figure
from swath.tools.reda.reda import ASKED, Cell, Found, write_cells
from swath.tools.reda.scene import ASIDE, EDGE_M, INSIDE, WEATHERS, Settings

DARK = 0.55  # shares above this are written in white
ASIDE_STEP = ASIDE[1] - ASIDE[0]


def map_figure(found: Found, settings: Settings) -> Any:
    """A panel per sensor: shares of looks, the sensors at the bottom in the middle, crop above the line."""
    names = list(found.cells)
    fig = figure(0.8 + 3.1 * len(names), 5.6)
    panels = fig.subplots(1, len(names), sharey=True, squeeze=False)[0]
    image = None
    for ax, name in zip(panels, names, strict=True):
        image = _panel(ax, found.cells[name], is_first=ax is panels[0])
        scores = found.scores(name, settings.least)
        scores_text = f"usable {num(scores.usability)}, available {num(scores.availability)}"
        ax.set_title(f"{name}\n{scores_text},\nreliable {num(scores.reliability)}", loc="left", fontsize=9)
        ax.set_xlabel("aside [m]")
    panels[0].set_ylabel("ahead of the sensors [m]")
    fig.colorbar(image, ax=panels, shrink=0.75, label="share of looks that detect the person")
    fig.suptitle(f"{settings.crop} {found.condition.name}", x=0.01, ha="left", fontsize=11)
    return fig


def _panel(ax: Any, cells: list[Cell], *, is_first: bool) -> Any:
    net = np.array([cell.net for cell in cells]).reshape(len(INSIDE), len(ASIDE))
    ahead = EDGE_M + np.array(INSIDE)
    between = 0.5 * (ahead[1:] + ahead[:-1])
    rows = np.concatenate([[2.0 * ahead[0] - between[0]], between, [2.0 * ahead[-1] - between[-1]]])
    columns = np.append(np.array(ASIDE) - 0.5 * ASIDE_STEP, ASIDE[-1] + 0.5 * ASIDE_STEP)
    image = ax.pcolormesh(columns, rows, net[:, ::-1], cmap="viridis_r", vmin=0.0, vmax=1.0)
    for cell in cells:
        colour = ON_DARK if cell.net > DARK else ON_LIGHT
        text = num(100 * cell.net)
        ax.text(-cell.aside, EDGE_M + cell.inside, text, ha="center", va="center", color=colour, fontsize=9)
    ax.axhline(EDGE_M, color=CROP, lw=3.0)
    if is_first:
        style = {"color": INK, "fontsize": 9, "va": "center", "ha": "right"}
        ax.annotate("crop begins", (columns[0], EDGE_M), (-26, 0), textcoords="offset points", **style)
    ax.plot(0.0, 0.6, marker="^", color=INK, ms=9, clip_on=False)
    ax.set_ylim(0.0, rows[-1])
    ax.grid(visible=False)
    ax.set_facecolor(FAINT)
    ax.set_xticks([-8, -4, 0, 4, 8], ["8 left", "4", "0", "4", "8 right"])
    return image


ABOUT_SCORES = (
    "Usability: share of the places that are covered in at least {0} of the looks. Availability: share of "
    "all looks that detect the {1}, without those that report something there anyway. Reliability: lower "
    "end of the interval of 95 % of being right, looks with and without a {1} together. The names are "
    "those of Validation Scores (doi:10.3390/electronics13122396), the formulas our own."
)
ABOUT = (
    "Machine and {0} stand. LiDAR: 16 lines, every plant, and the objects that the level `cluster` makes "
    "of its scans. Radars: single detections of the level `rays`. Camera: height in pixels of what the "
    "crop leaves in sight, and contrast; no detector is run. Nothing here was compared with a measurement."
)
SCORE_HEAD = ("condition", "sensor", "usability", "availability", "reliability")
ASKED_HEAD = ("condition", "sensor", "height [m]", "detected", "false", "verdict", "why")


def write_all(out: Path, settings: Settings, found: list[Found]) -> list[Path]:
    """Write everything into a folder; returns the files."""
    rows = [dict(zip(SCORE_HEAD, row, strict=True)) for row in score_rows(settings, found)]
    files = [write_cells(out / "reda.csv", found), write_csv(out / "scores.csv", rows)]
    figures = []
    with plots.styled():
        for made in found:
            fig = map_figure(made, settings)
            files.append(plots.write_picture(out / made.condition.file, fig, 110))
            title = f"{settings.crop} {made.condition.name}"
            figures.append(Figure(title, plots.as_image(fig), ""))
    sections = [
        Table(f"{num(ASKED)} m inside the crop", ASKED_HEAD, asked_rows(settings, found)),
        Table("Scores", SCORE_HEAD, score_rows(settings, found), (2, 3, 4),
              ABOUT_SCORES.format(settings.least, settings.target)),
        *figures,
        Section("How to read this", [ABOUT.format(settings.target)]),
    ]  # fmt: skip
    lead = (
        f"A {settings.target} on a grid of places before and behind a crop edge, by sensor, crop and weather."
    )
    top = [Facts(_settings(settings))]
    page = write_page(
        out / "report.html", sections, heading="Detection area", title="reda", lead=lead, top=top
    )
    return [*files, page]


def score_rows(settings: Settings, found: list[Found]) -> list[tuple[str, ...]]:
    """Rows under SCORE_HEAD, one per condition and sensor."""
    rows: list[tuple[str, ...]] = []
    for made in found:
        for name in made.cells:
            s = made.scores(name, settings.least)
            numbers = (num(v) for v in (s.usability, s.availability, s.reliability))
            rows.append((made.condition.name, name, *numbers))
    return rows


def asked_rows(settings: Settings, found: list[Found]) -> list[tuple[str, ...]]:
    """Rows under ASKED_HEAD: does a sensor detect the person 3 m inside the crop, and why."""
    rows: list[tuple[str, ...]] = []
    for made in found:
        for (name, height), cell in made.asked.items():
            verdict = "yes" if cell.net >= settings.least else "no" if cell.net < 0.1 else "at times"
            shares = num(cell.detected), num(cell.false)
            rows.append((made.condition.name, name, num(height), *shares, verdict, cell.why))
    return rows


def _settings(s: Settings) -> dict[str, str]:
    weathers = (
        f"{name}: {num(dust)}/m of dust, {num(rain)} mm/h"
        for name in s.weathers
        for dust, rain in [WEATHERS[name]]
    )
    cameras = {"camera", "thermal"} & {*s.sensors}
    radars = {*s.sensors} - {"lidar", "camera", "thermal"}
    looks = [f"{s.repeats} x {s.looks} of radars"] if radars else []
    looks += [f"{s.repeats} x 3 of the LiDAR"] if "lidar" in s.sensors else []
    looks += [f"{s.repeats} of cameras"] if cameras else []
    return {
        "crop": f"{s.crop}, straw at {num(s.moisture)} % water",
        "weather": "; ".join(weathers),
        "looks at a place": ", ".join(looks),
        **({"camera": f"{s.camera_px} px wide, needs {num(s.camera_least_px)} of height"} if cameras else {}),
        "seed": str(s.seed),
    }
