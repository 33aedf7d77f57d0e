"""report.html of a check of a twin: measured beside simulated, and where they differ."""

from pathlib import Path
from typing import Any

import numpy as np

from swath.core.number_text import percent_of
from swath.core.units import DEG
from swath.report.html import Facts, Figure, Items, Section, Table, write_page
from swath.report.plots import INK, ORANGE, as_image, figure, styled
from swath.tools.compare_scans.page import (
    ABOUT_MAP,
    ABOUT_NUMBERS,
    ABOUT_PROFILES,
    HEAD,
    draw_map,
    draw_profiles,
    number_rows,
)
from swath.tools.twin.check import DIFFERS, FITS, Checked, write_evidence_of

ABOUT = (
    "The recording fits where the bank says the same of it as the twin does, within both intervals, and its "
    "echoes hang together as those of the bank do. Explained is the share by which "
    "the twin brings heights nearer to the recording than the middle of its ranges does, noise apart."
)
ABOUT_BEAMS = (
    "Standard deviation of the ranges of each beam that sees one surface, and how far its median has moved "
    "since the twin was made."
)


def write_check(out: Path, found: Checked) -> Path:
    """Write report.html, check.json and evidence.csv."""
    write_evidence_of(out, found)
    twin, recording = found.names
    facts = {
        "of what fits as far off": percent_of(found.chance),
        "explained": percent_of(found.explained) if np.isfinite(found.explained) else None,
        "recording": recording,
    }
    made = found.compared
    sections: list[Any] = [Section("What was found", [Items(found.lines), ABOUT])]
    if made is not None:
        sections += [
            Section("What was taken for granted", [Items(made.notes)]),
            Table("A measured, B simulated", HEAD, number_rows(made), (1, 2, 3), ABOUT_NUMBERS),
            Figure("Measured beside simulated", as_image(draw_profiles(made)), ABOUT_PROFILES),
            Figure("Where they differ", as_image(draw_map(made)), ABOUT_MAP),
        ]
    else:
        sections.append(Figure("Measured beside simulated", as_image(draw_beams(found)), ABOUT_BEAMS))
    look = {FITS: "pass", DIFFERS: "fail"}.get(found.verdict, "none")
    return write_page(
        out / "report.html",
        sections,
        heading=f"Twin {twin}",
        lead=f"against {recording}, which it was not made of",
        verdict=(look, found.verdict, f"{percent_of(found.chance)} of what fits is as far off"),
        top=[Facts(facts)],
    )


def draw_beams(found: Checked) -> Any:
    """Of a scanner that stands still: noise of each beam, measured and simulated; how far medians moved."""
    s = found.series
    azimuth = s["azimuth"] / DEG
    with styled():
        fig = figure(11.0, 6.4)
        noise, ranges, moved = fig.subplots(3, 1, sharex=True)
        for name, colour in (("measured", INK), ("simulated", ORANGE)):
            noise.plot(azimuth, 1e3 * s[name], ".", ms=3, color=colour, label=name)
        noise.set(ylabel="noise, one sigma [mm]")
        noise.set_ylim(bottom=0.0)
        noise.legend(loc="lower center", ncol=2)
        ranges.plot(azimuth, s["ranges"], ".", ms=3, color=INK)
        ranges.set(ylabel="range [m]")
        moved.plot(azimuth, 1e3 * s["moved"], ".", ms=3, color=INK)
        moved.set(xlabel="azimuth [deg]", ylabel="median moved [mm]")
    return fig
