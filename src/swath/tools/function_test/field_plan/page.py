"""report.html of a plan of real passes, and the evidence that came back."""

from collections.abc import Sequence
from pathlib import Path

from swath import __version__
from swath.core.number_text import num
from swath.report.chart import Chart
from swath.report.html import Beside, Items, Section, Table, write_page
from swath.tools.function_test.evidence import evidence_table
from swath.tools.function_test.field_plan.form import FORM, fixed, instruments, logs, scenario_at, why
from swath.tools.function_test.field_plan.plan import Planned, places_of
from swath.tools.function_test.judging.first_batch import banners
from swath.tools.function_test.page import axis_of

SIDE = 260.0  # of a chart [px]
MOST_CHARTS = 6
ABOUT = (
    "Levels are compared in simulation at conditions drawn by how often they occur. How far they are off a "
    "real field is taken as a Gaussian process with as much spread as two levels differ by at the same "
    "conditions; where a level was never checked, as they differ at most. Each pass is the one that leaves "
    "the least of that variance, after those before it, weighted by what is not shown there (integrated mean "
    "squared error, Sacks et al. 1989, doi:10.1214/ss/1177012413)."
)
ABOUT_FORM = (
    "`{0}` is the form: correct the conditions to what they were, write down the date and the files of scans "
    "and log (relative to the form), and give it back with `--filled {0}`: each pass is compared with the "
    "simulation at its conditions, becomes evidence, and counts for the passes that come next."
)


def write_plan(planned: Planned) -> Path:
    """Write the page."""
    names = list(planned.case.file.vary)
    rows = [
        [
            str(n + 1),
            *(num(p.condition.point[name]) for name in names),
            planned.narrowed(p.narrows),
            why(planned, n),
        ]
        for n, p in enumerate(planned.passes)
    ]
    same = "; ".join(fixed(planned))
    recorded = logs(scenario_at(planned, planned.conditions[0].point))
    nothing = planned.doubts_nothing
    together = sum(each.narrows for each in planned.passes)
    return write_page(
        planned.folder / "report.html",
        [
            Table("Passes", ("", *names, "narrows [%]", "why"), rows, (0,), ABOUT_FORM.format(FORM)),
            Section("In every pass", [Items([*recorded, *instruments(planned), f"as well: {same}"])]),
            evidence_table(planned.folder),
            Section("Where levels differ", [Beside(_charts(planned, names))]),
            Section("How they are chosen", [ABOUT]),
        ],
        heading=f"Real passes for {planned.case.name}",
        lead=f"{planned.case.file.objective}; compared: {', '.join(planned.other)}; swath {__version__}",
        verdict=("none", f"{len(planned.passes)} passes", f"no doubt to share: {nothing}" if nothing else
                 f"take away {planned.narrowed(together)} % of the doubt"),
        top=banners(planned.telling_nothing),
    )  # fmt: skip


def _charts(planned: Planned, names: Sequence[str]) -> list[Chart]:
    """Of each number: the difference of the levels over it; the passes in orange."""
    points = [c.point for c in planned.conditions]
    places = places_of(planned.case, points)
    chosen = [id(each.condition) for each in planned.passes]
    most = max(abs(c.apart) for c in planned.conditions) or 1.0
    charts: list[Chart] = []
    for column, name in enumerate(names):
        if planned.case.file.vary[name].range is None or len(charts) == MOST_CHARTS:
            continue
        chart = Chart(SIDE, SIDE / 2, f"difference over {name}", axis_of(planned.case, name),
                      (planned.asked.metric, "0", num(most)))  # fmt: skip
        for condition, place in zip(planned.conditions, places, strict=True):
            fill = "var(--orange)" if id(condition) in chosen else "var(--blue)"
            title = ", ".join(f"{k} {v}" for k, v in condition.point.items())
            chart.dot(float(place[column]), abs(condition.apart) / most, title=title, fill=fill)
        charts.append(chart)
    return charts
