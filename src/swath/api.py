"""swath from Python: what `import swath` offers. A script or a notebook needs nothing else.

import swath

result = swath.run("straight", "runs/slow", sets={"combine.speed.speed_kmh": 5})
result.summary["lateral_rms_m"], result.exit_code, result.folder
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swath.core.errors import InputError, SwathError
from swath.core.foreign_code import Gate, allow_code, code_in, texts_in, through
from swath.core.process.collector import collected_rarely
from swath.core.random import Stream
from swath.core.registry import level_here
from swath.documents.packed import read_arrays
from swath.documents.validation import unknown_key
from swath.documents.yaml_document import Document, parse_value
from swath.judge.limits import exit_code_of
from swath.report.notebook import picture, run_html
from swath.runtime.folder import choose_scan_folder, folder_for, remove_empty, scan_of
from swath.runtime.job import JobResult, run_job, run_unrecorded
from swath.runtime.kept import KeptFields
from swath.runtime.workers import Lost, in_workers
from swath.runtime.worlds import run_each
from swath.scenario.scenario import Scenario, read_scenario
from swath.scenario.scenario import load_scenario as _load
from swath.tools.scan.scan import scan_job

if TYPE_CHECKING:
    from swath.field_io.folder import FieldFolder
    from swath.tools.tune.tune import Tuned

Sets = Mapping[str, Any] | Sequence[str]


def load_scenario(
    source: str | Path,
    *,
    sets: Sets = (),
    seed: int | None = None,
    code: bool = False,
    addresses: Sequence[str] = (),
) -> Scenario:
    """Read a bundled scenario by name, a file, or the scenario of a run folder, with changes.

    Parameters
    ----------
    source : str or Path
        Name of a bundled scenario, a file, or a run folder.
    sets : mapping or sequence of str
        Changes: `{"combine.speed.speed_kmh": 5}`, or texts as after `--set`; a text is read as there.
    seed : int
        Seed in place of the scenario's.
    code : bool
        Whether Python files and FMUs that the scenario names may run, with your rights, a Python file as
        soon as it is read (SECURITY.md). What `sets` names is yours and runs. A scenario remembers what it
        may run.
    addresses : sequence of str
        Addresses beyond this machine, buses and terminals that it may open, as it writes them.

    Returns
    -------
    Scenario
        The scenario, checked, with every default filled in.

    Raises
    ------
    InputError
        Names key, value, what was expected, file and line.
    """
    texts = [f"{k}={_text(v)}" for k, v in sets.items()] if isinstance(sets, Mapping) else list(sets)
    with _allowed(code, texts, addresses):
        return _load(source, sets=texts, flags={} if seed is None else {"seed": f"seed={seed}"})


def _allowed(code: bool, texts: Iterable[str], addresses: Sequence[str] = ()) -> Any:
    """A block in which code may run: all, or what texts as after `--set` name; so with addresses."""
    named = [*texts_in([parse_value(text.partition("=")[2], text) for text in texts])]
    return allow_code(None if code else code_in(named), [*named, *addresses])


def _text(value: Any) -> str:
    """A value as after `--set`: text as it is, arrays, numbers of numpy and paths too."""
    if isinstance(value, type):
        return level_here(value)
    return str(value) if isinstance(value, str | Path) else json.dumps(value, default=_plain)


def _plain(value: Any) -> Any:
    """A class as the level that stands for it; arrays and numbers of numpy as numbers; else text."""
    if isinstance(value, type):
        return level_here(value)
    return value.tolist() if hasattr(value, "tolist") else str(value)


@dataclass(frozen=True, repr=False)
class RunResult(JobResult):
    """A finished run; a notebook shows its metrics and how it steered."""

    def _repr_html_(self) -> str:
        return run_html(repr(self), self.summary, self.folder)


@dataclass(frozen=True)
class ScanResult:
    """One scan.

    Attributes
    ----------
    files : tuple of Path
        What was written.
    data : mapping of str to ndarray
        The arrays of scan.npz by name.
    notes : tuple of str
        Whole sentences on what to know of the scan.
    """

    files: tuple[Path, ...]
    data: Mapping[str, Any]
    notes: tuple[str, ...] = ()

    def _repr_html_(self) -> str:
        return "".join(picture(file.read_bytes()) for file in self.files if file.suffix == ".png")


def read_field(path: str | Path) -> "FieldFolder":
    """Read a field folder, as `swath field import` makes one; a notebook shows its overview.

    Parameters
    ----------
    path : str or Path
        The folder.

    Returns
    -------
    FieldFolder
        Terrain, stand and place of the field.

    Raises
    ------
    InputError
        Where the folder is none, or damaged.
    """
    from swath.field_io.folder import read

    return read(path)


def scan(
    scenario: str | Path | Scenario,
    out: str | Path | None = None,
    *,
    at_s: float = 0.0,
    sets: Sets = (),
    seed: int | None = None,
    camera: bool = False,
    code: bool = False,
    replace: bool = False,
) -> ScanResult:
    """Make one scan of a scenario, as `swath scan` does.

    Parameters
    ----------
    scenario : str, Path or Scenario
        As in `load_scenario`.
    out : str or Path
        Folder to write; by default a new folder in `runs`.
    at_s : float
        Time of driving before the scan [s].
    sets, seed, code
        As in `load_scenario`.
    camera : bool
        Whether to make the image of the camera, too.
    replace : bool
        Whether another scan in `out` may be replaced.

    Returns
    -------
    ScanResult
        Files and arrays of the scan.

    Raises
    ------
    InputError
        Where the scenario or the folder cannot be used.
    """
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario, sets=sets, seed=seed, code=code)
    target = None if out is None else Path(out)
    folder = choose_scan_folder(
        scenario.name, scenario.seed, target, of=scan_of(scenario, at_s), replace=replace
    )
    try:
        notes: list[str] = []
        files = scan_job(scenario, folder, at_s=at_s, camera=camera, tell=notes.append)
    except InputError as error:
        remove_empty(folder)
        raise scenario.locate(error) from error
    table = next((file for file in files if file.name == "scan.npz"), None)
    data = {} if table is None else read_arrays(table, "scan", "a scan.npz")
    return ScanResult(tuple(files), data, tuple(notes))


def detect(recording: str | Path, *, sets: Sets = (), slot: str = "edge", code: bool = False) -> list[Any]:
    """Run a detector over the stored scans of a run; no world is built.

    Parameters
    ----------
    recording : str or Path
        A run folder or a run.mcap with `run.record: exact`.
    sets : mapping or sequence of str
        Another level of the slot, or parameters, such as `{"combine.edge.level": "mine.py:MyDetector"}`.
    slot : str
        A control slot of the first machine.
    code : bool
        As in `load_scenario`.

    Returns
    -------
    list of Signal
        Every sample that the slot sends, in order.

    Raises
    ------
    InputError
        Where the recording lacks what the slot reads.
    """
    from swath.tools.stored_scans import detect_stored

    texts = [f"{k}={_text(v)}" for k, v in sets.items()] if isinstance(sets, Mapping) else list(sets)
    with _allowed(code, texts):
        return detect_stored(Path(recording), texts, slot)


def run(
    scenario: str | Path | Scenario,
    out: str | Path | None = None,
    *,
    sets: Sets = (),
    seed: int | None = None,
    report: bool = True,
    progress: bool = False,
    code: bool = False,
    addresses: Sequence[str] = (),
    replace: bool = False,
) -> RunResult:
    """Run a scenario into a folder, as `swath run` does.

    Parameters
    ----------
    scenario : str, Path or Scenario
        As in `load_scenario`.
    out : str or Path
        Folder of the run, which may hold an earlier run with the same changes; by default a new folder in
        `runs`.
    sets, seed, code, addresses
        As in `load_scenario`.
    report : bool
        Whether to write report.html and replay.html.
    progress : bool
        Whether to show a bar on a terminal or in a notebook.
    replace : bool
        Whether any other run in `out` may be replaced.

    Returns
    -------
    RunResult
        Summary, exit code and folder. A limit that fails raises nothing, see `exit_code`.

    Raises
    ------
    InputError
        Where the scenario or the folder cannot be used.
    """
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario, sets=sets, seed=seed, code=code, addresses=addresses)
    else:
        _check_alone(sets, seed)
    hooks = _pages() if report and scenario.run.record != "none" else []
    target = None if out is None else Path(out)
    folder = folder_for(scenario, target, replace=replace)
    try:
        with collected_rarely():
            made = run_job(scenario, folder, progress=progress, hooks=hooks)
        return RunResult(made.summary, made.exit_code, made.folder)
    except InputError as error:
        remove_empty(folder)
        raise scenario.locate(error) from error


def branch(
    folder: str | Path,
    at_s: float,
    out: str | Path | None = None,
    *,
    sets: Sets = (),
    report: bool = True,
    progress: bool = False,
    code: bool = False,
    replace: bool = False,
) -> RunResult:
    """Go back in a finished run, change something and go on from there, as `swath branch` does.

    Parameters
    ----------
    folder : str or Path
        Folder of the earlier run.
    at_s : float
        Time of the change [s].
    out : str or Path
        Folder of the new run; by default a new folder in `runs`.
    sets : mapping or sequence of str
        What changes at that time, as in `run`.
    report, progress, code, replace
        As in `run`.

    Returns
    -------
    RunResult
        Summary, exit code and folder of the new run.

    Raises
    ------
    InputError
        Where the run cannot be continued with these changes.
    """
    from swath.tools.branch.branch import pairs, plan_branch

    texts = {k: _text(v) for k, v in sets.items()} if isinstance(sets, Mapping) else pairs(sets)
    with _allowed(code, (f"{key}={value}" for key, value in texts.items())):
        plan = plan_branch(Path(folder), at_s, texts)
        scenario = plan.scenario
        where = None if out is None else Path(out)
        target = folder_for(scenario, where, what="branch", events=plan.events, replace=replace)
        try:
            made = plan.run(target, progress=progress, report=report)
            return RunResult(made.summary, made.exit_code, made.folder)
        except InputError as error:
            remove_empty(target)
            raise scenario.locate(error) from error


def tune(
    cases: str | Path | Sequence[str | Path],
    params: Mapping[str, str | Sequence[Any]],
    out: str | Path,
    *,
    aims: Sequence[str] = ("margin",),
    prove: Sequence[str | Path] = (),
    tries: int = 60,
    each: int = 8,
    proof: int = 32,
    sets: Sets = (),
    level: str = "",
    seed: int = 1,
    workers: int = 1,
    code: bool = False,
) -> "Tuned":
    """Tune numbers and choices of a scenario in cases, as `swath tune` does.

    Parameters
    ----------
    cases : str, Path or sequence of them
        Cases by name, files or folders.
    params : mapping
        By scenario key a range, as `"2..8"`, `"2..8:whole"`, `"0.1..10:log"`, or a sequence of choices.
    out : str or Path
        Folder of the results; a tuning that was stopped goes on in it.
    aims : sequence of str
        One or two metrics; by default the margin to the limits. `"NAME:lower"` where swath does not know
        what is better.
    prove : sequence of str or Path
        Cases in which the winner is proven, instead of other conditions of `cases`.
    tries, each : int
        Settings, and runs of each.
    proof : int
        Runs of each part of the proof.
    sets, code
        As in `load_scenario`; what was shipped is what `sets` says.
    level : str
        Level of the LiDAR, as in `swath test run`.
    seed : int
        Of the draws.
    workers : int
        Processes, as in `batch`.

    Returns
    -------
    Tuned
        `verdict`, `winner` (values by key), `proofs` and `exit_code`; report.html lies in the folder.

    Raises
    ------
    InputError
        Where something cannot be tuned, or `out` holds another tuning.
    """
    from swath.core.files.place import within
    from swath.tools.function_test.case import source_of
    from swath.tools.tune.page import write_tuned
    from swath.tools.tune.parameters import as_text
    from swath.tools.tune.tune import Tune, run_tune

    some = [cases] if isinstance(cases, str | Path) else cases
    texts = [f"{k}={_text(v)}" for k, v in sets.items()] if isinstance(sets, Mapping) else list(sets)
    ranges = tuple(as_text(key, said) for key, said in params.items())
    asked = Tune(
        tuple(map(source_of, some)), ranges, tuple(aims), tuple(map(source_of, prove)), tries, each, proof,
        tuple(texts), level, seed,
    )  # fmt: skip
    choices = [f"choice={choice}" for parameter in asked.parameters for choice in parameter.choices]
    with _allowed(code, [*texts, *choices]), within(Path(out)):
        found = run_tune(Path(out), asked, workers, lambda result: None)
        write_tuned(found)
    return found


Entry = str | Path | Scenario | Mapping[str, Any]
_KEYS = ("scenario", "sets", "seed", "out")
_BAD_INPUT = 2


@dataclass(frozen=True)
class BatchRun:
    """A run of a batch.

    Attributes
    ----------
    index : int
        Index of its entry, from 0.
    entry : str, Path, Scenario or mapping
        What was given.
    folder : Path
        Folder of the run; None where the entry named none.
    found : mapping
        Summary of the run; None where there is an error.
    error : SwathError
        Why there is no result; None where there is one.
    """

    index: int
    entry: Entry
    folder: Path | None = None
    found: Mapping[str, Any] | None = None
    error: SwathError | None = None

    @property
    def summary(self) -> Mapping[str, Any]:
        """Summary as in summary.json; raises the error where there is one."""
        if self.error is not None:
            raise self.error
        return self.found or {}

    @property
    def exit_code(self) -> int:
        """0 all limits pass, 1 a limit fails, 2 there is an error, 3 a limit was not measured or judged."""
        return _BAD_INPUT if self.error is not None else exit_code_of(self.summary["expect"])


def batch(
    entries: Iterable[Entry], *, workers: int = 1, code: bool = False, processes: int | None = None
) -> Iterator[BatchRun]:
    """Run many scenarios; gives each result as soon as it and those before it are there.

    A run gives the same bytes as alone. An entry that is wrong, a part that crashes and a run that kills its
    process are the `error` of that run; the others go on. What one run has read and made serves the next:
    data sheets, compiled parts, and the field where another run has the same one.

    Parameters
    ----------
    entries : iterable
        Names, files or scenarios, or `{"scenario": ..., "sets": ..., "seed": ..., "out": ...}`, all but the
        first as in `run`. Without `out` nothing is recorded. Entries are taken as they are needed.
    workers : int
        Processes that do the work; 1 = this one. A script that gives more needs `if __name__ == "__main__":`.
    code : bool
        As in `load_scenario`.
    processes : int
        Name of `workers` in version 0.2.

    Yields
    ------
    BatchRun
        Results in the order of the entries.

    Raises
    ------
    InputError
        Where `workers` is less than 1.
    """
    workers = workers if processes is None else processes
    if workers < 1:
        raise InputError("workers", workers, "expected >= 1")
    return _done(((at, [entry]) for at, entry in enumerate(entries)), workers, code)


Chunk = tuple[int, Sequence[Any]]  # number of the first entry, entries that are done at once


def _done(chunks: Iterable[Chunk], processes: int, code: bool) -> Iterator[BatchRun]:
    """What becomes of entries, in order."""
    if processes == 1:
        return (run for found in map(_begin(code), chunks) for run in found)
    return _done_in_processes(chunks, processes, code)


def _done_in_processes(chunks: Iterable[Chunk], processes: int, code: bool) -> Iterator[BatchRun]:
    given: dict[int, Sequence[Entry]] = {}

    def jobs() -> Iterator[Chunk]:
        for at, entries in chunks:
            given[at] = entries
            yield at, [_sendable(entry) for entry in entries]

    for (at, _), found in in_workers(jobs(), partial(_begin, code), processes, in_order=True):
        entries = given.pop(at)
        if isinstance(found, Lost):
            which = f"entry {at}" if len(entries) == 1 else f"worlds {at} to {at + len(entries) - 1}"
            found = [BatchRun(at + k, "", error=SwathError(f"{which}: {found}")) for k in range(len(entries))]
        yield from (replace(run, entry=entry) for run, entry in zip(found, entries, strict=True))


Vary = Mapping[str, tuple[float, float] | Sequence[Any]]


def worlds(
    scenario: str | Path,
    *,
    n: int,
    vary: Vary | None = None,
    sets: Sets = (),
    seed: int | None = None,
    together: int = 256,
    processes: int = 1,
    code: bool = False,
) -> Iterator[BatchRun]:
    """Run n worlds of one scenario in step, unrecorded.

    Parts whose class has `together` are stepped at once (docs/explanation/kernels.md), all others world by
    world. The `entry` of a result is that world for `batch`, alone and at any level: the same bytes.

    Parameters
    ----------
    scenario : str or Path
        As in `load_scenario`.
    n : int
        Number of worlds.
    vary : mapping
        Key -> (least, greatest), drawn uniformly for each world, or a list of values that worlds take in
        turn.
    sets : mapping or sequence of str
        Changes of all worlds, as in `run`.
    seed : int
        Seed of world 0, by default the scenario's; world i has seed + i.
    together : int
        Number of worlds that go in step at a time.
    processes : int
        Processes that do the work, as `workers` of `batch`.
    code : bool
        As in `load_scenario`.

    Yields
    ------
    BatchRun
        Results in the order of the worlds.

    Raises
    ------
    InputError
        Where a number is less than 1, or the scenario cannot be used.
    """
    from swath.tools.branch.branch import pairs

    for name, value in (("n", n), ("together", together), ("processes", processes)):
        if value < 1:
            raise InputError(name, value, "expected >= 1")
    texts = {k: _text(v) for k, v in sets.items()} if isinstance(sets, Mapping) else pairs(sets)
    first = load_scenario(scenario, sets=texts, seed=seed, code=code).seed
    entries = (
        {"scenario": scenario, "sets": {**texts, **_varied(vary or {}, first, i)}, "seed": first + i}
        for i in range(n)
    )
    chunks = ((at, list(islice(entries, together))) for at in range(0, n, together))
    return _done(chunks, processes, code)


def _varied(vary: Vary, seed: int, world: int) -> dict[str, Any]:
    """What a world has of the keys that vary."""
    found: dict[str, Any] = {}
    for key, of in vary.items():
        if isinstance(of, tuple):
            if len(of) != 2 or not all(isinstance(v, int | float) for v in of):
                raise InputError(f"vary.{key}", list(of), "expected (least, greatest), or a list of values")
            found[key] = float(Stream(seed, f"vary {key}").at(world).uniform(*of))
        elif len(of):
            found[key] = of[world % len(of)]
        else:
            raise InputError(f"vary.{key}", [], "expected (least, greatest), or a list of values")
    return found


def _begin(code: bool) -> Callable[[Chunk], list[BatchRun]]:
    """What a process does with each chunk."""
    return partial(_run_entries, KeptFields(), code)


def _run_entries(fields: KeptFields, code: bool, chunk: Chunk) -> list[BatchRun]:
    """Entries in this process, several of them in step."""
    first, entries = chunk
    folders: dict[int, Path] = {}

    def alone(job: tuple[int, Any]) -> dict[str, Any]:
        scenario, out = _scenario_of(job[1], code)
        try:
            if out is None:
                return run_unrecorded(scenario, fields)
            folder = folder_for(scenario, Path(out))
            folders[job[0]] = folder
            return run_job(scenario, folder, fields=fields).summary
        except InputError as error:
            raise scenario.locate(error) from error

    ends = run_each([*enumerate(entries)], lambda job: (_scenario_of(job[1], code)[0], ()), alone)
    found = {k: ended for k, ended, _ in ends}
    return [
        BatchRun(first + k, entry, folders.get(k), None, ended)
        if isinstance(ended := found[k], SwathError)
        else BatchRun(first + k, entry, folders.get(k), ended)
        for k, entry in enumerate(entries)
    ]


@dataclass(frozen=True)
class _Read:
    """A scenario that was read, for another process, which may not know the classes of a user's parts."""

    plain: Mapping[str, Any]
    file: Path | None
    gate: Gate


def _sendable(entry: Any) -> Any:
    if isinstance(entry, Scenario):
        return _Read(entry.plain(), entry.file, entry.gate)
    if isinstance(entry, Mapping):
        return {key: _sendable(value) if key == "scenario" else value for key, value in entry.items()}
    return entry


def _scenario_of(entry: Any, code: bool) -> tuple[Scenario, Any]:
    """The scenario of an entry, and its folder. Raises InputError."""
    given = entry if isinstance(entry, Mapping) else {"scenario": entry}
    for key in given:
        if key not in _KEYS:
            raise InputError(f"entry.{key}", None, unknown_key(key, _KEYS))
    if "scenario" not in given:
        raise InputError("entry.scenario", None, "expected a name, a file or a scenario, the key is missing")
    source, sets, seed = given["scenario"], given.get("sets", ()), given.get("seed")
    if isinstance(source, _Read):
        with through(source.gate):
            source = read_scenario(Document(dict(source.plain), source.file))
    if isinstance(source, Scenario):
        _check_alone(sets, seed)
        return source, given.get("out")
    return load_scenario(source, sets=sets, seed=seed, code=code), given.get("out")


def _pages() -> list[Any]:
    """What writes the pages of a run."""
    from swath.replay.writer import ReplayWriter
    from swath.report.report import ReportWriter

    return [ReportWriter(), ReplayWriter()]


def _check_alone(sets: Sets, seed: int | None) -> None:
    if sets or seed is not None:
        raise InputError("sets", None, "expected with a name or a file; give them to load_scenario instead")
