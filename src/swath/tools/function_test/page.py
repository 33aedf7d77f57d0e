"""report.html of a function test: a matrix of cases and candidates, every run a dot against its limit."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from swath import __version__
from swath.report.html import write_page
from swath.tools.function_test.cells import Cell
from swath.tools.function_test.charts import HEIGHT as HIGH
from swath.tools.function_test.charts import WIDTH as WIDE
from swath.tools.function_test.charts import colour, over_parameters, stanford
from swath.tools.function_test.judged import UNJUDGED
from swath.tools.function_test.kept_runs import Kept
from swath.tools.function_test.ranking import HEAD, by_tag, ranking
from swath.tools.function_test.steering_accuracy import CLASS_COUNT, accuracy
from swath.tools.function_test.verdict import BROKEN, NOT_JUDGED, NOT_SHOWN, SHOWN, VERDICTS

MARKS = {SHOWN: "✓", BROKEN: "✗", NOT_SHOWN: "?", NOT_JUDGED: "–"}
WIDTH, HEIGHT, PAD = 260.0, 34.0, 8.0  # of a strip [px]
FAILED_MAX, FAILED_LEAST = 200, 3  # runs in the list of failures; of one case and candidate at least


def write_matrix(path: Path, cells: Sequence[Cell], *, shadow: bool = False) -> Path:
    """Write the page. shadow: all candidates but the first were in open loop"""
    candidates = list(dict.fromkeys(cell.candidate for cell in cells))
    cases = list(dict.fromkeys(cell.case.name for cell in cells))
    by_place = {(cell.case.name, cell.candidate): cell for cell in cells}
    rows = [
        {
            "case": by_place[case, candidates[0]].case,
            "name": case,
            "cells": [_cell(by_place[case, c]) for c in candidates],
        }
        for case in cases
    ]
    failing = [cell for cell in cells if cell.failed.count]
    each = max(FAILED_LEAST, FAILED_MAX // max(1, len(failing)))
    return write_page(
        path,
        "function_test.html.j2",
        title="Function tests",
        version=__version__,
        candidates=candidates,
        ranks={"head": HEAD, "rows": ranking(cells)} if len(candidates) > 1 else None,
        tags=by_tag(cells),
        rows=rows,
        shadow=shadow,
        counts={v: sum(c.verdict == v for c in cells) for v in VERDICTS},
        run_count=sum(c.count for c in cells),
        groups=_groups(cells),
        charts=[
            {"name": case, "charts": found}
            for case in cases
            if (found := over_parameters([by_place[case, c] for c in candidates]))
        ],
        chart={"width": WIDE, "height": HIGH, "middle": HIGH / 2.0},
        colours=[{"name": c, "colour": colour(i)} for i, c in enumerate(candidates)],
        known=[_known(cell) for cell in cells if cell.known],
        diagrams=[
            diagram
            for number, c in enumerate(candidates)
            if (diagram := stanford([by_place[case, c] for case in cases], number))
        ],
        steering=[row for cell in cells for row in _steering(cell)],
        outside=[row for cell in cells for row in _outside(cell)],
        failed=[_failure(cell, run) for cell in failing for run in cell.failed.runs[:each]],
        failed_count=sum(cell.failed.count for cell in failing),
        surprises=[_failure(cell, run) for cell in cells for run in cell.surprises.runs],
        surprise_count=sum(cell.surprises.count for cell in cells),
        strip={"width": WIDTH, "height": HEIGHT, "middle": WIDTH / 2.0},
    )


def _cell(cell: Cell) -> dict[str, Any]:
    worst = cell.worst
    return {
        "verdict": cell.verdict.replace(" ", "-"),
        "mark": MARKS[cell.verdict],
        "text": cell.text,
        "means": cell.means,
        "limits": [_limit(*nearest) for nearest in cell.nearest],
        "dots": [_dot(cell, run, number) for number, run in enumerate(cell.drawn.runs)],
        "worst": None if worst is None else _failure(cell, worst),
    }


def _limit(name: str, share: float, entry: dict[str, Any]) -> dict[str, Any]:
    """The nearest run to one limit: its margin, value and the limit."""
    value = entry["value"]
    bounds = [f"{key} {entry['limit'][key]:g}" for key in ("min", "max") if key in entry["limit"]]
    said = "no value" if value is None else f"{value:.3g}"
    error = entry.get("level_error")
    off = f", level off by up to {error['size']:g}" if error else ""
    return {"name": name, "margin": f"{share:+.2f}", "is_broken": share < 0.0,
            "text": f"{said} ({', '.join(bounds)}{off})"}  # fmt: skip


def _steering(cell: Cell) -> list[list[str]]:
    """Rows of the table of steering accuracy."""
    rows = []
    for point, (count, classes) in sorted(cell.steering.items()):
        if found := accuracy(classes):
            rms, upto = found
            more = f"{CLASS_COUNT - 1} cm or more" if upto == CLASS_COUNT else f"{upto} cm"
            rows.append(
                [cell.case.name, point or "as it is", cell.candidate, str(count), f"{100 * rms:.1f} cm", more]
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


def _dot(cell: Cell, run: Kept, number: int) -> dict[str, Any]:
    """Place of a run in its strip: left beyond the limit, right within it; rows keep dots apart."""
    share = max(-1.0, run.margin)
    return {
        "x": round(WIDTH / 2.0 + share * (WIDTH / 2.0 - PAD), 1),
        "y": round(PAD + (number * 7 % 19) / 18.0 * (HEIGHT - 2.0 * PAD), 1),
        "kind": "known"
        if run.verdict == "fail" and cell.case.known(run.point)
        else run.verdict.replace(" ", "-"),
        "title": f"{_point(run)}: {cell.why_failed(run) or 'passes'}",
    }


def _failure(cell: Cell, run: Kept) -> dict[str, str]:
    return {"case": cell.case.name, "candidate": cell.candidate, "point": _point(run), "id": run.id,
            "reason": cell.why_failed(run) or "passes"}  # fmt: skip


def _point(run: Kept) -> str:
    values = ", ".join(f"{name} {value}" for name, value in run.point.items())
    return f"{values}, seed {run.seed}" if values else f"seed {run.seed}"


def _groups(cells: Sequence[Cell]) -> list[dict[str, Any]]:
    """Failures put together by case, candidate and the first limit that failed, most frequent first."""
    found = [
        {"case": cell.case.name, "candidate": cell.candidate, "what": what, "count": region.count,
         "where": region.text}
        for cell in cells for what, region in cell.groups.items()
    ]  # fmt: skip
    return sorted(found, key=lambda group: -int(group["count"]))
