"""A folder of a function test: plan, journals, table; runs are done, gone on with and judged."""

import hashlib
import json
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass, fields, replace
from itertools import chain, islice
from math import inf
from pathlib import Path
from typing import Any, TypeVar

from swath.core.errors import InputError, reason_of
from swath.core.files.output_folder import check_folder
from swath.core.files.place import move, own_folder
from swath.core.files.whole_file import copy_whole, write_whole
from swath.documents.contents import changed_since, hashes_by_path, keep_python, kept_python
from swath.documents.json_file import read_object
from swath.documents.packed import open_parquet, readable
from swath.documents.text_file import read_text
from swath.documents.validation import checked
from swath.documents.yaml_document import Document
from swath.runtime.kept import KeptFields
from swath.tools.function_test.cells import Cell, cells_of
from swath.tools.function_test.cluster import run_on_cluster
from swath.tools.function_test.fidelity import CHEAP, DEAR, levels_of
from swath.tools.function_test.journal import (
    CHANGED,
    PLAN,
    ROWS,
    TABLE,
    Journal,
    Stored,
    read_journals,
    results_of,
    write_parquet,
    write_rows,
)
from swath.tools.function_test.judging.first_batch import FIRST, telling_nothing
from swath.tools.function_test.judging.judged import PresentLimits, in_shadow
from swath.tools.function_test.one_run import results_in
from swath.tools.function_test.plan import Plan, PlannedRun, looked_at, plan_of
from swath.tools.function_test.pool import Done, in_chunks, is_number, run_all
from swath.tools.function_test.stored_line import Result

JOURNALS, RUNS, EARLIER, PARTS = "journal", "runs.parquet", "earlier", "parts"
PAGES = ("report.html", "junit.xml")
NESTED = ("point", "sets", "shadows", "met")  # of a planned run: JSON in its file
Asked = TypeVar("Asked")


@dataclass(frozen=True)
class Session:
    """A plan in its folder. first: number of its first run; runs before it are of earlier rounds."""

    folder: Path
    plan: Plan
    first: int = 0

    @property
    def journals(self) -> Path:
        """Folder of the journals."""
        return self.folder / JOURNALS

    def write(self) -> None:
        """Write the plan with its Python files, and append the names of its runs to those of earlier rounds,
        of which the Python files are.
        """
        with own_code(self.folder):
            self._write()

    def _write(self) -> None:
        import pyarrow as pa

        file = self.journals / RUNS
        before = open_session(self.folder).plan.points[: self.first] if self.first else ()
        whole = replace(self.plan, points=(*before, *self.plan.points))
        schema = pa.schema(
            [(f.name, pa.int64() if f.name == "seed" else pa.string()) for f in fields(PlannedRun)]
        )
        write_parquet(file, schema, chain(_rows(file, 0, self.first), map(_row, self.plan.runs())))
        keep_python(whole.named, self.folder / PARTS)
        write_whole(self.folder / PLAN, whole.text_in(self.folder))

    def counted(self) -> set[str]:
        """Names of the finished runs of the plan that is in the folder; none of a folder of version 0.2."""
        with Stored(self.journals) as stored:
            named = _planned(self.journals / RUNS, 0, None)
            return {run.id for run in named if stored.get(run.id) is not None}

    def put_aside(self) -> None:
        """Move the results into a folder of their own, where they are reported, judged and compared as
        before; runs that the next plan has, too, are found there and here.
        """
        folder = self.folder / EARLIER
        aside = own_folder(folder / str(1 + len(list(folder.glob("*")))))
        for file in (self.folder / PLAN, *self.journals.iterdir(), *(self.folder / PARTS).glob("*")):
            copy_whole(file, aside / file.relative_to(self.folder), "file", "a file of the plan")
        for name in (TABLE, *PAGES):
            if os.path.isfile(self.folder / name):
                move(self.folder / name, aside / name)
        print(f"note    the runs of other limits or another version of a file are kept in {aside}")

    def runs(self, first: float = inf) -> Iterator[PlannedRun]:
        """The runs of the plan as they were called when it was made, in order; first: so many of each case
        with each candidate.
        """
        met = Counter[tuple[str, str]]()
        for run in self._named():
            met[run.case, run.candidate] += 1
            if met[run.case, run.candidate] <= first:
                yield run

    def _named(self) -> Iterator[PlannedRun]:
        file = self.journals / RUNS
        if os.path.isfile(file):
            end = self.first + len(self.plan.points) if self.plan.points else None
            yield from _planned(file, self.first, end)
            return
        names = {_key(result): result["id"] for result in read_journals(self.journals)}
        for run in self.plan.runs():  # a folder of version 0.2: by what they are, their names say too much
            yield replace(run, id=names.get(_key(run.about), run.id))

    @property
    def changed(self) -> str:
        """The files that are not as they were when its runs were made, in words; "" where all are."""
        return changed_since(self.plan.made_of)

    @property
    def version(self) -> str:
        """Version of these files as they are now, in a few letters."""
        now = json.dumps(hashes_by_path(list(self.plan.made_of)))
        return hashlib.sha256(now.encode()).hexdigest()[:6]

    def levels(self) -> Counter[str]:
        """Levels at which the scanners of its runs are driven, with how many runs."""
        kinds, levels = Counter[tuple[str, ...]](), Counter[str]()
        for run in self.runs():
            kinds[run.scenario, *(text for text in run.sets if not is_number(text))] += 1
        for (scenario, *sets), count in kinds.items():
            try:
                driven = sorted(set(levels_of(looked_at(scenario, sets), "lidar").values()))
            except InputError:  # a file of it is not there any more
                driven = ["not known"]
            levels[", ".join(driven) or "no scanner"] += count
        return levels

    def level_lines(self) -> list[str]:
        """Levels of scanners that are driven in the place of the one asked for, in how many runs and why."""
        levels = self.levels() if (asked := self.plan.level) in (CHEAP, DEAR) else Counter({asked: 1})
        whole = f"of {levels.total()} runs driven at"
        said = [f"--level {asked}: {n} {whole} {name}" for name, n in levels.items() if name != asked]
        reasons = Counter((run.case, run.why_dear) for run in self.runs() if run.why_dear)
        return said + [f"{case}: {count} runs at {DEAR}: {why}" for (case, why), count in reasons.items()]

    def left(self, first: float = inf) -> Iterator[PlannedRun]:
        """Runs that are in no journal, each once: two candidates may come to the same scenario."""
        begun = set[str]()
        with Stored(self.journals) as stored:
            for run in self.runs(first):
                if run.id not in begun and stored.get(run.id) is None:
                    begun.add(run.id)
                    yield run

    def do(self, workers: int, done: Done, client: Any = None, first: float = inf) -> None:
        """Do what is left on worker processes, or those of a client of dask; `done` gets each result.

        first: as of `runs`. InputError where a file of the plan without a copy is changed meanwhile.
        """
        with own_code(self.folder):
            if client is not None:
                run_on_cluster(self.left(first), self.journals, client, _unchanged(done))
            else:
                run_all(self.left(first), self.journals, workers, _unchanged(done))

    def made(self, workers: int, done: Done, client: Any = None) -> list[Result]:
        """Write the plan, do what is left of it, and give its results."""
        self.write()
        self.do(workers, done, client)
        return self.results()

    def do_share(self, share: int, of: int, done: Done) -> None:
        """Do what is left of one share of the plan (1..of), in this process. InputError as `do`."""
        journal, fields = Journal(self.journals, f"share-{share}-of-{of}"), KeptFields()
        mine = (run for run in self.left() if int(run.id, 16) % of == share - 1)
        with own_code(self.folder), closing(journal):
            for chunk in in_chunks(mine, 1):
                for result in results_in(chunk, fields):
                    _unchanged(done)(journal.add(result))

    def results(self, first: float = inf) -> list[Result]:
        """Finished runs in the order of the plan; first: as of `runs`."""
        with Stored(self.journals) as stored:
            return list(self._each(stored, first))

    def _each(self, stored: Stored, first: float = inf) -> Iterator[Result]:
        for run in self.runs(first):
            if (found := stored.get(run.id)) is not None:
                whole = {**found, **run.about}  # another candidate may have come to the same scenario
                with readable("journal", "results of candidates in shadow", self.journals):
                    others = list(in_shadow(whole, run.shadows))
                yield from (whole, *others)

    @property
    def telling_nothing(self) -> dict[str, str]:
        """Limits and candidates that tell nothing in the first runs, each with a line that says so."""
        changed = {f"candidate {name}": [name] for name in self.plan.candidates}
        return telling_nothing([*self._as_now(self.results(FIRST))], changed=changed)

    def _as_now(self, results: Iterable[Result]) -> Iterator[Result]:
        """Results judged by the limits that the cases have now."""
        now = {case.name: PresentLimits(case) for case in self.plan.found}
        return (now[result["case"]].judge(result) for result in results)

    def cells(self, *, again: bool = False) -> list[Cell]:
        """Judged cells; again: against the limits that the cases have now. InputError where one is gone."""
        there = {case.name for case in self.plan.found}
        planned = Counter((run.case, run.candidate) for run in self.runs())
        if gone := sorted({case for case, _ in planned} - there):
            expected = "expected the cases by whose limits the stored runs are judged; nothing was changed"
            raise InputError("cases", ", ".join(gone), expected)
        counts = {case: count for (case, name), count in planned.items() if name == self.plan.steering[0]}
        with Stored(self.journals) as stored:
            results = self._each(stored)
            if again:
                results = self._as_now(results)
            return cells_of(self.plan.found, self.plan.candidates, counts, results)

    def table(self) -> Path:
        """Write results.parquet, its rows in the order of the plan."""
        with Stored(self.journals) as stored:
            metrics = {name for result in self._each(stored) for name in result["metrics"]}
            return write_rows(self.folder, self._each(stored), metrics)

    def run_of(self, name: str) -> tuple[PlannedRun, Result | None]:
        """A run by its name or the beginning of it, with its result.

        InputError when there is none, or several.
        """
        found = {run.id: run for run in self.runs() if run.id.startswith(name)}
        if len(found) != 1:
            raise InputError(
                "run", name, f"expected the name of one run of {self.folder}, {len(found)} begin with it"
            )
        run = next(iter(found.values()))
        return run, next(iter(results_of(self.journals, [run.id])), None)


def _unchanged(done: Done) -> Done:
    """The same, but InputError for a run in which a file was changed."""

    def told(result: Result) -> None:
        if result["verdict"] == CHANGED:
            expected = "expected as it was while runs are made; those before are kept"
            raise InputError("file", result["reason"], expected)
        done(result)

    return told


def _row(run: PlannedRun) -> dict[str, Any]:
    plain = {f.name: getattr(run, f.name) for f in fields(run)}
    return {**plain, **{name: json.dumps(plain[name]) for name in NESTED}}


def _rows(file: Path, first: int, end: int | None) -> Iterator[dict[str, Any]]:
    """Rows of a file of planned runs."""
    if not os.path.isfile(file) or end == first:
        return
    what = "the runs of a plan"
    with open_parquet(file, "runs", what) as found, readable("runs", what, file):
        yield from islice((row for some in found.iter_batches(ROWS) for row in some.to_pylist()), first, end)


def _planned(file: Path, first: int, end: int | None) -> Iterator[PlannedRun]:
    """The runs in such a file. InputError where a row is none."""
    for row in _rows(file, first, end):
        with readable("runs", "the runs of a plan", file):
            run = {**row, **{name: json.loads(row[name]) for name in NESTED}}
            checked(PlannedRun, Document(run, file, kind="run"))
        yield PlannedRun(**run)


def _key(about: Result) -> str:
    """What identifies a run, apart from its name."""
    return json.dumps([about[name] for name in ("case", "candidate", "point", "seed")], sort_keys=True)


def begin(folder: Path, plan: Plan, candidates: Path | None = None) -> Session:
    """A session in a new folder, or the one that is there with the same plan. InputError for another plan.

    candidates: the file that names them. Results that do not count any more, of other limits or made by
    another version of a file, are put aside under `earlier`.
    """
    file = folder / PLAN
    if os.path.isfile(file):
        texts = read_text(file, "--out", "a plan"), plan.text_in(folder)
        check_same(folder, "plan", *map(_as_asked, texts))
    else:
        check_folder(folder, (PLAN, JOURNALS), "function test")
        check_folder(folder / JOURNALS, (RUNS,), "function test")  # written before the plan
    plan.check(candidates)
    session = Session(folder, plan)
    old = session.counted()
    if old and not old <= {run.id for run in plan.runs()}:
        session.put_aside()
    session._write()
    return session


def claim_folder(file: Path, asked: Any, what: str) -> None:
    """Take a folder for a search or an estimate, and write into it the file that says what is asked.

    InputError where it holds another one. what: in words
    """
    before = read_asked(file, type(asked), what)
    if before is None:
        check_folder(file.parent, (file.name,), what.split()[-1])
        write_whole(file, json.dumps(asdict(asked), indent=2, sort_keys=True) + "\n")
    else:
        check_same(file.parent, what.split()[-1], asdict(before), asdict(asked))
    check_version(file.parent)


def check_same(folder: Path, what: str, was: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    """InputError for a folder that holds another plan, search or campaign; it names what differs."""
    if other := [key for key in {**was, **now} if was.get(key) != now.get(key)]:
        differ = "; ".join(
            f"{key} {{}}, now {{}}".format(*apart(was.get(key), now.get(key))) for key in other
        )
        expected = f"expected a new folder: this one holds another {what} ({differ})"
        raise InputError("--out", str(folder), expected)


def apart(*values: Any) -> list[str]:
    """The beginnings of values as text; of long ones the places from which on they differ."""
    texts = [str(value) for value in values]
    alike = next((n for n, signs in enumerate(zip(*texts, strict=False)) if len({*signs}) > 1), 0)
    begin = max(0, alike - 20) if max(map(len, texts)) > 40 else 0
    return [f"{'...' * bool(begin)}{text[begin : begin + 40]}" for text in texts]


def own_code(folder: Path) -> Any:
    """A block in which the Python files of a session are read as they were when it was begun."""
    data = read_object(folder / PLAN, PLAN, "a plan") if os.path.isfile(folder / PLAN) else {}
    return kept_python(data.get("made_of", {}), folder / PARTS)


def check_version(folder: Path, key: str = "--out") -> None:
    """InputError for a folder whose runs were made by another version of a file, of which it has no copy."""
    if os.path.isfile(folder / PLAN):
        session = open_session(folder)
        with own_code(folder):
            lacks = changed_since(session.plan.made_of)
        if lacks:
            expected = f"expected a new folder: the runs in this one are of another version of {lacks}"
            expected += "; copies of Python files in it run with --allow-code"
            raise InputError(key, str(folder), expected)
        if session.changed:
            print(f"note    the runs go on with the copy of {session.changed} that lies in the folder")


def read_asked(file: Path, kind: type[Asked], what: str) -> Asked | None:
    """What a search or campaign asks, from its file in a folder; None where there is none. what: in words."""
    if not os.path.isfile(file):
        return None
    data = read_object(file, what.split()[-1], what)
    found: Asked = checked(kind, Document(data, file, kind=what))
    return found


def _as_asked(text: str) -> dict[str, Any]:
    """A plan without what only makes another version of it: limits of its cases, contents of its files."""
    try:
        data: dict[str, Any] = json.loads(text)
    except ValueError:
        return {"text": text}
    return {key: value for key, value in data.items() if key not in ("expects", "made_of")}


def open_session(folder: Path, *, same_code: bool = True) -> Session:
    """The session in a folder. InputError where there is none; same_code: or where it is of other code."""
    file = folder / PLAN
    try:
        if not os.path.isfile(file):
            expected = f"expected the folder of a function test, with {PLAN}"
            raise InputError("folder", str(folder), expected)
        data = read_object(file, PLAN, "a plan")
        if os.path.isfile(beside := folder / str(data["cases"])):  # of a case that lies in the folder
            data = {**data, "cases": str(beside.resolve())}
        return Session(folder, plan_of(data, same_code=same_code))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(PLAN, None, f"expected a plan: {reason_of(error)}", file=file) from error
