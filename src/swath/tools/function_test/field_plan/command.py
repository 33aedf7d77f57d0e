"""`swath test plan-field`: real passes that narrow most how far a simulation may be off."""

import argparse
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

from swath.terminal.options import add_folder, add_sets, made_of, option, verb
from swath.tools.function_test.progress import add_engine, engine, progress


def add(verbs: Any) -> None:
    """Add the verb."""
    plan = verb(verbs, "plan-field", "which real passes narrow most what a simulation leaves open", _plan)
    option(plan, "source", "the folder of a campaign over an ODD (a dossier), or a case")
    option(plan, "--runs N", "real passes", 8)
    option(
        plan,
        "--other KEY=VALUE",
        "level to compare with (default: another of the scanner); several times",
        [],
    )
    option(plan, "--metric NAME", "that levels are compared by; scans = heights of echoes", "margin")
    option(plan, "--pairs N", "conditions at which they are compared", 64)
    option(plan, "--filled FORM", "passes.csv with what was driven: becomes evidence", type=Path)
    add_sets(plan, "of every scenario")
    option(plan, "--seed N", "seed of the draws", 1)
    add_folder(plan, "plan of the field", text="folder of the results", alone=False)
    add_engine(plan)


def _plan(args: argparse.Namespace) -> int:
    from swath.terminal.tables import table
    from swath.tools.function_test.case import source_of
    from swath.tools.function_test.evidence import write_evidence
    from swath.tools.function_test.field_plan.form import FORM, NEXT, compared, write_form
    from swath.tools.function_test.field_plan.page import write_plan
    from swath.tools.function_test.field_plan.plan import FieldPlan, choose, plan_field, spread

    source = source_of(args.source)
    asked = made_of(FieldPlan, args, source=source)
    with progress(2 * args.pairs) as done, engine(args.cluster, args.workers) as client:
        planned = plan_field(args.out, asked, max(1, args.workers), done, client)
    if args.filled is not None:
        evidence = compared(planned, args.filled)
        for folder in (args.out, *([Path(source)] if os.path.isdir(Path(source)) else [])):
            print(f"evidence  {write_evidence(folder, evidence)}: {len(evidence)} passes")
        scale = spread(planned.case, planned.conditions)
        known = [each.point for each in evidence]
        left = choose(planned.case, planned.conditions, scale, args.runs, known)
        planned = replace(planned, passes=left)
    form = write_form(planned, FORM if args.filled is None else NEXT)
    names = list(planned.case.file.vary)
    rows = [(str(n), *(str(each.condition.point[name]) for name in names), planned.narrowed(each.narrows))
            for n, each in enumerate(planned.passes, 1)]  # fmt: skip
    table("", ("pass", *names, "narrows [%]"), rows)
    if planned.doubts_nothing:
        print(f"no doubt to share: {planned.doubts_nothing}")
    print(f"form    {form}")
    print(f"report  {write_plan(planned)}")
    return 0
