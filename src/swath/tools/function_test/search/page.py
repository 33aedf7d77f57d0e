"""report.html of a search: where runs pass and fail over each two parameters, and what matters."""

from collections.abc import Sequence
from itertools import combinations
from math import isfinite
from pathlib import Path
from typing import Any

from swath import __version__
from swath.core.number_text import num, percent_of, signed, span
from swath.report.chart import Chart
from swath.report.html import Beside, Facts, Html, Section, Table, bar, element, joined, write_page
from swath.tools.function_test.judging.first_batch import banners
from swath.tools.function_test.page import axis_of, failures, point_text
from swath.tools.function_test.search.boundary import Boundary
from swath.tools.function_test.search.search import Searched
from swath.tools.function_test.stored_line import Result

SIDE, BINS = 270.0, 22  # of a map [px], squares along it
FAILED_MAX = 60  # runs in the list
PARAMETERS = ("parameter", "key", "range", "alone", "with all that it acts with")
RUNS = "Dots are runs that keep their limits, crosses runs that do not."
COLOURS = (
    "The colour is the share of the other parameters' ranges in which runs are expected to keep them: blue "
    "all, none of both colours half, orange none. Expected is what a Gaussian process makes of the margins."
)
ABOUT_SHARES = "Shares of the margin's variance over the ranges (Sobol's indices), from the same runs."


def write_search(path: Path, found: Searched, checked: tuple[int, int] | None = None) -> Path:
    """Write the page. checked: runs of another test that the boundary foretells right, of how many."""
    boundary, count = found.boundary, len(found.results)
    failed = [result for result in found.judged if result["verdict"] != "pass"]
    rows = [(run, signed(margin)) for run, margin in _nearest_first(found, failed)][:FAILED_MAX]
    maps = [_map(found, boundary, x, y) for x, y in combinations(range(len(found.ranges)), 2)]
    sensitivities = [
        [name, element("code", found.case.file.vary[name].key), span(ends), index(first),
         index(total)]
        for (name, first, total), ends in zip(boundary.sensitivities(), found.ranges.values(), strict=True)
    ]  # fmt: skip
    sections = [
        Section("Where runs pass", [Beside(maps or [_line(found, boundary)]), RUNS, maps and COLOURS]),
        Table("What matters", PARAMETERS, sensitivities, text=ABOUT_SHARES),
        failures("Failed runs, nearest to the boundary first", "margin", rows, len(failed)),
    ]  # fmt: skip
    limit = found.search.limit or "all limits together"
    return write_page(
        path,
        sections,
        heading=f"Boundary of {found.case.name}",
        lead=f"{found.case.file.objective}; {limit}, {count} runs, swath {__version__}",
        verdict=("none", f"{found.passed()[0]} of {count} pass", "chosen near the boundary"),
        top=[
            *banners(found.telling_nothing),
            Facts(
                {
                    "the runs": "; ".join(found.shows),
                    "left out, predicted correctly": f"{percent_of(boundary.right_of_left_out)} of the runs",
                    "other runs, predicted correctly": checked and "{} of {}".format(*checked),
                }
            ),
        ],
    )


def index(share: float) -> Html:
    """A share of a variance; a dash where there is none."""
    return joined((bar(share) if isfinite(share) else "", num(share)))


def _map(found: Searched, boundary: Boundary, x: int, y: int) -> Chart:
    """Over two parameters: the share of the others' ranges in which runs pass, and the runs."""
    names = boundary.names[x], boundary.names[y]
    across, up = (axis_of(found.case, name) for name in names)
    made = Chart(SIDE, SIDE, "{1} over {0}".format(*names), across, up)
    size = 1.0 / BINS
    for row, line in enumerate(boundary.map_of(x, y, BINS)):
        for column, share in enumerate(line):
            looks = (
                ("var(--orange)", 1.0 - 2.0 * share) if share < 0.5 else ("var(--blue)", 2.0 * share - 1.0)
            )
            made.box(
                column * size, row * size, 1.01 * size, 1.01 * size, fill=looks[0], opacity=0.5 * looks[1]
            )
    return _with_runs(made, found, boundary, boundary.points[:, x], boundary.points[:, y])


def _line(found: Searched, boundary: Boundary) -> Chart:
    """The margin over one parameter, from -1 to 1 upwards."""
    x = axis_of(found.case, boundary.names[0])
    made = Chart(SIDE, SIDE, f"margin over {x[0]}", x, ("margin", "-1", "1"))
    made.line(0.0, 0.5, 1.0, 0.5, "3 3")
    return _with_runs(made, found, boundary, boundary.points[:, 0], 0.5 + 0.5 * boundary.margins)


def _with_runs(made: Chart, found: Searched, boundary: Boundary, x: Any, y: Any) -> Chart:
    for a, b, margin, result in zip(x, y, boundary.margins, found.judged, strict=True):
        title = f"{point_text(result['point'], result['seed'])}: margin {signed(margin)}"
        made.run(float(a), float(b), title, keeps=margin >= 0.0)
    return made


def _nearest_first(found: Searched, failed: Sequence[Result]) -> list[tuple[Result, float]]:
    margins = found.margins(failed)
    return sorted(zip(failed, map(float, margins), strict=True), key=lambda pair: (-pair[1], pair[0]["id"]))
