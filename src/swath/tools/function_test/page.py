"""report.html of a function test: a matrix of cases and candidates, every run a dot against its limit."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import log1p
from pathlib import Path
from typing import Any

from swath import __version__
from swath.core.number_text import num, signed, span
from swath.judge.evaluators.edge_detection import EPISODE_M, WRONG_M
from swath.report.chart import Chart
from swath.report.html import (
    Banner,
    Beside,
    Html,
    Section,
    Table,
    counted,
    element,
    joined,
    verdict,
    write_page,
)
from swath.terminal.outcome import limit_text
from swath.tools.function_test.case import Case
from swath.tools.function_test.cells import Cell
from swath.tools.function_test.judging.first_batch import banners
from swath.tools.function_test.judging.integrity import (
    BIN_COUNT,
    BIN_M,
    episodes_per_km,
    pooled,
)
from swath.tools.function_test.judging.judged import UNCOUNTED, UNJUDGED
from swath.tools.function_test.judging.kept_runs import Kept
from swath.tools.function_test.judging.ranking import HEAD, by_tag, ranking
from swath.tools.function_test.judging.steering_accuracy import CLASS_COUNT, accuracy
from swath.tools.function_test.judging.verdict import BROKEN, NOT_JUDGED, NOT_SHOWN, SHOWN, VERDICTS

WIDTH, HEIGHT = 260.0, 38.0  # of a strip [px]
COLOURS = (
    *("var(--blue)", "var(--orange)", "var(--green)"),
    *("#cc79a7", "#e69f00", "#56b4e9", "#b8a800"),
    "var(--ink)",
)
WIDE, HIGH, SIDE = 340.0, 150.0, 300.0  # of a chart and of the Stanford diagram [px]
PAD = 0.06  # of a chart that is left free at its sides
MISTAKES = 0.1  # largest share of runs on the wrong side of a boundary that is drawn
FAILED_MAX, FAILED_LEAST = 200, 3  # runs in the list of failures; of one case and candidate at least
AGAIN = "`swath test again FOLDER RUN` makes a run again with its report."
ABOUT_CELLS = (
    "Each dot is a run. Right of the dashed line it keeps all limits, left of it one is broken; the "
    "distance is the margin to its nearest limit, from -1 to 1. Open circles are failures that the case "
    "expects, grey open circles are runs that are not judged. Below stands the smallest margin to each "
    "limit: 1 is the best possible value, 0 the limit itself. Limits that are only kept or broken, such "
    f"as on the distance driven, are listed where they fail. {AGAIN}"
)
ABOUT_CHARTS = (
    "The margin of each run, upwards from -1 to 1; above the dashed line it keeps all limits. The dotted "
    "line is the value that separates passing from failing runs of {}; it is drawn where it does so for "
    "at least nine of ten."
)
ABOUT_STANFORD = (
    "Stanford diagram: to the right the error of the edge, upwards three standard deviations as the "
    "detector states them, both from 0 to {0} m and more; in the top row it is not sure. Below the "
    "diagonal the error is more than was stated. Where that is shaded it is hazardous: sure, and more "
    "than {1} m off. An episode is an unbroken stretch of that of more than {2} m."
)
ABOUT_STEERING = (
    "Lateral error of the header end at every 10 cm of the way after settling, in classes of 1 cm: root mean "
    "square over the runs of a point, and the class up to which 95 % lie, the form in which DLG TestService "
    "reports steering systems."
)
ABOUT_OUTSIDE = (
    "In these runs a level that a limit rests on met more than it was checked for, so neither a pass nor "
    "a failure says anything. They do not count; a claim with such runs is not judged, unless the others "
    "break it. `swath levels SLOT` lists the ranges."
)
ABOUT_RANKS = (
    "By the runs that keep their limits, then by the mean error of the edge. Means, and mean differences to "
    "{} of the same case, point and seed, with the interval that holds them with 95 %; not shown where that "
    "holds 0. Beside a smaller error stands the share of runs with a harm that so many pairs cannot exclude, "
    "and the mean over the tenth of the pairs that is worst. Sure and wrong: the share of samples with a "
    "confidence of 0.5 and more and an error of more than 0.3 m; right of it the runs with more than 1 % of "
    "them. Time is the median of what the detector's "
    "step took, on the machine and beside the work that there was."
)
ABOUT_CLAIMS = (
    "A claim (at least so many of 100 runs pass) is **shown** when the runs exclude every lower rate, "
    "**broken** when they exclude the claimed one, each with the confidence of the case, and **not "
    "shown** while there are too few runs to say either. Ten of ten runs show 74 %, not certainty."
)
OPEN_LOOP = (
    "Open loop: {} steers; the other candidates see its scans and do not act on the machine. They are "
    "judged by the limits on detection alone."
)


def write_matrix(path: Path, cells: Sequence[Cell], *, shadow: bool = False,
                 nothing: Mapping[str, str] | None = None) -> Path:  # fmt: skip
    """Write the page. shadow: all candidates but the first were in open loop; nothing: what tells nothing."""
    candidates = list(dict.fromkeys(cell.candidate for cell in cells))
    cases = list(dict.fromkeys(cell.case.name for cell in cells))
    by_place = {(cell.case.name, cell.candidate): cell for cell in cells}
    failing = [cell for cell in cells if cell.failed.count]
    each = max(FAILED_LEAST, FAILED_MAX // max(1, len(failing)))
    failed = [_failure(cell, run) for cell in failing for run in cell.failed.runs[:each]]
    charts = [
        (case, found) for case in cases if (found := over_parameters([by_place[case, c] for c in candidates]))
    ]
    diagrams = [
        diagram
        for number, c in enumerate(candidates)
        if (diagram := stanford([by_place[case, c] for case in cases], number))
    ]
    counts = {v: sum(c.verdict == v for c in cells) for v in VERDICTS}
    groups = _groups(cells)
    about = f"{counted(len(cases), 'case')}, {counted(len(candidates), 'candidate')}"
    tags, rows = by_tag(cells)
    ranks = []
    if len(candidates) > 1:
        about_ranks = ABOUT_RANKS.format(candidates[0])
        ranks.append(Table("", HEAD, ranking(cells), (0, *range(2, 10)), about_ranks))
        ranks.append(Table("", tags, rows, range(1, 1 + len(candidates))))
    sections = [
        Section("Candidates", ranks),
        Table(
            "Cases and candidates",
            ["case", *candidates],
            [
                [
                    joined(
                        (
                            element("strong", case),
                            element("small", by_place[case, candidates[0]].case.file.objective),
                        )
                    ),
                    *(_cell(by_place[case, c]) for c in candidates),
                ]
                for case in cases
            ],
            text=ABOUT_CELLS,
        ),
        Section("Margin over parameters", _over(charts, candidates)),
        Section(
            "Error against stated confidence",
            [
                Beside(diagrams),
                ABOUT_STANFORD.format(num(BIN_M * BIN_COUNT), num(WRONG_M), num(EPISODE_M)),
            ]
            if diagrams
            else [],
        ),
        Table(
            "Steering accuracy",
            ["case", "point", "candidate", "runs", "RMS", "95 % lie within"],
            [row for cell in cells for row in _steering(cell)],
            (3, 4, 5),
            ABOUT_STEERING,
        ),
        Table(
            "Known failures",
            ["case", "candidate", "runs there", "of them pass", "what is known"],
            [_known(cell) for cell in cells if cell.known],
            (2, 3),
            "Runs at points where the case says that a failure is known. They do not count for its claim.",
        ),
        Table(
            "Not judged",
            ["case", "candidate", "runs", "slot, level, quantity", "where"],
            [row for cell in cells for row in _outside(cell)],
            (2,),
            ABOUT_OUTSIDE,
        ),
        Table(
            "Failures, put together",
            ["case", "candidate", "first limit that fails", "runs", "where"],
            groups,
            (3,),
        ),
        Table(
            "Failed runs",
            ["case", "candidate", "point", "run", "reason"],
            failed if groups else [],
            text=more(sum(cell.failed.count for cell in failing), len(failed)),
        ),
        Section("How to read this", [ABOUT_CLAIMS]),
    ]
    surprises = [(cell, run) for cell in cells for run in cell.surprises.runs]
    unexpected = sum(cell.surprises.count for cell in cells)
    return write_page(
        path,
        sections,
        heading="Function tests",
        lead=f"{about}, {counted(sum(c.count for c in cells), 'run')}, swath {__version__}",
        verdict=_verdict(counts),
        top=[
            *banners(nothing or {}),
            Banner(OPEN_LOOP.format(candidates[0])) if shadow else "",
            Banner(
                f"{counted(unexpected, 'run')} pass{'es' if unexpected == 1 else ''} where the case says "
                "that a failure is known: "
                f"{', '.join(f'{c.case.name} ({point_text(r.point, r.seed)})' for c, r in surprises[:5])}."
            )
            if surprises
            else "",
        ],
    )


def point_text(point: Mapping[str, object], seed: int) -> str:
    """Where a run lies in the parameters of its case, and its seed."""
    named = (f"{k} {num(v)}" if isinstance(v, float) else f"{k} {v}" for k, v in point.items())
    return ", ".join((*named, f"seed {seed}"))


def axis_of(case: Case, name: str) -> tuple[str, str, str]:
    """A parameter of a case as the axis of a chart: its name, and the ends of its range or list of values."""
    varied = case.file.vary[name]
    low, high = varied.range or (varied.drawn_values[0], varied.drawn_values[-1])
    return name, *(end if isinstance(end, str) else num(end) for end in (low, high))  # type: ignore[return-value]


def failures(title: str, column: str, rows: Sequence[tuple[Mapping[str, Any], str]], count: int) -> Table:
    """Failed runs with a number of each in a column; of `count` some may be left out."""
    cells = [
        [point_text(run["point"], run["seed"]), element("code", run["id"][:8]), value, run["reason"]]
        for run, value in rows
    ]
    head = ("point", "run", column, "reason")
    return Table(title, head, cells, (2,), f"{more(count, len(cells))} {AGAIN}")


def more(count: int, shown: int, where: str = "`results.parquet`") -> str:
    """Says that a list on the page is not all."""
    return f"{count - shown} more are in {where}." if count > shown else ""


def _verdict(counts: Mapping[str, int]) -> tuple[str, str, str]:
    shown, unshown = f"{counts[SHOWN]} shown", f"{counts[NOT_SHOWN]} not shown"
    if counts[BROKEN]:
        return "fail", f"{counts[BROKEN]} broken", f"{shown}, {unshown}"
    if counts[NOT_JUDGED]:
        return "none", f"{counts[NOT_JUDGED]} not judged", f"{shown}, {unshown}, none broken"
    if counts[NOT_SHOWN]:
        return "none", unshown, f"{shown}, none broken"
    return "pass", "all shown", f"{counts[SHOWN]} claims"


def _over(charts: Sequence[tuple[str, list[Chart]]], candidates: Sequence[str]) -> list[object]:
    """The margin over the parameters, of each case."""
    if not charts:
        return []
    dots = [
        joined((element("span", "●", style=f"color:{colour(i)}"), name)) for i, name in enumerate(candidates)
    ]
    drawn = [part for case, found in charts for part in (element("h3", case), Beside(found))]
    return [element("p", joined(dots)), ABOUT_CHARTS.format(candidates[0]), *drawn]


def _cell(cell: Cell) -> Html:
    """Verdict, a strip with all runs, and the limits that are nearest."""
    strip = Chart(WIDTH, HEIGHT, cell.text)
    strip.line(0.5, 0.0, 0.5, 1.0, "3 3")
    for at, text, anchor in ((0.01, "-1", "start"), (0.51, "0", "start"), (0.99, "1", "end")):
        strip.text(at, 0.0, text, anchor=anchor, down=-2.0)
    for number, run in enumerate(cell.drawn.runs):
        is_known = run.verdict == "fail" and cell.case.known(run.point)
        look = "known" if is_known else run.verdict.replace(" ", "-")
        up = 0.22 + 0.56 * (number * 7 % 19) / 18.0  # rows keep dots apart
        title = f"{point_text(run.point, run.seed)}: {cell.why_failed(run) or 'passes'}"
        strip.dot(0.5 + 0.47 * max(-1.0, run.margin), up, look, title)
    below = [element("small", text) for text in (cell.text, *cell.means)]
    limits = [element("small", _limit(*nearest)) for nearest in cell.nearest[:6]]
    return joined((verdict(cell.verdict), strip, *below, *limits))


def _limit(name: str, share: float, entry: dict[str, Any]) -> Html:
    """The nearest run to one limit: its margin, value and the limit."""
    value = entry["value"]
    said = "no value" if value is None else num(value)
    error = entry.get("level_error")
    off = f", level off by up to {num(error['size'])}" if error else ""
    margin = element("span", signed(share), class_="fail" if share < 0.0 else "")
    return joined((name, margin, f"{said} ({limit_text(entry)}{off})"))


def _steering(cell: Cell) -> list[list[str]]:
    """Rows of the table of steering accuracy."""
    rows = []
    for point, (count, classes) in sorted(cell.steering.items()):
        if found := accuracy(classes):
            rms, upto = found
            more = f"{CLASS_COUNT - 1} cm or more" if upto == CLASS_COUNT else f"{upto} cm"
            rows.append(
                [cell.case.name, point or "as it is", cell.candidate, str(count), num(rms, "m"), more]
            )
    return rows


def _outside(cell: Cell) -> list[list[str]]:
    """Rows of the table of runs that are not judged."""
    return [
        [cell.case.name, cell.candidate, str(region.count), why.removeprefix(f"{UNJUDGED}: "), region.text]
        for why, region in cell.outside.items()
    ]


def _known(cell: Cell) -> list[str]:
    """A row of the table of known failures."""
    passed = str(cell.surprises.count)
    whys = "; ".join(dict.fromkeys(known.why for known in cell.case.file.known))
    return [cell.case.name, cell.candidate, str(cell.known), passed, whys]


def _failure(cell: Cell, run: Kept) -> list[object]:
    reason = cell.why_failed(run) or "passes"
    point = point_text(run.point, run.seed)
    return [cell.case.name, cell.candidate, point, element("code", run.id[:8]), reason]


def _groups(cells: Sequence[Cell]) -> list[list[str]]:
    """Failures put together by case, candidate and the first limit that failed, most frequent first."""
    found = [
        [cell.case.name, cell.candidate, what, str(region.count), region.text]
        for cell in cells
        for what, region in cell.groups.items()
    ]
    return sorted(found, key=lambda group: -int(group[3]))


def colour(number: int) -> str:
    """Colour of a candidate, the same in every chart."""
    return COLOURS[number % len(COLOURS)]


def over_parameters(cells: Sequence[Cell]) -> list[Chart]:
    """Charts of one case, one for each parameter with several numbers. cells: its candidates, in order."""
    case, charts = cells[0].case, []
    for name in case.file.vary:
        drawn = [
            (number, float(run.point[name]), run)
            for number, cell in enumerate(cells)
            for run in cell.drawn.runs
            if run.verdict not in UNCOUNTED
            and not case.known(run.point)
            and isinstance(run.point.get(name), int | float)
        ]
        values = [value for _, value, _ in drawn]
        if len(set(values)) < 2:
            continue
        low, high = min(values), max(values)
        found = boundary([(value, run.margin >= 0.0) for number, value, run in drawn if number == 0])
        said = "" if found is None else f": passes {found[1]} {num(found[0])}"
        chart = Chart(WIDE, HIGH, f"margin over {name}", caption=f"**{name}** {span([low, high])}{said}")
        chart.line(0.0, 0.5, 1.0, 0.5, "3 3")
        for at, text, down in ((1.0, "1", 12.0), (0.5, "0", -2.0), (0.0, "-1", -2.0)):
            chart.text(0.0, at, text, right=1.0, down=down)

        def across(value: float, low: float = low, high: float = high) -> float:
            return PAD + (1.0 - 2.0 * PAD) * (value - low) / (high - low)

        if found is not None:
            chart.line(across(found[0]), 0.0, across(found[0]), 1.0, "1 3")
        for number, value, run in drawn:
            title = f"{name} {num(value)}, seed {run.seed}: {run.reason or 'passes'}"
            up = 0.5 + 0.43 * min(1.0, max(-1.0, run.margin))
            chart.dot(across(value), up, title=title, fill=colour(number))
        charts.append(chart)
    return charts


def boundary(runs: Sequence[tuple[float, bool]]) -> tuple[float, str] | None:
    """The value that separates passing from failing runs best, and the side on which they pass.

    None where no value is right for nine of ten runs. runs: (value, passes)
    """
    values = sorted({value for value, _ in runs})
    if len({passes for _, passes in runs}) < 2:
        return None
    best: tuple[float, float, str] | None = None
    for a, b in pairwise(values):
        middle = 0.5 * (a + b)
        below = sum((value < middle) != passes for value, passes in runs) / len(runs)
        for wrong, side in ((below, "below"), (1.0 - below, "above")):
            if best is None or wrong < best[0]:
                best = wrong, middle, side
    passed = sum(passes for _, passes in runs)
    allowed = min(MISTAKES, 0.5 * min(passed, len(runs) - passed) / len(runs))
    return None if best is None or best[0] > allowed else (best[1], best[2])


def stanford(cells: Sequence[Cell], number: int) -> Chart | None:
    """The diagram of one candidate over all its cases; None where no run has an edge detector."""
    whole = pooled(cell.integrity for cell in cells)
    if not whole["samples"]:
        return None
    name = cells[0].candidate
    rate = episodes_per_km(whole["episodes"], whole["km"])
    caption = (
        f"**{name}**: {whole['episodes']} hazardous episodes in {num(whole['km'])} km: "
        f"{num(rate)} per km or fewer (95 %); the longest {num(whole['longest_m'])} m"
    )
    chart = Chart(SIDE, SIDE, f"Stanford diagram of {name}", caption=caption)
    alert, cell = WRONG_M / (BIN_M * BIN_COUNT), 1.0 / BIN_COUNT
    chart.area("hazard", (alert, 0.0), (alert, alert), (1.0, 1.0), (1.0, 0.0))
    most = log1p(max(count for _, _, count in whole["bins"]))
    for error, reported, count in whole["bins"]:
        chart.box(error * cell, reported * cell, cell, cell, fill=colour(number), opacity=log1p(count) / most)
    chart.line(0.0, 0.0, 1.0, 1.0)
    chart.line(alert, 0.0, alert, 1.0, "3 3")
    chart.line(0.0, alert, 1.0, alert, "3 3")
    chart.text(alert, 0.0, f"{num(WRONG_M)} m", right=3.0, down=-13.0)
    chart.text(1.0, 0.0, f"error {num(BIN_M * BIN_COUNT)} m", anchor="end", right=-3.0, down=-3.0)
    chart.text(1.0, alert, f"{num(WRONG_M)} m", anchor="end", right=-3.0, down=-3.0)
    chart.text(alert, 1.0, f"stated {num(BIN_M * BIN_COUNT)} m", right=3.0, down=14.0)
    return chart
