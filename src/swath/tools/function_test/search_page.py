"""report.html of a search: where runs pass and fail over each two parameters, and what matters."""

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

from swath import __version__
from swath.report.html import write_page
from swath.tools.function_test.boundary import Boundary
from swath.tools.function_test.journal import Result
from swath.tools.function_test.search import Searched

SIDE, BINS = 220.0, 22  # of a map [px], squares along it
FAILED_MAX = 60  # runs in the list


def write_search(path: Path, found: Searched, checked: tuple[int, int] | None = None) -> Path:
    """Write the page. checked: runs of another test that the boundary foretells right, of how many"""
    boundary = found.boundary
    failed = [result for result in found.judged if result["verdict"] != "pass"]
    return write_page(
        path,
        "function_test_search.html.j2",
        title=f"Boundary of {found.case.name}",
        objective=found.case.file.objective,
        limit=found.search.limit or "all limits together",
        version=__version__,
        count=len(found.results),
        passed=found.passed()[0],
        facts={
            "the runs": "; ".join(found.shows),
            "left out, predicted correctly": f"{100 * boundary.right_of_left_out:.0f} % of the runs",
            "other runs, predicted correctly": None if checked is None else f"{checked[0]} of {checked[1]}",
        },
        maps=[_map(found, boundary, x, y) for x, y in combinations(range(len(found.ranges)), 2)]
        or [_line(found, boundary)],
        side=SIDE,
        sensitivities=[
            {"name": name, "key": found.case.file.vary[name].key, "range": "{:g} to {:g}".format(*ends),
             "first": first, "total": total}
            for (name, first, total), ends in zip(
                boundary.sensitivities(), found.ranges.values(), strict=True)
        ],
        failed=[_row(result, margin) for result, margin in _nearest_first(found, failed)][:FAILED_MAX],
        failed_count=len(failed),
    )  # fmt: skip


def _map(found: Searched, boundary: Boundary, x: int, y: int) -> dict[str, Any]:
    """Over two parameters: the share of the others' ranges in which runs pass, and the runs."""
    shares = boundary.map_of(x, y, BINS)
    size = SIDE / BINS
    return {
        "x": _axis(found, x), "y": _axis(found, y), "size": size + 0.3,
        "squares": [
            {"x": round(column * size, 1), "y": round(SIDE - (row + 1) * size, 1), "colour": _colour(share)}
            for row, line in enumerate(shares) for column, share in enumerate(line)
        ],
        "dots": _dots(found, boundary, boundary.points[:, x], boundary.points[:, y]),
    }  # fmt: skip


def _line(found: Searched, boundary: Boundary) -> dict[str, Any]:
    """Of one parameter: the margin over it, from -1 to 1 upwards."""
    return {
        "x": _axis(found, 0), "y": {"name": "margin", "low": "-1", "high": "1"}, "size": 0.0, "squares": [],
        "dots": _dots(found, boundary, boundary.points[:, 0], 0.5 + 0.5 * boundary.margins),
    }  # fmt: skip


def _dots(found: Searched, boundary: Boundary, x: Any, y: Any) -> list[dict[str, Any]]:
    return [
        {"x": round(float(a) * SIDE, 1), "y": round(SIDE - float(b) * SIDE, 1), "passes": margin >= 0.0,
         "title": f"{_point(result)}: margin {margin:+.2f}"}
        for a, b, margin, result in zip(x, y, boundary.margins, found.judged, strict=True)
    ]  # fmt: skip


def _axis(found: Searched, number: int) -> dict[str, str]:
    name, (low, high) = list(found.ranges.items())[number]
    return {"name": name, "low": f"{low:g}", "high": f"{high:g}"}


def _colour(share: float) -> str:
    """From orange (no run passes) over white to blue (all pass), light enough for the runs on it."""
    ends = ((234, 174, 128), (255, 255, 255), (127, 184, 216))
    a, b = ends[:2] if share < 0.5 else ends[1:]
    part = 2.0 * share if share < 0.5 else 2.0 * share - 1.0
    return "#" + "".join(f"{round(p + part * (q - p)):02x}" for p, q in zip(a, b, strict=True))


def _nearest_first(found: Searched, failed: Sequence[Result]) -> list[tuple[Result, float]]:
    margins = found.margins(failed)
    return sorted(zip(failed, map(float, margins), strict=True), key=lambda pair: (-pair[1], pair[0]["id"]))


def _row(result: Result, margin: float) -> dict[str, str]:
    return {"point": _point(result), "id": result["id"][:8], "margin": f"{margin:+.2f}",
            "reason": result["reason"]}  # fmt: skip


def _point(result: Result) -> str:
    values = ", ".join(f"{name} {value}" for name, value in result["point"].items())
    return f"{values}, seed {result['seed']}"
