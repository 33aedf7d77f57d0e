"""The dossier of a campaign: a page for an assessor, tables, JUnit, and the ODD in which the function is
shown.

Every statement on the page is one of the cells in `cells.csv` or of the runs in `runs.csv`; each run can be
made again from its name.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from swath import __version__
from swath.core.errors import InputError
from swath.core.files.whole_file import write_csv
from swath.core.number_text import num, percent_of, span
from swath.core.process.shell import command
from swath.documents.text_file import read_text
from swath.report.chart import Chart
from swath.report.html import (
    Banner,
    Beside,
    Facts,
    Fold,
    Html,
    Items,
    Section,
    Table,
    counted,
    element,
    joined,
    write_page,
)
from swath.runtime.credibility import NEVER_CHECKED
from swath.runtime.met import QUANTITIES, SEEN
from swath.runtime.world import ASKED_BY
from swath.scenario.slots import kind_of
from swath.tools.function_test.cells import cells_of, errors_of
from swath.tools.function_test.evidence import evidence_table
from swath.tools.function_test.judging.first_batch import banners
from swath.tools.function_test.judging.judged import BEYOND, ERROR, beyond, unjudged_lines, why_unjudged
from swath.tools.function_test.judging.verdict import BROKEN, NOT_SHOWN, SHOWN, lower_bound, upper_bound
from swath.tools.function_test.junit import write_junit, write_suites
from swath.tools.function_test.odd.campaign import ODD_FILE, Conducted
from swath.tools.function_test.odd.causes import (
    AS_THE_REST,
    KINDS,
    REACH,
    WHYS,
    Cause,
    cause_of,
    drawn_for,
)
from swath.tools.function_test.odd.cells import NEVER, VERDICTS, OddCell, needed_each
from swath.tools.function_test.odd.check import not_drawn
from swath.tools.function_test.odd.coverage import HIT_M, INSIDE, Driven
from swath.tools.function_test.odd.restricted import write_restricted
from swath.tools.function_test.odd.trace import (
    NOT_MEASURED,
    TRACE,
    Traced,
    again,
    broken_by,
    said_of,
    trace_rows,
    traced,
)
from swath.tools.function_test.one_run import ENDED, scenario_of
from swath.tools.function_test.page import more, write_matrix
from swath.tools.function_test.plan import code_hash, commit

NOWHERE = "nowhere"
ELSEWHERE = 0.2  # share of runs that drove elsewhere than drawn, from which on it is reported; estimated
STEP, AXES = 13.0, 150.0  # of the matrix of buckets, and room for the names of attributes [px]
LAST = 0.9  # of the matrix from the left, from where on there is no room for a name
LISTED = 60  # rows of a list on the page; all are in the tables
NO_CERTIFICATE = (
    "This dossier certifies nothing. It says what a simulation showed of a function, in which part of a "
    "declared domain, and how sure that is. It may serve as evidence by simulation beside tests and analysis "
    "(ISO 18497-4:2024); it replaces no assessment of conformity under Regulation (EU) 2023/1230."
)


ABOUT_CELLS = (
    "The range of each attribute is cut into buckets. A **cell** is one bucket, or a pair of buckets of "
    "two attributes. It is **broken** where its runs rule out the claim that {0} of all runs there would "
    "pass, **shown** where they rule out that fewer would, **not shown** where they are too few to say "
    "either, and **never driven** where no run counts and none drove {1} m. [How cells are "
    "judged](#judged)"
)
CAUSES = (
    "cause", "runs drawn there fail", "runs drawn elsewhere fail", "p-value of the contrast",
    "of those drawn there, drove mainly there", "first broken limit of the first run, in the order of expect",
    "repeat a run",
)  # fmt: skip
ABOUT_CAUSES = (
    f"A cause is {KINDS} whose runs fail more often than those drawn elsewhere (Fisher's exact test, after "
    "Bonferroni over all cells, ranges and boxes) and that rules out the claim by itself. The second and "
    "every further row counts only runs that belong to no row above it. Runs belong where they were "
    "**drawn**; "
)
ABOUT_DRAWN = "where they drove may be an effect of the failure. "
ALL_CELLS = "Each cell in `cells.csv`, with its runs that belong to no cause."
LIMITS = "limit", "runs break it", "of those measured, 95 %", "and no other", "not measured"
ABOUT_LIMITS = (
    "Where a run ended before anything was measured for a limit, that limit is neither kept nor broken; "
    "`swath run` and the verdict of such a run count it as failed."
)
SHOWN_IN = ("attribute", "shown in", "shown in, without the runs of the causes above")
ABOUT_RESTRICTED = (
    "`{0}` is the ODD without {1}: the causes, what is broken without them, buckets that are not shown, "
    "and pairs that were never driven. Pairs that are not shown stay in it. It was drawn from these runs, "
    "so it has to be confirmed by new ones: `swath test run --odd {2}/{0} --out DIR`."
)
ABOUT_NEVER = "Its level declares no range for it, and more than usual values were met: it may be wrong."
ABOUT_UNFELT = (
    "They reach what is seen of the crop by way of the parts named alone, or not at all: then their buckets "
    "say nothing of the function."
)
ABOUT_MODELS = (
    "Of the first run. A level with a range is compared with what each run met; of one without, nothing "
    "says where it stops being right."
)
REQUIREMENTS = (
    "requirement", "limits", "runs keep it", "break it", "not measured", "not judged",
    "nearest to a limit, or farthest beyond one, by its margin",
)  # fmt: skip
ABOUT_REQUIREMENTS = (
    "Every run and limit of each is in `requirements.csv`; the requirements that a run breaks stand in "
    "`runs.csv`."
)
ABOUT_LAYERS = (
    "Layers are the groups at the top of the taxonomy. Each field counts the pairs between two layers; on "
    "the diagonal pairs and buckets within one."
)
BUCKETS = ("bucket", "verdict", "runs pass", "m", "s", "drawn", "exposure")
ABOUT_BUCKETS = (
    "Of each bucket the runs that pass, the way and the time driven in it, the runs drawn for it, and its "
    "exposure: the share of the working time, where the binding states it. Below stands the scenario key "
    "that sets the attribute."
)
ABOUT_RULES = "Numbers are in the units that the binding states."
ABOUT_MATRIX = (
    "One square for each pair of buckets, a bucket alone on the diagonal; thick lines separate layers, "
    "thin ones attributes. Without a square: the ODD has no such pair. All of it is in `cells.csv`."
)
UNFELT = "attribute", "asked for by", "runs in which its key differed from its default"
LEFT = ("run", "at t [s]", "after [m]", "outside for [m]", "because", "verdict", "counts")
ABOUT_LEFT = (
    f"A run that passes counts for the verdicts only if {num(100 * INSIDE)} % of its way lies inside the "
    "ODD; one that fails always counts."
)
FAILED = ("run", "first broken limit, in the order of expect", "values of the attributes")
ABOUT_FAILED = (
    "The command repeats a run, with its own report and replay, and says whether all its signals are the "
    "same (the digest)."
)
HOW = (
    "A run counts for the one bucket of each attribute in which it drove the longest way, and for the "
    "pairs of these. Each cell is judged by {0}. So many cells are judged at once that some would look "
    "broken, or shown, by chance; both verdicts are corrected for it. **Broken** after Holm, over all "
    "cells: with {1} confidence not one cell is called broken wrongly. **Shown** after Benjamini and "
    "Yekutieli, over all buckets and over all pairs: of the cells called shown, {2} at most are expected "
    "to be wrong. Runs are chosen by what was driven, never by whether they passed."
)
ABOUT_AGAIN = (
    "Commands are to be typed in the folder that holds `{0}`, with the same version of swath. One run, "
    "whose name is in `runs.csv`: `{1}`. The whole campaign: `{2}`"
)
OTHER_CODE = "The runs were made by other code than this page: a run made again may have another digest."
FILES = (
    "`cells.csv`: every cell: verdict, runs, failures, hits (runs that drove {0} m or more there), "
    "metres, seconds, p-values; of a broken one the cause, and its runs without those of all causes",
    "`runs.csv`: every run: values of the attributes, seed, verdict, digest, where it left the ODD",
    "`requirements.csv`: every requirement: the runs and limits that judge it",
    "`results.parquet`, `report.html`: metrics and limits of every run; `junit.xml`: for a build server",
    "`campaign.odd.yaml`, `*.openodd.yaml`: the ODD as it was tried; `{1}`: what remains of it",
    "`cod`, after `swath test report {2} --cod`: what each run drove, as tables of OpenODD (current "
    "operational domain)",
)


@dataclass(frozen=True)
class Summary:
    """What the screen and the top of the page say."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    lines: Sequence[str]


def summary_of(found: Conducted) -> Summary:
    """Cells by verdict, and sentences."""
    rows = []
    for name, some in (
        ("buckets", [c for c in found.cells if len(c.places) == 1]),
        ("pairs of buckets", [c for c in found.cells if len(c.places) == 2]),
    ):
        rows.append((name, *(str(sum(c.verdict == v for c in some)) for v in VERDICTS)))
    driven, pairs = found.coverage.pair_share
    tried = [run for run in found.coverage.runs if run.is_judged]
    passed = sum(run.passes for run in tried)
    lines = [
        f"{passed} of {len(tried)} runs pass; {driven} of {pairs} pairs of buckets driven {num(HIT_M)} m or "
        f"counted ({num(100 * driven / max(1, pairs))} %)"
    ]
    for cause, _, here, is_elsewhere in _runs_of(found):
        warning = f"; only {here} drove mainly there" if is_elsewhere else ""
        lines.append(
            f"cause: {cause.text}: {cause.failed} of {cause.counted} runs drawn there fail, elsewhere "
            f"{cause.rest_failed} of {cause.rest_counted}{warning}"
        )
    lines += _told(found)
    lines += [*_elsewhere(found), *found.session.level_lines()]
    errors = [run.result["reason"] for run in found.coverage.runs if run.result["verdict"] == ERROR]
    lines += unjudged_lines(run.result for run in found.coverage.runs if not run.is_judged)
    if errors:
        lines.append(errors_of(len(errors), len(found.coverage.runs), errors[0]))
    if short := _short(found):
        lines.append(short)
    return Summary(VERDICTS, rows, lines)


def _runs_of(found: Conducted) -> Iterable[tuple[Cause, list[Driven], int, bool]]:
    """Of each cause the runs drawn for it and no stronger one, how many of these drove mainly there, and
    whether those are too few to take the cause for what was driven.
    """
    coverage, causes = found.coverage, found.causes
    for number, cause in enumerate(causes, 1):
        runs = [r for r in coverage.runs if r.counts and cause_of(coverage, r, causes[:number]) is cause]
        here = sum(cause.has(set(coverage.main(run).tolist())) for run in runs)
        yield cause, runs, here, here < (1.0 - ELSEWHERE) * len(runs)


def _told(found: Conducted) -> Iterable[str]:
    """How many broken cells there are of each kind."""
    for why in WHYS:
        if count := sum(e.why == why for e in found.why.values()):
            yield (
                f"{counted(count, 'cell')} broken {why}"
                if why == AS_THE_REST
                else f"{counted(count, 'broken cell')}: {why}"
            )


def write_dossier(found: Conducted) -> Path:
    """Write dossier.html, report.html, cells.csv, runs.csv, junit.xml, results.parquet and the restricted
    ODD.
    """
    folder = found.folder
    restricted = write_restricted(folder, found.odd, found.out)
    write_csv(folder / "cells.csv", [*_cell_rows(found)])
    write_csv(folder / "runs.csv", [*_run_rows(found)])
    write_csv(folder / "requirements.csv", [*trace_rows(found.odd.file, found.results, folder.name)], TRACE)
    found.session.table()
    plan = found.session.plan
    tested = cells_of(plan.found, plan.candidates, plan.counts, found.results)
    _junit(write_junit(folder / "junit.xml", tested), found)
    write_matrix(folder / "report.html", tested)
    broken = _causes(found)
    left = [run for run in found.coverage.runs if run.outside is not None]
    failing = [run for run in found.coverage.runs if run.is_judged and not run.passes]
    elsewhere = "**(!)** marks a cause most of whose runs did not drive mainly there: "
    marked = elsewhere if any("(!)" in str(row[4]) for row in broken) else ""
    about = f"{ABOUT_CAUSES}{marked}{ABOUT_DRAWN}{_left_over(found)}."
    said = list(_told(found))
    needed = [_requirement(folder.name, trace) for trace in traced(found.odd.file, found.results)]
    rules = Table("", ("module", "", "condition"), found.odd.domain.rules())
    sections = [
        Section("Where it is broken", [
            Table("", CAUSES, broken, (1, 2, 3, 4), about) if broken else _no_cause(found),
            Items(said), ALL_CELLS if said else "",
            Table("By which limit runs fail", LIMITS, _by_limit(found), (1, 2, 3, 4), ABOUT_LIMITS),
            Table("How runs ended", ("reason", "runs", "of these pass"), _by_end(found), (1, 2)),
        ]),
        Section("Where it is shown to work", _where_shown(found, restricted.name)),
        Section("What was never driven", _never(found)),
        Section("What not to believe", [
            Items(_believe(found)),
            Table("Runs that are not judged", ("slot", "quantity", "runs", "met"), _unjudged(found), (2,)),
            Table("Met, and never checked for", ("slot", "quantity", "runs"), _never_checked(found), (2,),
                    ABOUT_NEVER),
            Table("Attributes that no scanner, camera or edge detector asks for", UNFELT, _unfelt(found),
                    (2,), ABOUT_UNFELT),
            Table("Models", ("slot", "level", "checked for", "known error of a metric"), _levels(found),
                    text=ABOUT_MODELS),
        ]),
        evidence_table(folder),
        Table("Requirements", REQUIREMENTS, needed, (2, 3, 4, 5), ABOUT_REQUIREMENTS),
        Section("Verdicts by layer of the ODD", [_keys(), _layers(found), ABOUT_LAYERS]),
        Section("Attributes, bucket by bucket", [
            _attributes(found), ABOUT_BUCKETS,
            Fold("The ODD as it was read", [rules, ABOUT_RULES]),
        ]),
        Section("Every pair of buckets", [_matrix(found), ABOUT_MATRIX]),
        Table("Runs that left the ODD", LEFT, [_left(run) for run in left[:LISTED]], (1, 2, 3),
              f"{more(len(left), LISTED, '`runs.csv`')} {ABOUT_LEFT}"),
        Table("Runs that fail", FAILED, [_run(folder.name, run) for run in failing[:LISTED]],
              text=f"{more(len(failing), LISTED, '`runs.csv`')} {ABOUT_FAILED}"),
        Section("How cells are judged", [_how(found)], "judged"),
        Section("Run it again", [
            ABOUT_AGAIN.format(folder.name, again(folder.name, {"id": "RUN"}), again_all(found)),
        ]),
        Section("Files and digests", [
            Banner(OTHER_CODE) if found.campaign.code != code_hash() else "",
            Table("", ("what", "digest"), _digests(found)),
            Items([text.format(num(HIT_M), restricted.name, folder.name) for text in FILES]),
        ]),
    ]  # fmt: skip
    return write_page(
        folder / "dossier.html",
        sections,
        heading=f"Dossier: {found.odd.name}",
        lead=found.odd.file.objective,
        verdict=_verdict(found),
        top=[
            Banner(NO_CERTIFICATE),
            *banners(found.telling_nothing),
            Facts(_facts(found)),
            *_about(found),
        ],
    )


def _verdict(found: Conducted) -> tuple[str, str, str]:
    broken, causes = sum(c.verdict == BROKEN for c in found.cells), len(found.causes)
    if broken:
        said = counted(causes, "cause") if causes else "no cause separated"
        return "fail", f"{counted(broken, 'cell')} broken", said
    if all(c.verdict == SHOWN for c in found.cells):
        return "pass", "all shown", "none broken"
    return "none", "not all shown", "none broken"


def _facts(found: Conducted) -> dict[str, object]:
    claim, runs = found.claim, found.coverage.runs
    driven, pairs = found.coverage.pair_share
    return {
        "runs": f"{len(runs)} of {found.campaign.budgets[-1]}",
        "runs that pass": str(sum(run.passes for run in runs if run.is_judged)),
        "claim for each cell": f"{num(100 * claim.pass_rate)} % of its runs pass, "
        f"{num(100 * claim.confidence)} % confidence",
        f"pairs of buckets driven {num(HIT_M)} m or counted": f"{driven} of {pairs}",
        "fewest runs counted for a pair": str(_fewest(found)),
        "requirement": found.odd.file.requirement or None,
        "ODD version": found.odd.domain.version or None,
        "LiDAR level": "; ".join(f"{name}: {n} runs" for name, n in found.session.levels().items()),
        "swath": __version__,
    }


def _about(found: Conducted) -> tuple[str, str]:
    share = f"{num(100 * found.claim.pass_rate)} %"
    return f"{_overall([run for run in found.coverage.runs if run.is_judged])}.", ABOUT_CELLS.format(
        share, num(HIT_M)
    )


def _no_cause(found: Conducted) -> str:
    if count := sum(c.verdict == BROKEN for c in found.cells):
        return (
            f"{counted(count, 'cell')} broken, but in none do runs fail more often than in the rest, so no "
            "cause can be separated."
        )
    return (
        "Nowhere: in no cell do so many runs fail that they rule out the claim, taking into account that "
        "many cells are judged at once."
    )


def _where_shown(found: Conducted, name: str) -> list[object]:
    """The buckets in which the function is shown, and the ODD that remains."""
    left, out = _shown(found, found.rest), found.out
    rows = [(*now, without) for now, (_, without) in zip(_shown(found, found.cells), left, strict=True)]
    is_alike = not found.causes
    short = _short(found)
    said = (
        f"Each attribute is judged by itself, over all values of the others that were driven with it. {short}"
    )
    nowhere = [axis for axis, where in left if where == NOWHERE]
    if nowhere:
        of = "any attribute" if len(nowhere) == len(left) else ", ".join(nowhere)
        remains = (
            "No part of the ODD is shown: when what is broken and what is not shown is taken out, no "
            f"bucket of {of} is left."
        )
    else:
        remains = ABOUT_RESTRICTED.format(name, counted(len(out), "part"), found.folder.name)
    rows_text = [c.text for c in out[:LISTED]]
    beyond = f"`shown.openodd.yaml`, from `not_shown_{len(rows_text) + 1}` on"
    leaves = [Items(rows_text, is_wide=True), more(len(out), len(rows_text), beyond)]
    return [
        Table(
            "",
            SHOWN_IN[: 2 if is_alike else 3],
            [row[: 2 if is_alike else 3] for row in rows if {*row[1:]} != {NOWHERE}],
        ),
        f"{said}." if short else said,
        remains,
        Fold("What it leaves out", leaves) if out else "",
    ]


def _never(found: Conducted) -> list[object]:
    """Cells without a run, and what no run could drive."""
    never = [c.text for c in found.cells if c.verdict == NEVER]
    lost = [(n, b.not_simulated) for n, b in found.odd.file.attributes.items() if b.not_simulated]
    unbound = [n for n in found.odd.domain.attributes if n not in found.odd.file.attributes]
    undrawn = [(finding.name, finding.text) for finding in not_drawn(found.odd)]
    head = ("attribute", "part")
    all_driven = (
        f"Every pair of buckets that the ODD has was driven {num(HIT_M)} m or more, or has a run that "
        "counts for it."
    )
    return [
        f"{counted(len(never), 'cell')} of the ODD:" if never else all_driven,
        Items(never[:LISTED], is_wide=True),
        more(len(never), LISTED, "`cells.csv`"),
        Table("Parts outside every bucket, which no run was drawn for", head, undrawn),
        Table("Driven, but in no bucket", ("attribute", "metres", "runs"), _in_no_bucket(found), (1, 2)),
        Table("Attributes that are not simulated", ("attribute", "why"), lost),
        element("h3", "Attributes that the binding does not name") if unbound else "",
        f"Nothing sets or measures them: {', '.join(unbound)}" if unbound else "",
    ]


def _how(found: Conducted) -> str:
    test = "the exact binomial test" if found.is_complete else "an e-process (see above)"
    sure, wrong = f"{num(100 * found.claim.confidence)} %", f"{num(100 * (1.0 - found.claim.confidence))} %"
    return HOW.format(test, sure, wrong)


def _short(found: Conducted) -> str:
    """How many runs would show all pairs, where these did not."""
    pairs = [c for c in found.cells if len(c.places) == 2]
    need = needed_each(len(pairs), found.claim)
    if all(c.verdict in (SHOWN, BROKEN) for c in pairs):
        return ""
    return (
        f"{needed_each(1, found.claim)} runs without a failure show a single cell; for all {len(pairs)} "
        f"pairs together each needs {need}, the one with the fewest counted runs has {_fewest(found)}"
    )


def _fewest(found: Conducted) -> int:
    """Runs that count for the pair for which fewest do."""
    return min((c.counted for c in found.cells if len(c.places) == 2), default=0)


def _shown(found: Conducted, cells: Sequence[OddCell]) -> list[tuple[str, str]]:
    """Of each attribute the buckets in which the function is shown, in words."""
    said = []
    for axis in found.odd.axes:
        own = {c.places[0] - axis.first for c in cells if len(c.places) == 1 and c.verdict == SHOWN}
        places = [p for p in sorted(own) if 0 <= p < axis.count]
        if axis.edges:
            runs = [list(g) for _, g in groupby(enumerate(places), lambda pair: pair[1] - pair[0])]
            parts = [f"{num(axis.edges[r[0][1]])} to {num(axis.edges[r[-1][1] + 1])}" for r in runs]
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


def _left_over(found: Conducted) -> str:
    runs = [run for run in found.outside.runs if run.counts]
    failed = sum(not run.passes for run in runs)
    return f"Of the runs in none of these, {failed} of {len(runs)} fail" if found.causes else ""


def _causes(found: Conducted) -> list[list[object]]:
    """Rows of causes."""
    rows: list[list[object]] = []
    for cause, runs, here, is_elsewhere in _runs_of(found):
        failing = sorted((run.result for run in runs if not run.passes), key=lambda result: str(result["id"]))
        repeat = [element("code", again(found.folder.name, result)) for result in failing[:3]]
        rows.append(
            [
                element("strong", cause.text),
                f"{cause.failed} of {cause.counted}",
                f"{cause.rest_failed} of {cause.rest_counted}",
                num(cause.p),
                joined((here, element("strong", "(!)"))) if is_elsewhere else str(here),
                str(failing[0]["reason"]),
                joined(repeat, "<br>"),
            ]
        )
    return rows


def _in_no_bucket(found: Conducted) -> list[list[str]]:
    """Of each attribute the way [m] that lies in none of its buckets, and in how many runs."""
    rows = []
    for number, axis in enumerate(found.odd.axes):
        ways = [float(run.metres[run.steps[:, number] < 0].sum()) for run in found.coverage.runs]
        if any(ways):
            rows.append([axis.name, num(sum(ways)), str(sum(way > 0.0 for way in ways))])
    return rows


def _by_limit(found: Conducted) -> list[list[str]]:
    """Of each limit how many runs break it, which share (Clopper-Pearson), how many of these no other one,
    and in how many it was not measured.
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
    judged_runs = sum(run.is_judged for run in found.coverage.runs)
    rows = []
    for name, _ in (broken + unmeasured).most_common():
        count = broken[name], judged_runs - unmeasured[name], 0.975
        share = f"{num(100.0 * lower_bound(*count))} to {percent_of(upper_bound(*count))}"
        rows.append([name, str(broken[name]), share, str(alone[name]), str(unmeasured[name])])
    errors = sum(run.result["verdict"] == ERROR for run in found.coverage.runs)
    rows += [["ended before a limit was measured", "", "", "", str(nothing)]] if nothing else []
    return [*rows, *([["run came to nothing", str(errors), "", "", ""]] if errors else [])]


def _by_end(found: Conducted) -> list[list[str]]:
    """Of each reason why runs ended how many did, and how many of these pass."""
    ends = [(run.result.get(ENDED, {}).get("reason", ""), run.passes) for run in found.coverage.runs]
    counts, passed = Counter(why for why, _ in ends), Counter(why for why, passes in ends if passes)
    return [[why, str(n), str(passed[why])] for why, n in counts.most_common() if why]


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


def _layers(found: Conducted) -> Table:
    """Counts of the cells of each pair of layers by verdict; a layer with itself has its buckets, too."""
    names = found.odd.layers
    rows = []
    for i, a in enumerate(names):
        row: list[object] = [element("strong", a)]
        for b in names[: i + 1]:
            some = [c for c in found.cells if {*c.layers} == {a, b}]
            counts = {v: n for v in VERDICTS if (n := sum(c.verdict == v for c in some))}
            strip = [
                element("i", class_=_look(v), style=f"width:{100 * n / len(some):.4g}%", title=f"{n} {v}")
                for v, n in counts.items()
            ]
            said = ", ".join(f"{n} {v}" for v, n in counts.items()) or "nothing simulated"
            row.append(joined((element("span", joined(strip, ""), class_="strip"), element("small", said))))
        rows.append([*row, *[""] * (len(names) - i - 1)])
    return Table("", ("", *names), rows)


def _look(verdict: str) -> str:
    """The class of a verdict in the style sheet."""
    return verdict.replace(" ", "-")


def _attributes(found: Conducted) -> Beside:
    """Of each attribute its buckets: verdict, runs, way and time; those outside the ODD too."""
    by_place = {c.places[0]: c for c in found.cells if len(c.places) == 1}
    drawn = [drawn_for(found.odd, run) for run in found.coverage.runs]
    tables: list[object] = []
    for axis in found.odd.axes:
        rows = []
        for bucket in range(axis.count):
            place = axis.first + bucket
            if (cell := by_place.get(place)) is None:
                rows.append([axis.labels[bucket], "outside the ODD", *[""] * 5])
                continue
            share = percent_of(axis.exposure[bucket]) if axis.bound.exposure else "not stated"
            passed = f"{cell.counted - cell.failed} of {cell.counted}"
            way = (num(cell.metres), num(cell.seconds), str(sum(place in some for some in drawn)))
            verdict = joined((element("i", class_=_look(cell.verdict)), cell.verdict), "")
            rows.append([axis.labels[bucket], element("span", verdict, class_="key"), passed, *way, share])
        met = axis.bound.met
        measured = f"counted as measured: {QUANTITIES[met].meaning}" if met else "counted as set"
        title = f"{axis.name} [{axis.bound.unit}]" if axis.bound.unit else axis.name
        text = f"`{', '.join(axis.bound.keys)}`; {measured}"
        tables.append(Table(title, BUCKETS, rows, range(2, 7), text))
    return Beside(tables, "columns")


def _matrix(found: Conducted) -> Beside:
    """Every pair of buckets as a square, below the diagonal."""
    odd, size, layer = found.odd, 1.0 / found.odd.bucket_count, ""
    made = Chart(
        STEP * odd.bucket_count, STEP * odd.bucket_count, "verdict of every pair of buckets", left=AXES
    )
    for cell in found.cells:
        x, y = cell.places[0] * size, 1.0 - (cell.places[-1] + 1) * size
        counts = f"{cell.counted - cell.failed} of {cell.counted} pass, {num(cell.metres)} m"
        look = "clean" if cell.verdict == NOT_SHOWN and not cell.failed else _look(cell.verdict)
        title = f"{cell.text}: {cell.verdict}, {counts}"
        made.box(x, y, 0.93 * size, 0.93 * size, look=look, title=title)
    for axis in odd.axes:
        at, is_new, layer = axis.first * size, axis.layer != layer, axis.layer
        thick = 1.0 if is_new else 0.25
        made.line(0.0, 1.0 - at, at, 1.0 - at, thick=thick)
        made.line(at, 0.0, at, 1.0 - at, thick=thick)
        middle = 1.0 - (axis.first + axis.count / 2) * size
        made.text(0.0, middle, axis.name.partition(".")[2], anchor="end", right=-5.0, down=4.0)
        if is_new:
            is_last = at > LAST
            made.text(
                1.0 if is_last else at, 1.0 - at, axis.layer, anchor="end" if is_last else "start",
                right=0.0 if is_last else 16.0, down=-3.0 if is_last else 11.0, is_name=True,
            )  # fmt: skip
    return Beside([_keys(("not shown, but no run fails", "clean")), made], "")


def _keys(*others: tuple[str, str]) -> Html:
    """What the colours of the verdicts mean. others: more of them, with their class."""
    looks = [*((v, _look(v)) for v in VERDICTS), *others]
    keys = [element("span", joined((element("i", class_=look), name), "")) for name, look in looks]
    return element("p", joined(keys), class_="key")


def _left(run: Driven) -> list[object]:
    assert run.outside is not None
    o, name = run.outside, element("code", str(run.result["id"])[:8])
    way = (num(o.t_s, places=1), num(o.distance_m, places=1), num(o.length_m))
    return [name, *way, o.why, str(run.result["verdict"]), "yes" if run.counts else "no"]


def _run(folder: str, run: Driven) -> list[object]:
    point = ", ".join(f"{name.partition('.')[2]} {value}" for name, value in run.result["point"].items())
    why = "; ".join(filter(None, (run.result["reason"], run.result.get(ENDED, {}).get("text"))))
    return [element("code", again(folder, run.result)), why, point]


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
            errors = [
                f"{e.metric} {num(e.size)} against {e.against} ({e.source})" for e in choice.found.errors
            ]
            text = "; ".join(ranges) or "no range declared: what a run met was not compared with anything"
            rows.append([f"{machine.name}.{slot}", choice.level, text, "; ".join(errors) or "none stated"])
    return rows


def _believe(found: Conducted) -> list[str]:
    """What the verdicts do not take into account."""
    said = [
        "Runs in which a limit rests on a level that was outside the range in which it was checked are not "
        f"judged: {sum(not r.is_judged and why_unjudged(r.result) == BEYOND for r in found.coverage.runs)} "
        "runs. Ranges, and the levels that "
        "declare none, are listed under Models.",
        "Limits, buckets and exposure are numbers of the file that binds the ODD to swath. It gives as their "
        f"source: {found.odd.file.source}.",
        "The share of runs that pass in a cell is not the share at work: the campaign spreads the other "
        "attributes over all their buckets, work meets some of these more often.",
        REACH,
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


def _never_checked(found: Conducted) -> list[list[str]]:
    """Slot, quantity, and in how many runs it was met beyond plain values by a level that has no range."""
    count = Counter(
        (slot, name)
        for run in found.coverage.runs
        for slot, names in run.result.get(NEVER_CHECKED, {}).items()
        for name in names
    )
    return [[slot, name, str(runs)] for (slot, name), runs in sorted(count.items())]


def _unfelt(found: Conducted) -> list[list[str]]:
    """Attribute, the parts that ask for its keys where no sensor of the crop does, and in how many runs."""
    rows = []
    for axis in found.odd.axes:
        own = tuple(f"{key}." for key in axis.bound.keys)
        asked = [run.result.get(ASKED_BY, {}).items() for run in found.coverage.runs]
        each = [by for of in asked if (by := [parts for key, parts in of if f"{key}.".startswith(own)])]
        parts = {part for by in each for parts in by for part in parts}
        kinds = {kind.name for part in parts if (kind := kind_of(part.rpartition(".")[2])) is not None}
        if each and not kinds & {*SEEN}:
            rows.append([axis.name, ", ".join(sorted(parts)) or "nothing", str(len(each))])
    return rows


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


def _cell_rows(found: Conducted) -> Iterable[Mapping[str, Any]]:
    for cell in found.cells:
        axes = [found.odd.bucket_axis[place] for place in cell.places]
        names = [axis.name for axis, _ in axes] + [""] * (2 - len(axes))
        labels = [axis.labels[bucket] for axis, bucket in axes] + [""] * (2 - len(axes))
        reason = found.why.get(cell.text)
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
            "cause": "" if reason is None or reason.cause is None else reason.cause.text,
            "why": "" if reason is None else reason.why,
            "runs_without_causes": "" if reason is None else reason.counted,
            "failed_without_causes": "" if reason is None else reason.failed,
        }


def _run_rows(found: Conducted) -> Iterable[Mapping[str, Any]]:
    for run in found.coverage.runs:
        o = run.outside
        yield {
            "run": run.result["id"],
            "seed": run.result["seed"],
            "verdict": run.result["verdict"],
            "reason": run.result["reason"],
            "ended": run.result.get(ENDED, {}).get("reason", ""),
            "digest": run.result["digest"],
            "breaks": " ".join(broken_by(found.odd.file, run.result)),
            "again": again(found.folder.name, run.result),
            "counts": run.counts,
            "left_odd_s": "" if o is None else o.t_s,
            "left_odd_m": "" if o is None else o.distance_m,
            "why": "" if o is None else o.why,
            **run.result["point"],
        }


def _junit(path: Path, found: Conducted) -> None:
    """Put the buckets and the broken pairs into a JUnit file, as a suite of their own."""
    root = ET.fromstring(read_text(path, "file", "a file of results"))
    suite = ET.SubElement(root, "testsuite", name=f"ODD {found.odd.name}")
    if found.odd.file.requirement:
        properties = ET.SubElement(suite, "properties")
        ET.SubElement(properties, "property", name="requirement", value=found.odd.file.requirement)
    listed = [cell for cell in found.cells if len(cell.places) == 1 or cell.verdict == BROKEN]
    for cell in listed:
        test = ET.SubElement(suite, "testcase", classname=f"ODD {found.odd.name}", name=cell.text)
        if cell.verdict == BROKEN:
            of = found.why[cell.text]
            cause = f"; {of.why}" if of.cause is None else f"; cause: {of.cause.text}, {of.why}"
            ET.SubElement(test, "failure", message=f"{cell.failed} of {cell.counted} runs fail{cause}")
        elif cell.verdict != SHOWN:
            ET.SubElement(
                test, "skipped", message=f"{cell.verdict}: {cell.failed} of {cell.counted} runs fail"
            )
    suite.set("tests", str(len(listed)))
    suite.set("failures", str(sum(cell.verdict == BROKEN for cell in listed)))
    write_suites(path, root)
