"""swath from Python: what `import swath` offers. A script or a notebook needs nothing else.

import swath

result = swath.run("straight", "runs/slow", sets={"combine.speed.speed_kmh": 5})
result.summary["lateral_rms_m"], result.exit_code, result.folder
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.foreign_code import only_code
from swath.replay.writer import ReplayWriter
from swath.report.report import ReportWriter
from swath.runtime.folder import choose_run_folder, remove_empty
from swath.runtime.job import JobResult, run_job
from swath.scenario.scenario import Scenario
from swath.scenario.scenario import load_scenario as _load

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
    if isinstance(value, str | Path):
        return str(value)
    return json.dumps(value, default=lambda v: v.tolist() if hasattr(v, "tolist") else str(v))


def run(
    scenario: str | Path | Scenario,
    out: str | Path | None = None,
    *,
    sets: Sets = (),
    seed: int | None = None,
    report: bool = True,
    progress: bool = False,
    code: bool = True,
) -> JobResult:
    """Run a scenario into a folder, as `swath run` does; a given one may hold an earlier run of it.

    out: default: a new folder in `runs`; sets, seed, code: as in `load_scenario`; report: write report.html
    and replay.html; progress: a bar on a terminal
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
            return run_job(scenario, folder, progress=progress, hooks=hooks)
        except InputError as error:
            remove_empty(folder)
            raise scenario.locate(error) from error
