"""swath from Python: what `import swath` offers. A script or a notebook needs nothing else.

import swath

result = swath.run("straight", "runs/slow", sets={"combine.speed.speed_kmh": 5})
result.summary["lateral_rms_m"], result.exit_code, result.folder
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.foreign_code import only_code
from swath.core.registry import level_here
from swath.documents.packed import read_arrays
from swath.field_io.folder import FieldFolder
from swath.field_io.folder import read as read_folder
from swath.replay.writer import ReplayWriter
from swath.report.notebook import picture, run_html
from swath.report.report import ReportWriter
from swath.runtime.folder import choose_run_folder, choose_scan_folder, remove_empty
from swath.runtime.job import JobResult, run_job
from swath.scenario.scenario import Scenario
from swath.scenario.scenario import load_scenario as _load
from swath.tools.scan.scan import scan_job

Sets = Mapping[str, Any] | Sequence[str]


def load_scenario(
    source: str | Path, *, sets: Sets = (), seed: int | None = None, code: bool = True
) -> Scenario:
    """A bundled scenario by name, a file, or the scenario of a run folder, with changes.

    sets: {"combine.speed.speed_kmh": 5}, or texts as after `--set`; a text is read as there
    seed: instead of the scenario's
    code: False refuses Python files and FMUs that it names; reading a Python file runs it (SECURITY.md)
    Raises swath.core.errors.InputError, which names key, value, what was expected, file and line.
    """
    texts = [f"{k}={_text(v)}" for k, v in sets.items()] if isinstance(sets, Mapping) else list(sets)
    with nullcontext() if code else only_code(()):
        return _load(source, sets=texts, flags={} if seed is None else {"seed": f"seed={seed}"})


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
    """One scan. files: what was written; data: the arrays of scan.npz by name."""

    files: tuple[Path, ...]
    data: Mapping[str, Any]

    def _repr_html_(self) -> str:
        return "".join(picture(file.read_bytes()) for file in self.files if file.suffix == ".png")


def read_field(path: str | Path) -> FieldFolder:
    """A field folder, as `swath field import` makes one; a notebook shows its overview."""
    return read_folder(path)


def scan(
    scenario: str | Path | Scenario,
    out: str | Path | None = None,
    *,
    at_s: float = 0.0,
    sets: Sets = (),
    seed: int | None = None,
    camera: bool = False,
) -> ScanResult:
    """One scan of a scenario after `at_s` of driving, as `swath scan` makes it.

    out: default: a new folder in `runs`; sets, seed: as in `load_scenario`; camera: the image too
    Raises InputError.
    """
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario, sets=sets, seed=seed)
    folder = choose_scan_folder(scenario.name, scenario.seed, None if out is None else Path(out))
    try:
        files = scan_job(scenario, folder, at_s=at_s, camera=camera)
    except InputError as error:
        remove_empty(folder)
        raise scenario.locate(error) from error
    table = next((file for file in files if file.name == "scan.npz"), None)
    data = {} if table is None else read_arrays(table, "scan", "a scan.npz")
    return ScanResult(tuple(files), data)


def run(
    scenario: str | Path | Scenario,
    out: str | Path | None = None,
    *,
    sets: Sets = (),
    seed: int | None = None,
    report: bool = True,
    progress: bool = False,
    code: bool = True,
) -> RunResult:
    """Run a scenario into a folder, as `swath run` does; a given one may hold an earlier run of it.

    out: default: a new folder in `runs`; sets, seed, code: as in `load_scenario`; report: write report.html
    and replay.html; progress: a bar on a terminal or in a notebook
    Raises InputError; a limit that fails raises nothing, see `exit_code`.
    """
    with nullcontext() if code else only_code(()):
        if not isinstance(scenario, Scenario):
            scenario = load_scenario(scenario, sets=sets, seed=seed)
        elif sets or seed is not None:
            expected = "expected with a name or a file; give them to load_scenario instead"
            raise InputError("sets", None, expected)
        hooks = [ReportWriter(), ReplayWriter()] if report and scenario.run.record != "none" else []
        folder = choose_run_folder(scenario.name, scenario.seed, None if out is None else Path(out))
        try:
            made = run_job(scenario, folder, progress=progress, hooks=hooks)
            return RunResult(made.summary, made.exit_code, made.folder)
        except InputError as error:
            remove_empty(folder)
            raise scenario.locate(error) from error
