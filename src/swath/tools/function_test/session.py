"""A folder of a function test: plan, journals, table; runs are done, gone on with and judged."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from swath.core.errors import InputError
from swath.core.output_folder import check_folder
from swath.core.whole_file import write_whole
from swath.documents.json_file import read_object
from swath.documents.text_file import read_text
from swath.runtime.kept import KeptFields
from swath.tools.function_test.cells import Cell, cells_of
from swath.tools.function_test.cluster import run_on_cluster
from swath.tools.function_test.in_step import in_chunks, results_in
from swath.tools.function_test.journal import (
    Journal,
    Result,
    Stored,
    finished,
    results_of,
    write_rows,
)
from swath.tools.function_test.judged import PresentLimits, in_shadow
from swath.tools.function_test.one_run import do_run
from swath.tools.function_test.plan import ID_LENGTH, Plan, PlannedRun, plan_of
from swath.tools.function_test.pool import Done, run_all

PLAN, JOURNALS = "plan.json", "journal"
Asked = TypeVar("Asked")


@dataclass(frozen=True)
class Session:
    """A plan in its folder."""

    folder: Path
    plan: Plan

    @property
    def journals(self) -> Path:
        """Folder of the journals."""
        return self.folder / JOURNALS

    def left(self) -> Iterator[PlannedRun]:
        """Runs that are in no journal, each once: two candidates may come to the same scenario."""
        done = finished(self.journals)
        for run in self.plan.runs():
            if run.id not in done:
                done.add(run.id)
                yield run

    def do(self, workers: int, done: Done, client: Any = None) -> None:
        """Do what is left on worker processes, or those of a client of dask; `done` gets each result."""
        if client is not None:
            run_on_cluster(self.left(), self.journals, client, done)
        else:
            run_all(self.left(), self.journals, workers, done)

    def do_share(self, share: int, of: int, done: Done) -> None:
        """Do what is left of one share of the plan (1..of), in this process."""
        journal, fields = Journal(self.journals, f"share-{share}-of-{of}"), KeptFields()
        mine = (run for run in self.left() if int(run.id, 16) % of == share - 1)
        for chunk in in_chunks(mine, 1):
            for result in results_in(chunk, fields, do_run):
                journal.add(result)
                done(result)
        journal.close()

    def results(self) -> list[Result]:
        """Finished runs in the order of the plan."""
        with Stored(self.journals) as stored:
            return list(self._each(stored))

    def _each(self, stored: Stored) -> Iterator[Result]:
        for run in self.plan.runs():
            if (found := stored.get(run.id)) is not None:
                whole = {**found, **_about(run)}  # another candidate may have come to the same scenario
                yield from (whole, *in_shadow(whole, run.shadows))

    def cells(self, *, again: bool = False) -> list[Cell]:
        """Judged cells; again: against the limits that the cases have now."""
        with Stored(self.journals) as stored:
            results = self._each(stored)
            if again:
                now = {case.name: PresentLimits(case) for case in self.plan.found}
                results = (now[result["case"]].judge(result) for result in results)
            return cells_of(self.plan.found, self.plan.candidates, self.plan.counts, results)

    def table(self) -> Path:
        """Write results.parquet, its rows in the order of their names."""
        names = np.fromiter((int(run.id, 16) for run in self.plan.runs()), np.uint64)
        shadows = sorted(set(self.plan.candidates) - set(self.plan.steering))

        def rows() -> Iterator[Result]:
            for number in np.argsort(names, kind="stable").tolist():
                if (found := stored.get(f"{int(names[number]):0{ID_LENGTH}x}")) is not None:
                    whole = {**found, **self.plan.about(number)}
                    yield from (whole, *in_shadow(whole, shadows))

        with Stored(self.journals) as stored:
            return write_rows(self.folder, rows(), stored.metrics)

    def run_of(self, name: str) -> tuple[PlannedRun, Result | None]:
        """A run by its name or the beginning of it, with its result. InputError when there is none, or
        several.
        """
        found = {run.id: run for run in self.plan.runs() if run.id.startswith(name)}
        if len(found) != 1:
            raise InputError(
                "run", name, f"expected the name of one run of {self.folder}, {len(found)} begin with it"
            )
        run = next(iter(found.values()))
        return run, next(iter(results_of(self.journals, [run.id])), None)


def _about(run: PlannedRun) -> dict[str, Any]:
    return {"case": run.case, "candidate": run.candidate, "point": dict(run.point), "seed": run.seed}


def begin(folder: Path, plan: Plan, candidates: Path | None = None) -> Session:
    """A session in a new folder, or the one that is there with the same plan. InputError for another plan.

    candidates: the file that names them
    """
    file = folder / PLAN
    text = plan.text
    if file.is_file() and _but_limits(read_text(file, "--out", "a plan")) != _but_limits(text):
        expected = (
            "expected a new folder: in this one lie results of another plan, or of another version of swath"
        )
        raise InputError("--out", str(folder), expected)
    if not file.is_file():
        check_folder(folder, (PLAN,), "function test")
    plan.check(candidates)
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(file, text)
    return Session(folder, plan)


def claim_folder(file: Path, asked: Any, what: str) -> None:
    """Make a folder that of a search or estimate, by the file with what is asked. InputError where it holds
    another one. what: in words
    """
    before = read_asked(file, type(asked), what)
    if before is None:
        check_folder(file.parent, (file.name,), what.split()[-1])
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, json.dumps(asdict(asked), indent=2, sort_keys=True) + "\n")
    elif before != asked:
        was, now = asdict(before), asdict(asked)
        other = "; ".join(f"{k} {was[k]!s:.40}, now {now[k]!s:.40}" for k in now if was[k] != now[k])
        expected = f"expected a new folder: this one holds another {what.split()[-1]} ({other})"
        raise InputError("--out", str(file.parent), expected)


def read_asked(file: Path, kind: type[Asked], what: str) -> Asked | None:
    """What a search or campaign asks, from its file in a folder; None where there is none. what: in words"""
    if not file.is_file():
        return None
    data = read_object(file, what.split()[-1], what)
    try:
        return kind(**{key: tuple(v) if isinstance(v, list) else v for key, v in data.items()})
    except TypeError as error:
        raise InputError(file.name, None, f"expected {what}: {error}", file=file) from error


def _but_limits(text: str) -> str:
    """A plan without the limits of its cases: runs with other limits are done beside those that are there."""
    try:
        data: dict[str, Any] = json.loads(text)
    except ValueError:
        return text
    return json.dumps({key: value for key, value in data.items() if key != "expects"})


def open_session(folder: Path, *, same_code: bool = True) -> Session:
    """The session in a folder. InputError where there is none; same_code: or where it is of other code."""
    file = folder / PLAN
    try:
        if not file.is_file():
            expected = f"expected the folder of a function test, with {PLAN}"
            raise InputError("folder", str(folder), expected)
        data = read_object(file, PLAN, "a plan")
        if (beside := folder / str(data["cases"])).is_file():  # of a case that lies in the folder
            data = {**data, "cases": str(beside.resolve())}
        return Session(folder, plan_of(data, same_code=same_code))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(PLAN, None, f"expected a plan: {error}", file=file) from error
