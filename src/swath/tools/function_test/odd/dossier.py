"""The dossier of a campaign: a page for an assessor, tables, JUnit, and the ODD in which the function is
shown.

Every statement on the page is one of the cells in `cells.csv` or of the runs in `runs.csv`; each run can be
made again from its name.
"""

import csv
import io
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from swath import __version__
from swath.core.errors import InputError
from swath.core.shell import command
from swath.core.whole_file import write_whole
from swath.documents.text_file import read_text
from swath.report.html import write_page
from swath.runtime.credibility import span
from swath.runtime.met import QUANTITIES
from swath.tools.function_test.cells import cells_of, errors_of
from swath.tools.function_test.fidelity import levels_of
from swath.tools.function_test.in_step import is_number
from swath.tools.function_test.judged import ERROR, beyond
from swath.tools.function_test.junit import write_junit
from swath.tools.function_test.odd.campaign import ODD_FILE, Conducted
from swath.tools.function_test.odd.causes import (
    AS_THE_REST,
    WHYS,
    Cause,
    Explained,
    cause_of,
    drawn_for,
    excluded,
    explained,
    without,
)
from swath.tools.function_test.odd.cells import NEVER, VERDICTS, OddCell, judged, needed_each
from swath.tools.function_test.odd.check import not_drawn
from swath.tools.function_test.odd.coverage import HIT_M, INSIDE, Coverage, Driven
from swath.tools.function_test.odd.restricted import write_restricted
from swath.tools.function_test.odd.trace import (
    NOT_MEASURED,
    Traced,
    again,
    broken_by,
    said_of,
    trace_rows,
    traced,
)
from swath.tools.function_test.one_run import scenario_of
from swath.tools.function_test.page import write_matrix
from swath.tools.function_test.plan import code_hash, commit, looked_at
from swath.tools.function_test.verdict import BROKEN, NOT_SHOWN, SHOWN

COLOURS = {SHOWN: "#2f9e77", BROKEN: "#d55e00", NOT_SHOWN: "#e3cf86", NEVER: "#c9ced4"}
CLEAN = "#bfe0c9"  # of a pair that is not shown and in which no run fails
OUTSIDE = "#ffffff"  # of a pair that the ODD does not have
NOWHERE = "nowhere"
ELSEWHERE = 0.2  # share of runs that drove elsewhere than drawn, from which on it is told; estimated
STEP = 8  # of the matrix of buckets [px]
LISTED = 60  # rows of a list on the page; all are in the tables
NO_CERTIFICATE = (
    "This dossier certifies nothing. It says what a simulation showed of a function, in which part of a "
    "declared domain, and how sure that is. It may serve as evidence by simulation beside tests and analysis "
    "(ISO 18497-4:2024); it replaces no assessment of conformity under Regulation (EU) 2023/1230."
)


@dataclass(frozen=True)
class Summary:
    """What the screen and the top of the page say."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    lines: Sequence[str]


def summary_of(found: Conducted, cells: Sequence[OddCell]) -> Summary:
    """Cells by verdict, and sentences."""
    rows = []
    for name, some in (
        ("buckets", [c for c in cells if len(c.places) == 1]),
        ("pairs of buckets", [c for c in cells if len(c.places) == 2]),
    ):
        rows.append((name, *(str(sum(c.verdict == v for c in some)) for v in VERDICTS)))
    driven, pairs = found.coverage.pair_share
    tried = [run for run in found.coverage.runs if run.is_judged]
    passed = sum(run.passes for run in tried)
    lines = [
        f"{passed} of {len(tried)} runs pass; {driven} of {pairs} pairs of buckets driven {HIT_M:g} m or "
        f"counted ({100 * driven / max(1, pairs):.1f} %)"
    ]
    causes = found.causes()
    for cause, _, here, is_elsewhere in _runs_of(found, causes):
        warning = f"; only {here} drove mainly there" if is_elsewhere else ""
        lines.append(
            f"cause: {cause.text}: {cause.failed} of {cause.counted} runs drawn there fail, elsewhere "
            f"{cause.rest_failed} of {cause.rest_counted}{warning}"
        )
    lines += _told(explained(found.coverage, cells, causes, found.claim))
    lines += _elsewhere(found)
    errors = [run.result["reason"] for run in found.coverage.runs if run.result["verdict"] == ERROR]
    if unjudged := len(found.coverage.runs) - len(tried) - len(errors):
        lines.append(f"{unjudged} runs not judged: a level was outside the range in which it was checked")
    if errors:
        lines.append(errors_of(len(errors), len(found.coverage.runs), errors[0]))
    short = _short(found, cells)
    if short:
        lines.append(short)
    return Summary(VERDICTS, rows, lines)


def _runs_of(found: Conducted, causes: Sequence[Cause]) -> Iterable[tuple[Cause, list[Driven], int, bool]]:
    """Of each cause the runs drawn for it and no stronger one, how many of these drove mainly there, and
    whether those are too few to take the cause for what was driven.
    """
    coverage = found.coverage
    for number, cause in enumerate(causes, 1):
        runs = [r for r in coverage.runs if r.counts and cause_of(coverage, r, causes[:number]) is cause]
        here = sum(cause.has(set(coverage.main(run).tolist())) for run in runs)
        yield cause, runs, here, here < (1.0 - ELSEWHERE) * len(runs)


def _told(of: Mapping[str, Explained]) -> Iterable[str]:
    """How many broken cells there are of each kind."""
    for why in WHYS:
        if count := sum(e.why == why for e in of.values()):
            yield f"{count} cells broken {why}" if why == AS_THE_REST else f"{count} broken cells: {why}"


def write_dossier(found: Conducted, cells: list[OddCell]) -> Path:
    """Write dossier.html, report.html, cells.csv, runs.csv, junit.xml, results.parquet and the restricted
    ODD.
    """
    folder, claim = found.folder, found.claim
    causes = found.causes()
    outside = without(found.coverage, causes)
    rest = judged(outside, claim, is_complete=found.is_complete) if causes else cells
    why = explained(found.coverage, cells, causes, claim)
    out = excluded(cells, causes, rest)
    restricted = write_restricted(folder, found.odd, out)
    _csv(folder / "cells.csv", _cell_rows(found, cells, why))
    _csv(folder / "runs.csv", _run_rows(found))
    _csv(folder / "requirements.csv", trace_rows(found.odd.file, found.results, folder.name))
    found.session.table()
    plan = found.session.plan
    tested = cells_of(plan.found, plan.candidates, plan.counts, found.results)
    _junit(write_junit(folder / "junit.xml", tested), found, cells, why)
    write_matrix(folder / "report.html", tested)
    runs = found.coverage.runs
    tried = [run for run in runs if run.is_judged]
    passed = sum(run.passes for run in tried)
    share, sure = f"{100 * claim.pass_rate:g} %", f"{100 * claim.confidence:g} %"
    shown_now, shown_left = _shown(found, cells), _shown(found, rest)
    driven, pairs = found.coverage.pair_share
    failing = [run for run in tried if not run.passes]
    left = [run for run in runs if run.outside is not None]
    return write_page(
        folder / "dossier.html",
        "odd_dossier.html.j2",
        title=f"Dossier: {found.odd.name}",
        objective=found.odd.file.objective,
        certificate=NO_CERTIFICATE,
        counts={v: sum(c.verdict == v for c in cells) for v in VERDICTS},
        facts={
            "runs": f"{len(runs)} of {found.campaign.budgets[-1]}",
            "runs that pass": str(passed),
            "claim for each cell": f"{share} of its runs pass, {sure} confidence",
            f"pairs of buckets driven {HIT_M:g} m or counted": f"{driven} of {pairs}",
            "fewest runs counted for a pair": str(_fewest(cells)),
            "requirement": found.odd.file.requirement or None,
            "ODD version": found.odd.domain.version or None,
            "LiDAR level": _lidar_levels(found),
            "swath": __version__,
        },
        overall=_overall(tried),
        claim={"share": share, "sure": sure, "wrong": f"{100 * (1.0 - claim.confidence):g} %"},
        test="the exact binomial test" if found.is_complete else "an e-process (see above)",
        hit_m=f"{HIT_M:g}",
        inside=f"{100 * INSIDE:g} %",
        short=_short(found, cells),
        shown=[(*a, b) for a, (_, b) in zip(shown_now, shown_left, strict=True)],
        nothing_left=[name for name, where in shown_left if where == NOWHERE],
        broken=_causes(found, causes),
        left_over=_left_over(outside, causes),
        why=list(_told(why)),
        never=[c.text for c in cells if c.verdict == NEVER][:LISTED],
        never_count=sum(c.verdict == NEVER for c in cells),
        not_simulated=[(n, b.not_simulated) for n, b in found.odd.file.attributes.items() if b.not_simulated],
        unbound=[n for n in found.odd.domain.attributes if n not in found.odd.file.attributes],
        layers=_layers(found, cells),
        attributes=_attributes(found, cells),
        matrix=_matrix(found, cells),
        left=[_left(run) for run in left[:LISTED]],
        left_count=len(left),
        failed=[_run(folder.name, run) for run in failing[:LISTED]],
        failed_count=len(failing),
        rules=found.odd.domain.rules(),
        restricted={"name": restricted.name, "cells": [c.text for c in out[:LISTED]], "count": len(out)},
        not_drawn=[(finding.name, finding.text) for finding in not_drawn(found.odd)],
        nowhere=_in_no_bucket(found),
        other_code=found.campaign.code != code_hash(),
        believe=_believe(found),
        by_limit=_by_limit(found),
        unjudged=_unjudged(found),
        levels=_levels(found),
        requirements=[_requirement(folder.name, told) for told in traced(found.odd.file, found.results)],
        again=again_all(found),
        digests=_digests(found),
        colours=[(v, COLOURS[v]) for v in VERDICTS],
        clean=CLEAN,
        folder=folder.name,
    )


def _short(found: Conducted, cells: Sequence[OddCell]) -> str:
    """How many runs would show all pairs, where these did not."""
    pairs = [c for c in cells if len(c.places) == 2]
    need = needed_each(len(pairs), found.claim)
    if all(c.verdict in (SHOWN, BROKEN) for c in pairs):
        return ""
    return (
        f"{needed_each(1, found.claim)} runs without a failure show a single cell; for all {len(pairs)} "
        f"pairs together each needs {need}, the one with the fewest counted runs has {_fewest(cells)}"
    )


def _fewest(cells: Sequence[OddCell]) -> int:
    """Runs that count for the pair for which fewest do."""
    return min((c.counted for c in cells if len(c.places) == 2), default=0)


def _shown(found: Conducted, cells: Sequence[OddCell]) -> list[tuple[str, str]]:
    """Of each attribute the buckets in which the function is shown, in words."""
    said = []
    for axis in found.odd.axes:
        own = {c.places[0] - axis.first for c in cells if len(c.places) == 1 and c.verdict == SHOWN}
        places = [p for p in sorted(own) if 0 <= p < axis.count]
        if axis.edges:
            runs = [list(g) for _, g in groupby(enumerate(places), lambda pair: pair[1] - pair[0])]
            parts = [f"{axis.edges[r[0][1]]:g} to {axis.edges[r[-1][1] + 1]:g}" for r in runs]
        else:
            parts = [axis.labels[p] for p in places]
        said.append((axis.name, f"{', '.join(parts)}{axis.unit}" if parts else NOWHERE))
    return said


def _overall(tried: Sequence[Driven]) -> str:
    """Runs that pass, early and late: the design draws what is rare later."""
    half = len(tried) // 2
    early, late = sum(run.passes for run in tried[:half]), sum(run.passes for run in tried[half:])
    return (
        f"{early + late} of {len(tried)} runs pass, {early} of the first {half} and {late} of the other "
        f"{len(tried) - half}. This share depends on the design, which spreads runs over all pairs of "
        "buckets and then fills rare ones: it is not the share at work"
    )


def _left_over(outside: Coverage, causes: Sequence[Cause]) -> str:
    runs = [run for run in outside.runs if run.counts]
    failed = sum(not run.passes for run in runs)
    return f"Of the runs in none of these, {failed} of {len(runs)} fail" if causes else ""


def _causes(found: Conducted, causes: Sequence[Cause]) -> list[dict[str, Any]]:
    """Rows of causes."""
    rows = []
    for cause, runs, here, is_elsewhere in _runs_of(found, causes):
        failing = sorted((run.result for run in runs if not run.passes), key=lambda result: str(result["id"]))
        rows.append(
            {
                "text": cause.text,
                "inside": f"{cause.failed} of {cause.counted}",
                "outside": f"{cause.rest_failed} of {cause.rest_counted}",
                "here": here,
                "elsewhere": is_elsewhere,
                "p": f"{cause.p:.1e}",
                "reason": str(failing[0]["reason"]),
                "ids": [str(result["id"])[:8] for result in failing[:3]],
            }
        )
    return rows


def _in_no_bucket(found: Conducted) -> list[list[str]]:
    """Of each attribute the way [m] that lies in none of its buckets, and in how many runs."""
    rows = []
    for number, axis in enumerate(found.odd.axes):
        ways = [float(run.metres[run.steps[:, number] < 0].sum()) for run in found.coverage.runs]
        if any(ways):
            rows.append([axis.name, f"{sum(ways):.0f}", str(sum(way > 0.0 for way in ways))])
    return rows


def _by_limit(found: Conducted) -> list[list[str]]:
    """Of each limit how many runs break it, how many of these no other one, and in how many it was not
    measured.
    """
    broken, unmeasured, nothing = Counter[str](), Counter[str](), 0
    alone = Counter[str]()
    for run in found.coverage.runs:
        if not run.is_judged:
            continue
        said = [(f"{e['subject']}.{e['name']}", said_of(e)) for e in run.result["expect"]]
        own = list(dict.fromkeys(name for name, what in said if what == "fail"))
        broken.update(own)
        alone.update(own if len(own) == 1 else [])
        unmeasured.update(list(dict.fromkeys(name for name, what in said if what == NOT_MEASURED)))
        nothing += any(what == NOT_MEASURED for _, what in said)
    rows = [
        [n, str(broken[n]), str(alone[n]), str(unmeasured[n])] for n, _ in (broken + unmeasured).most_common()
    ]
    errors = sum(run.result["verdict"] == ERROR for run in found.coverage.runs)
    rows += [["ended before a limit was measured", "", "", str(nothing)]] if nothing else []
    return [*rows, *([["run came to nothing", str(errors), "", ""]] if errors else [])]


def _elsewhere(found: Conducted) -> Iterable[str]:
    """Of each attribute that is counted as measured, in how many runs that was mostly not what was drawn."""
    runs = found.coverage.runs
    for number, axis in enumerate(found.odd.axes):
        if not axis.bound.met or not runs:
            continue
        other = sum(int(run.main[number]) != axis.bucket_of(run.result["point"][axis.name]) for run in runs)
        if other > ELSEWHERE * len(runs):
            yield (
                f"{axis.name}: {other} of {len(runs)} runs drove mainly in another bucket than they were "
                "drawn for, and count where they drove. What the function did (it slowed down, it stood) may "
                "have brought them there: such a bucket can look broken as a consequence, not as a cause."
            )


def _layers(found: Conducted, cells: Sequence[OddCell]) -> dict[str, Any]:
    """Counts of the cells of each pair of layers by verdict; a layer with itself has its buckets, too."""
    names = found.odd.layers
    rows = []
    for i, a in enumerate(names):
        row = []
        for b in names[: i + 1]:
            some = [c for c in cells if {*c.layers} == {a, b}]
            total = len(some)
            row.append(
                {
                    "parts": [
                        {"colour": COLOURS[v], "share": round(100 * n / total, 2), "count": n, "verdict": v}
                        for v in VERDICTS
                        if (n := sum(c.verdict == v for c in some))
                    ]
                    if total
                    else [],
                    "total": total,
                }
            )
        rows.append({"name": a, "cells": row})
    return {"names": names, "rows": rows}


def _attributes(found: Conducted, cells: Sequence[OddCell]) -> list[dict[str, Any]]:
    """Of each attribute its buckets: verdict, runs, way and time; those outside the ODD too."""
    by_place = {c.places[0]: c for c in cells if len(c.places) == 1}
    drawn = [drawn_for(found.odd, run) for run in found.coverage.runs]
    out = []
    for axis in found.odd.axes:
        buckets = []
        for bucket in range(axis.count):
            cell = by_place.get(axis.first + bucket)
            said = "outside the ODD" if cell is None else cell.verdict
            counts = (
                None
                if cell is None
                else (
                    f"{cell.counted - cell.failed} of {cell.counted}",
                    f"{cell.metres:.0f} m",
                    f"{cell.seconds:.0f} s",
                )
            )
            stated = bool(axis.bound.exposure)
            share = f"exposure {100 * axis.exposure[bucket]:.0f} %" if stated else "no exposure stated"
            place = axis.first + bucket
            buckets.append(
                {
                    "label": axis.labels[bucket],
                    "verdict": said,
                    "counts": counts,
                    "share": share,
                    "drawn": sum(place in some for some in drawn),
                    "colour": OUTSIDE if cell is None else COLOURS[cell.verdict],
                }
            )
        met = axis.bound.met
        measured = f"counted as measured: {QUANTITIES[met].meaning}" if met else "counted as set"
        key = ", ".join(axis.bound.keys)
        out.append(
            {"name": axis.name, "unit": axis.bound.unit, "buckets": buckets, "measured": measured, "key": key}
        )
    return out


def _matrix(found: Conducted, cells: Sequence[OddCell]) -> dict[str, Any]:
    """Every pair of buckets as a square, below the diagonal."""
    odd = found.odd
    squares, lines, layer = [], [], ""
    for cell in cells:
        i, j = cell.places[0], cell.places[-1]
        counts = f"{cell.counted - cell.failed} of {cell.counted} pass, {cell.metres:.0f} m"
        text = f"{cell.text}: {cell.verdict}, {counts}"
        colour = CLEAN if cell.verdict == NOT_SHOWN and not cell.failed else COLOURS[cell.verdict]
        squares.append({"x": i * STEP, "y": j * STEP, "colour": colour, "title": text})
    for axis in odd.axes:
        is_new, layer = axis.layer != layer, axis.layer
        lines.append(
            {
                "at": axis.first * STEP,
                "layer": axis.layer if is_new else "",
                "name": axis.name.partition(".")[2],
                "middle": (axis.first + axis.count / 2) * STEP,
            }
        )
    return {"side": odd.bucket_count * STEP, "step": STEP, "squares": squares, "lines": lines}


def _left(run: Driven) -> dict[str, str]:
    assert run.outside is not None
    o = run.outside
    return {
        "id": str(run.result["id"])[:8],
        "t": f"{o.t_s:.1f}",
        "at": f"{o.distance_m:.1f}",
        "length": f"{o.length_m:.0f}",
        "why": o.why,
        "verdict": str(run.result["verdict"]),
        "counts": "yes" if run.counts else "no",
    }


def _run(folder: str, run: Driven) -> dict[str, str]:
    point = ", ".join(f"{name.partition('.')[2]} {value}" for name, value in run.result["point"].items())
    return {"again": again(folder, run.result), "reason": str(run.result["reason"]), "point": point}


def _requirement(folder: str, told: Traced) -> list[str]:
    worst = "" if told.worst is None else f"{again(folder, told.worst)}: {told.why}"
    counts = (told.kept, told.broken, told.unmeasured, told.unjudged)
    return [told.name, "; ".join(told.limits), *map(str, counts), worst]


def again_all(found: Conducted) -> str:
    """The command that makes the whole campaign once more, in a new folder."""
    asked = found.campaign
    sets = [word for text in asked.sets for word in ("--set", text)]
    level = ("--level", asked.level) if asked.level else ()
    file = f"{found.folder.name}/{ODD_FILE}"
    return command("test", "run", "--odd", file, "--runs", asked.budgets[-1], *sets, *level, "--out", "DIR")


def _lidar_levels(found: Conducted) -> str:
    """What the scanners of the runs were driven at, and in how many where they differ."""
    kinds: Counter[tuple[str, ...]] = Counter()
    for run in found.session.runs():
        kinds[run.scenario, *(text for text in run.sets if not is_number(text))] += 1
    levels: Counter[str] = Counter()
    for (scenario, *sets), count in kinds.items():
        try:
            driven = sorted(set(levels_of(looked_at(scenario, sets), "lidar").values()))
        except InputError:  # a file of it is not there any more
            driven = ["not known"]
        levels[", ".join(driven) or "no scanner"] += count
    return "; ".join(name if len(levels) == 1 else f"{name}: {n} runs" for name, n in levels.items())


def _levels(found: Conducted) -> list[list[str]]:
    """Of every slot of the first run its level and the ranges in which that was checked."""
    try:
        scenario = scenario_of(next(found.session.runs()))
    except InputError:  # a file of it is not there any more
        return []
    rows = []
    for machine in scenario.machines.values():
        for slot, choice in machine.slots.items():
            if choice.kind.is_control:
                continue
            ranges = [f"{c.quantity} {c.span} ({c.source})" for c in choice.found.checked]
            errors = [f"{e.metric} {e.size:g} against {e.against} ({e.source})" for e in choice.found.errors]
            told = "; ".join(ranges) or "no range declared: what a run met was not compared with anything"
            rows.append([f"{machine.name}.{slot}", choice.level, told, "; ".join(errors) or "none stated"])
    return rows


def _believe(found: Conducted) -> list[str]:
    """What the verdicts do not take into account."""
    said = [
        "Runs in which a limit rests on a level that was outside the range in which it was checked are not "
        f"judged: {sum(not run.is_judged for run in found.coverage.runs)} runs. Ranges, and the levels that "
        "declare none, are listed under Models.",
        "Limits, buckets and exposure are numbers of the file that binds the ODD to swath. It gives as their "
        f"source: {found.odd.file.source}.",
        "The share of runs that pass in a cell is not the share at work: the campaign spreads the other "
        "attributes over all their buckets, work meets some of these more often.",
        "A fault that needs four or more attributes at once is found only where it shows in three, too.",
    ]
    said += _elsewhere(found)
    if not found.is_complete:
        said.append(
            "Planned runs are missing, or runs were added after results had been seen. The exact binomial "
            "test does not allow for that; the verdicts rest on an e-process, a test that does and that "
            "needs more runs."
        )
    return said


def _unjudged(found: Conducted) -> list[list[str]]:
    """Slot, quantity, how many runs it keeps from being judged, and what they met of it."""
    met: dict[tuple[str, str], list[Sequence[float]]] = {}
    for run in found.coverage.runs:
        for slot, quantity, span_of in beyond(run.result) if not run.is_judged else ():
            met.setdefault((slot, quantity), []).append(span_of)
    return [
        [slot, quantity, str(len(spans)), span([min(s[0] for s in spans), max(s[1] for s in spans)])]
        for (slot, quantity), spans in sorted(met.items())
    ]


def _digests(found: Conducted) -> list[tuple[str, str]]:
    odd = found.odd.domain.revision
    return [
        ("ODD (SHA-256 of its OpenODD documents)", odd),
        ("code of swath that made the runs", _code(found.campaign.code, found.campaign.commit)),
        ("code of swath that made this page", _code(code_hash(), commit())),
        ("seed of the draws", str(found.campaign.seed)),
    ]


def _code(code: str, of: str) -> str:
    return f"{code}, commit {of}" if of else f"{code}, commit unknown"


def _cell_rows(found: Conducted, cells: Sequence[OddCell],
               why: Mapping[str, Explained]) -> Iterable[Mapping[str, Any]]:  # fmt: skip
    for cell in cells:
        axes = [found.odd.bucket_axis[place] for place in cell.places]
        names = [axis.name for axis, _ in axes] + [""] * (2 - len(axes))
        labels = [axis.labels[bucket] for axis, bucket in axes] + [""] * (2 - len(axes))
        told = why.get(cell.text)
        yield {
            "attribute": names[0],
            "bucket": labels[0],
            "attribute_2": names[1],
            "bucket_2": labels[1],
            "verdict": cell.verdict,
            "runs": cell.counted,
            "failed": cell.failed,
            "hits": cell.hits,
            "metres": f"{cell.metres:.1f}",
            "seconds": f"{cell.seconds:.1f}",
            "p_broken": f"{cell.p_broken:.3g}",
            "p_shown": f"{cell.p_shown:.3g}",
            "cause": "" if told is None or told.cause is None else told.cause.text,
            "why": "" if told is None else told.why,
            "runs_without_causes": "" if told is None else told.counted,
            "failed_without_causes": "" if told is None else told.failed,
        }


def _run_rows(found: Conducted) -> Iterable[Mapping[str, Any]]:
    for run in found.coverage.runs:
        o = run.outside
        yield {
            "run": run.result["id"],
            "seed": run.result["seed"],
            "verdict": run.result["verdict"],
            "reason": run.result["reason"],
            "digest": run.result["digest"],
            "breaks": " ".join(broken_by(found.odd.file, run.result)),
            "again": again(found.folder.name, run.result),
            "counts": run.counts,
            "left_odd_s": "" if o is None else o.t_s,
            "left_odd_m": "" if o is None else o.distance_m,
            "why": "" if o is None else o.why,
            **run.result["point"],
        }


def _csv(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    text = io.StringIO()
    listed = list(rows)
    writer = csv.DictWriter(text, list(listed[0]) if listed else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(listed)
    write_whole(path, text.getvalue())


def _junit(path: Path, found: Conducted, cells: Sequence[OddCell],
           why: Mapping[str, Explained]) -> None:  # fmt: skip
    """Put the buckets and the broken pairs into a JUnit file, as a suite of their own."""
    root = ET.fromstring(read_text(path, "file", "a file of results"))
    suite = ET.SubElement(root, "testsuite", name=f"ODD {found.odd.name}")
    if found.odd.file.requirement:
        properties = ET.SubElement(suite, "properties")
        ET.SubElement(properties, "property", name="requirement", value=found.odd.file.requirement)
    told = [cell for cell in cells if len(cell.places) == 1 or cell.verdict == BROKEN]
    for cell in told:
        test = ET.SubElement(suite, "testcase", classname=f"ODD {found.odd.name}", name=cell.text)
        if cell.verdict == BROKEN:
            of = why[cell.text]
            cause = f"; {of.why}" if of.cause is None else f"; cause: {of.cause.text}, {of.why}"
            ET.SubElement(test, "failure", message=f"{cell.failed} of {cell.counted} runs fail{cause}")
        elif cell.verdict != SHOWN:
            ET.SubElement(
                test, "skipped", message=f"{cell.verdict}: {cell.failed} of {cell.counted} runs fail"
            )
    suite.set("tests", str(len(told)))
    suite.set("failures", str(sum(cell.verdict == BROKEN for cell in told)))
    ET.indent(root)
    write_whole(path, ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n")
