"""`swath test`: list, run, search, levels, estimate, plan-field, work, report, compare, again."""

import argparse
import os
from contextlib import nullcontext
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any

from swath.core.errors import InputError, shortened
from swath.core.foreign_code import code_unread
from swath.core.number_text import num
from swath.core.process.shell import command
from swath.core.units import digits_in
from swath.terminal.options import add_folder, add_sets, made_of, option, verb
from swath.terminal.outcome import exit_code
from swath.terminal.tables import add_json, as_json, say, table
from swath.tools.function_test import cheaper_command
from swath.tools.function_test.estimate import command as estimate_command
from swath.tools.function_test.field_plan import command as field_plan
from swath.tools.function_test.progress import add_engine, engine, progress
from swath.tools.function_test.search import command as search_command

PLACE = "many", 0  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("test", help="run and judge cases many times", description=_DESCRIPTION)
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    listing = verb(verbs, "list", "list cases: parameters, limits", _list)
    option(listing, "cases", _CASES, "catalogue", nargs="?")
    add_json(listing)
    run = verb(verbs, "run", "do the runs of cases; resumes where it was stopped", _run)
    option(run, "cases", _CASES, nargs="?")
    add_folder(run, "function test", text="folder of the results", alone=False)
    option(run, "--odd ODD", "instead of cases: a bound ODD, a file or wheat-harvest")
    option(run, "--runs N", "runs of --odd (default 400)", type=int)
    option(
        run,
        "--with FILE",
        "candidates to compare, or an edge detector of your own: mine.py:Mine",
        type=Path,
        dest="candidates",
    )
    option(run, "--seeds N", "seeds 1 to N instead of those of the cases", type=int)
    option(run, "--draw N", "N random points instead of the grid", 0)
    option(run, "--draw-seed N", "seed of the random points", 1)
    option(run, "--only TAG", "only cases with this tag", [])
    add_sets(run, "change every scenario")
    option(
        run,
        "--level",
        "LiDAR level; empirical is used only where it is accurate enough for the limits",
        "",
        choices=("empirical", "plants"),
    )
    option(run, "--shadow", "the first candidate steers, the others only see its scans (open loop)")
    add_engine(run)
    option(run, "--plan-only", "write the plan only, for swath test work")
    search_command.add(verbs)
    cheaper_command.add(verbs)
    estimate_command.add(verbs)
    field_plan.add(verbs)
    work = verb(verbs, "work", "do one share of a plan, on any computer that sees the folder", _work)
    work.add_argument("folder", type=Path)
    option(work, "--shard I/N", "share to do, e.g. 3/200", required=True)
    report = verb(verbs, "report", "judge stored results by the present limits; runs nothing", _report)
    report.add_argument("folder", type=Path)
    cod = "of an ODD: also what each run drove, as tables of OpenODD (COD), into DIR/cod"
    option(report, "--cod", cod)
    versus = verb(
        verbs, "compare", "compare two results run by run; exit code 1: something is worse", _compare
    )
    option(versus, "old OLD", "a folder of results, or FOLDER:CANDIDATE")
    option(versus, "new NEW", "another, or the same with another candidate")
    option(versus, "--metric NAME", "compare this metric instead of the default ones", [])
    option(versus, "--within VALUE", "differences up to this count as equal", type=float)
    again = verb(verbs, "again", "repeat one run as a full run folder and check its digest", _again)
    again.add_argument("folder", type=Path)
    option(again, "name RUN", "the run, or the beginning of its name")
    option(again, "--out DIR", "default: FOLDER/kept/RUN", type=Path)


def _list(args: argparse.Namespace) -> int:
    from swath.tools.function_test.case import find_cases

    cases = find_cases(args.cases)
    rows = []
    for case in cases:
        varied = {name: list(v.at) for name, v in case.file.vary.items()}
        count = case.grid_size * len(case.seeds)
        limits = [str(name) for name in case.file.expect]
        rows.append((case.name, case.file.objective, varied, count, limits, list(case.file.tags)))
    if args.json:
        as_json(("name", "objective", "vary", "runs", "limits_on", "tags"), rows)
        return 0
    if len(rows) > 1:
        table(
            "", ("case", "objective", "runs"), [(name, said, str(count)) for name, said, _, count, *_ in rows]
        )
        say(f"Tags, for --only: {', '.join(sorted({tag for row in rows for tag in row[-1]}))}")
        say("swath test list CASE says what varies and what is judged.")
        return 0
    name, objective, varied, count, limits, tags = rows[0]
    vary = [f"{key} {', '.join(map(str, at))}" for key, at in varied.items()]
    used = {
        "objective": objective,
        "varied": "; ".join(vary),
        "runs": str(count),
        "limits on": ", ".join(limits),
        "tags": ", ".join(tags),
        "known failures": "; ".join(known.why for known in cases[0].file.known),
    }
    table("", ("case", name), [(key, text) for key, text in used.items() if text])
    return 0


def _run(args: argparse.Namespace) -> int:
    from swath.runtime.workers import workers_kept
    from swath.tools.function_test.candidates import read_candidates
    from swath.tools.function_test.case import source_of
    from swath.tools.function_test.judging.first_batch import FIRST, name_first
    from swath.tools.function_test.plan import Plan
    from swath.tools.function_test.session import begin

    if args.odd is not None:
        return _run_odd(args)
    if args.runs is not None:
        raise InputError("--runs", args.runs, "expected --odd beside it: of cases, --seeds and --draw say it")
    if args.cases is None:
        raise InputError("cases", None, "expected `catalogue`, a case, or --odd with a domain")
    names, candidates = {"tags": "only", "drawn": "draw"}, read_candidates(args.candidates)
    plan = made_of(Plan, args, names, cases=source_of(args.cases), candidates=candidates)
    with code_unread() if args.plan_only else nullcontext():
        session = begin(args.out, plan, args.candidates)
    left = sum(1 for _ in session.left())
    if args.plan_only:
        then = command("test", "report", args.out)
        print(f"{left} runs to do: {command('test', 'work', args.out)} --shard 1/N ... N/N, then {then}")
        return 0
    with progress(left) as done, engine(args.cluster, args.workers) as client, workers_kept():
        session.do(max(1, args.workers), done, client, FIRST)
        name_first({}, session.telling_nothing)
        session.do(max(1, args.workers), done, client)
    return finish(session.folder, session, again=False)


def _run_odd(args: argparse.Namespace) -> int:
    from swath.tools.function_test.odd.binding import find_odd, read_odd
    from swath.tools.function_test.odd.campaign import RUNS, Campaign, conduct, revision_of

    others = {"cases": args.cases, "--with": args.candidates, "--seeds": args.seeds, "--draw": args.draw,
              "--only": args.only, "--shadow": args.shadow, "--plan-only": args.plan_only}  # fmt: skip
    if used := [name for name, value in others.items() if value]:
        why = "the ODD says what is run, and each 50 runs what was driven before; --cluster spreads them"
        raise InputError("--odd", args.odd, f"expected without {', '.join(used)}: {why}")
    odd = read_odd(find_odd(args.odd))
    runs = RUNS if args.runs is None else args.runs
    campaign = Campaign(odd.name, revision_of(odd), (runs,), args.draw_seed, tuple(args.sets), args.level)
    with progress(runs) as done, engine(args.cluster, args.workers) as client:
        found = conduct(args.out, campaign, odd, max(1, args.workers), done, client)
    return _finish_odd(found)


def _finish_odd(found: Any) -> int:
    """Dossier, and what it says on the screen; returns the exit code."""
    from swath.tools.function_test.odd.dossier import summary_of, write_dossier

    page, said = write_dossier(found), summary_of(found)
    table("", ("of the ODD", *said.columns), said.rows)
    for line in said.lines:
        print(line)
    print(f"dossier  {page}")
    return exit_code(cell.verdict for cell in found.cells)


def _work(args: argparse.Namespace) -> int:
    from swath.tools.function_test.session import check_version, open_session

    share, _, of = args.shard.partition("/")
    if not 1 <= digits_in(share) <= digits_in(of):
        raise InputError("--shard", args.shard, "expected I/N with I from 1 to N")
    session = open_session(args.folder)
    check_version(args.folder, "folder")
    session.plan.check()
    count = 0

    def done(result: dict[str, Any]) -> None:
        nonlocal count
        count += 1

    with engine("", 1):
        session.do_share(int(share), int(of), done)
    print(f"{count} runs done, {sum(1 for _ in session.left())} of the plan are left")
    return 0


def _report(args: argparse.Namespace) -> int:
    from swath.tools.function_test.estimate.estimate import open_estimate
    from swath.tools.function_test.odd.campaign import open_campaign
    from swath.tools.function_test.odd.trace import FOLDER, write_cod
    from swath.tools.function_test.search.search import open_search
    from swath.tools.function_test.session import open_session

    session = open_session(args.folder, same_code=False)
    if session.changed:
        print(f"note    the stored runs were made by another version of {session.changed}: they stay")
    found = open_campaign(session)
    if args.cod:
        if found is None:
            raise InputError("--cod", str(args.folder), "expected the folder of a campaign over an ODD")
        count = write_cod(args.folder, found.odd, found.results)
        print(f"COD tables of {count} runs  {args.folder / FOLDER}")
    if (searched := open_search(session)) is not None:
        return search_command.tell(searched)
    if (estimated := open_estimate(args.folder)) is not None:
        return estimate_command.tell_again(estimated)
    if found is not None:
        return _finish_odd(found)
    return finish(args.folder, session, again=True)


def _compare(args: argparse.Namespace) -> int:
    from swath.tools.function_test.compare import BETTER, SAME_BYTES, SAME_VERDICT, VERDICTS, WORSE, compare
    from swath.tools.function_test.judging.first_batch import name_first

    found = compare(args.old, args.new, args.metric)
    name_first({}, found.telling_nothing)
    kinds = (SAME_BYTES, SAME_VERDICT, BETTER, WORSE)
    counts = [(case, *(str(what.count(kind)) for kind in kinds)) for case, what in found.by_case().items()]
    table("", ("case", *kinds), counts)
    rows = []
    for name, d in found.differences.items():
        equal = args.within is not None and d.within <= args.within
        said = f"equal within {num(args.within)}" if equal else found.says(name)
        rest = num(d.within) if isfinite(d.within) else "-", num(d.smallest)
        rows.append((name, str(d.count), *found.difference_texts(name), said, *rest))
    columns = (
        "new - old",
        "pairs",
        "mean difference",
        "95 %",
        "shown",
        "lies within",
        "would have been seen",
    )
    table("", columns, rows)
    for name in (*found.differences, VERDICTS):
        if found.says(name) == "better":
            print(f"{name} better: {found.beside(name)}")
    same = found.outcomes.count(SAME_BYTES)
    if same < len(found.pairs) < (least := found.least_pairs):
        print(f"{len(found.pairs)} pairs are too few: {least} are needed to show anything")
    alone = f"; {found.alone} runs have no partner" if found.alone else ""
    print(f"{same} of {len(found.pairs)} pairs are the same bytes; verdicts: {found.says(VERDICTS)}{alone}")
    return 1 if found.is_worse else 0


def _again(args: argparse.Namespace) -> int:
    from swath.replay.writer import ReplayWriter
    from swath.report.report import ReportWriter
    from swath.runtime.credibility import outside_of
    from swath.runtime.job import run_job
    from swath.tools.function_test.judging.judged import verdict_of
    from swath.tools.function_test.odd.campaign import CAMPAIGN, Campaign
    from swath.tools.function_test.one_run import scenario_of
    from swath.tools.function_test.plan import code_hash, commit
    from swath.tools.function_test.session import open_session, own_code, read_asked

    session = open_session(args.folder, same_code=False)
    planned, result = session.run_of(args.name)
    made, here = session.plan.code, code_hash()
    with own_code(args.folder):
        scenario, changed = scenario_of(planned), session.changed
    if changed:
        print(f"note    the run was made by another version of {changed}: the digest may differ")
    if made != here:
        campaign = read_asked(args.folder / CAMPAIGN, Campaign, "a campaign")
        of = f" (commit {campaign.commit})" if campaign is not None and campaign.commit else ""
        mine = f" (commit {commit()})" if commit() else ""
        print(f"note    these runs were made by code {made}{of}, this is {here}{mine}: the digest may "
              "differ. To make the same bytes, install the version that made them.")  # fmt: skip
    version = f"-{session.version}" if changed else ""
    out = args.out or args.folder / "kept" / f"{planned.id}{version}"
    scenario = replace(scenario, summary=_told_of(args.folder, planned, scenario.summary))
    hooks = [ReportWriter(), ReplayWriter()]
    done = run_job(scenario, out, progress=True, hooks=hooks)
    before = ("", "") if result is None else (result["digest"], result["verdict"])
    verdict, _ = verdict_of(done.summary["expect"], outside_of(done.summary))
    same = before[0] == done.summary["digest"]
    print(f"in the test {before[0] or 'no digest'}, {before[1] or 'not done'}")
    print(f"now         {done.summary['digest']}, {verdict}")
    print(f"{done.folder}: {'the same digest as in the test' if same else 'another digest than in the test'}")
    return 0 if same else 1


def _told_of(folder: Path, run: Any, base: str) -> str:
    """The summary of a run made again: the scenario's own holds for it only where nothing is varied."""
    from swath.documents.yaml_document import read_document
    from swath.scenario.sections import LONGEST_SUMMARY
    from swath.tools.function_test.odd.campaign import ODD_FILE

    if not run.point:
        return base
    odd = folder / ODD_FILE
    requirement = read_document(odd).data.get("requirement") if os.path.isfile(odd) else ""
    of = f" ({requirement})" if requirement else ""
    point = ", ".join(f"{name.rpartition('.')[2]} {value}" for name, value in run.point.items())
    return shortened(f"Run {run.id[:8]} of {run.case}{of}: {point}", LONGEST_SUMMARY)


def finish(folder: Path, session: Any, *, again: bool) -> int:
    """Table, JUnit file, page and the verdicts on the screen; returns the exit code."""
    from swath.tools.function_test.judging.ranking import HEAD, ranking
    from swath.tools.function_test.judging.verdict import NOT_JUDGED, VERDICTS
    from swath.tools.function_test.junit import write_junit
    from swath.tools.function_test.page import write_matrix

    cells = session.cells(again=again)
    session.table()
    write_junit(folder / "junit.xml", cells)
    nothing = session.telling_nothing
    page = write_matrix(folder / "report.html", cells, shadow=session.plan.shadow, nothing=nothing)
    rows = []
    for cell in cells:
        worst = cell.worst
        said = (
            ""
            if worst is None
            else f"{worst.id[:8]} {cell.why_failed(worst) or f'margin {num(worst.margin)}'}"
        )
        rows.append((cell.case.name, cell.candidate, cell.verdict, "; ".join([cell.text, *cell.means]), said))
    table("", ("case", "candidate", "verdict", "what the runs show", "worst run"), rows)
    if len(session.plan.candidates) > 1:
        table("", HEAD, ranking(cells))
    for case, why in session.plan.left_out.items():
        print(f"note    {case} is left out: it has {why}")
    verdicts = [cell.verdict for cell in cells]
    print(", ".join(f"{verdicts.count(v)} {v}" for v in VERDICTS if v != NOT_JUDGED or v in verdicts))
    surprises = sum(cell.surprises.count for cell in cells)
    if surprises:
        print(f"{surprises} runs pass where the cases say that a failure is known")
    for line in session.level_lines():
        print(line)
    if session.plan.shadow:
        first = next(iter(session.plan.candidates))
        print(f"open loop: {first} steers, the others see its scans and do not act on the machine")
    bad = (cell.worst for cell in cells if cell.failed.count or cell.errors)
    failed = next((worst for worst in bad if worst), None)
    if failed is not None and not session.plan.shadow:
        line = command("test", "again", folder, failed.id[:8])
        print(f"`{line}` makes that run once more, with its own report")
    print(f"report  {page}")
    return exit_code(verdicts)


_CASES = "a case file, a folder of them, `catalogue`, or one of its cases"
_DESCRIPTION = """Function tests: cases with varied parameters and seeds, each judged as shown, broken, not
shown (too few runs) or not judged (a level was outside the range in which it was checked). Exit code 0 all
shown, 1 one is broken, 3 none is broken but not all are shown."""
