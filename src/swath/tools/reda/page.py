"""What `swath reda` writes: report.html, reda.csv, scores.csv and a figure per condition."""

import csv
import io
from pathlib import Path

from swath.core.whole_file import new_file
from swath.report import plots
from swath.report.html import write_page
from swath.report.page import Figure
from swath.tools.reda.plots import map_figure
from swath.tools.reda.reda import ASKED, Found, write_cells
from swath.tools.reda.scene import WEATHERS, Settings

SCORE_HEAD = ("condition", "sensor", "usability", "availability", "reliability")
ASKED_HEAD = ("condition", "sensor", "height [m]", "detected", "false", "verdict", "why")


def write_all(out: Path, settings: Settings, found: list[Found]) -> list[Path]:
    """Write everything into a folder; returns the files."""
    import matplotlib

    out.mkdir(parents=True, exist_ok=True)
    files = [write_cells(out / "reda.csv", found), _write_scores(out / "scores.csv", settings, found)]
    figures = []
    with matplotlib.rc_context(plots.STYLE):
        for made in found:
            fig = map_figure(made, settings)
            fig.set_dpi(110)
            path = out / made.condition.file
            fig.canvas.print_png(str(path), metadata={"Software": None})
            files.append(path)
            title = f"{settings.crop} {made.condition.name}"
            figures.append(Figure(title, plots.as_image(fig, kind="webp", dpi=110), ""))
    page = write_page(
        out / "report.html",
        "reda.html.j2",
        target=settings.target,
        figures=figures,
        settings=_settings(settings),
        score_head=SCORE_HEAD,
        scores=score_rows(settings, found),
        asked=ASKED,
        asked_head=ASKED_HEAD,
        rows=asked_rows(settings, found),
        least=settings.least,
    )
    return [*files, page]


def score_rows(settings: Settings, found: list[Found]) -> list[tuple[str, ...]]:
    """Of SCORE_HEAD, one per condition and sensor."""
    rows: list[tuple[str, ...]] = []
    for made in found:
        for name in made.cells:
            s = made.scores(name, settings.least)
            numbers = (f"{v:.2f}" for v in (s.usability, s.availability, s.reliability))
            rows.append((made.condition.name, name, *numbers))
    return rows


def asked_rows(settings: Settings, found: list[Found]) -> list[tuple[str, ...]]:
    """Of ASKED_HEAD: does a sensor detect the person 3 m inside the crop, and why."""
    rows: list[tuple[str, ...]] = []
    for made in found:
        for (name, height), cell in made.asked.items():
            verdict = "yes" if cell.net >= settings.least else "no" if cell.net < 0.1 else "at times"
            shares = f"{cell.detected:.2f}", f"{cell.false:.2f}"
            rows.append((made.condition.name, name, f"{height:g}", *shares, verdict, cell.why))
    return rows


def _write_scores(path: Path, settings: Settings, found: list[Found]) -> Path:
    with new_file(path) as out, io.TextIOWrapper(out, "utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(SCORE_HEAD)
        writer.writerows(score_rows(settings, found))
    return path


def _settings(s: Settings) -> dict[str, str]:
    weathers = (
        f"{name}: {dust:g}/m of dust, {rain:g} mm/h" for name in s.weathers for dust, rain in [WEATHERS[name]]
    )
    return {
        "crop": f"{s.crop}, straw at {s.moisture:g} % water",
        "weather": "; ".join(weathers),
        "looks at a place": f"{s.repeats} x {s.looks} of radars, {s.repeats} x 3 of the LiDAR",
        "camera": f"{s.camera_px} px wide, needs {s.camera_least_px:g} px of height",
        "seed": str(s.seed),
    }
