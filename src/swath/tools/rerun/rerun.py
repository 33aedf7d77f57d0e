"""A recorded run made again, with recorded signals in the place of some of its slots."""

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.files.output_folder import check_free
from swath.core.files.temporary import TemporaryFolder
from swath.core.foreign_code import code_unread
from swath.judge.summary import read_summary
from swath.record.read.feed import own_outputs
from swath.record.read.files import Log, open_log
from swath.report.report import FinishedRun, ReportWriter
from swath.runtime.changes import read_events
from swath.runtime.folder import check_run_folder
from swath.runtime.hooks import RunHook
from swath.runtime.job import JobResult, run_job
from swath.scenario.overrides import layered
from swath.scenario.scenario import Scenario, load_scenario, parse_scenario, slot_names
from swath.scenario.slots import kind_of
from swath.tools.rerun.comparison import RecordingComparison

SENSING = "swath.sensing."


@dataclass(frozen=True)
class Rerun:
    """log: the recording; played: slots (full names) that play it.

    scenario: the recorded one, with these slots set to the level `log`
    """

    log: Log
    scenario: Scenario
    played: tuple[str, ...]

    def run(self, out: Path, *, progress: bool = False, report: bool = True) -> JobResult:
        """Make the run; summary.json says under `rerun` which of the other slots came out the same."""
        comparison = RecordingComparison(
            self.log,
            [s for s in slot_names(self.scenario) if s not in self.played],
            played=self.played,
        )
        hooks: list[RunHook] = [comparison, *([ReportWriter()] if report else [])]
        return run_job(self.scenario, out, progress=progress, events=self.events, hooks=hooks)

    @property
    def events(self) -> list[dict[str, Any]]:
        """What was changed while it was recorded, but for the slots that play the log."""
        folder = self.log.path.parent
        events = read_events(folder) if os.path.isfile(folder / "summary.json") else []
        return [e for e in events if ".".join(str(e["set"]).split(".")[:2]) not in self.played]


def draw_report(folder: Path) -> Path:
    """Write report.html of a run that was stopped before it had one, and return its path.

    Its recording is played: all slots but the header, which cuts the field anew. Of a run that was killed, so
    has no summary, the page shows what the recording holds, and says so. InputError where that is not every
    sample.
    """
    check_run_folder(folder)
    check_free(folder)
    file = folder / "summary.json"
    summary = read_summary(file, "run") if os.path.isfile(file) else None
    plan = plan_rerun(folder, slots=None, sets=["run.record=standard"], is_all=True)
    with code_unread():
        writer = ReportWriter(of=FinishedRun(folder, summary, recorded_scenario(plan.log, folder, ())))
    with TemporaryFolder("report") as aside:
        run_job(plan.scenario, aside / "run", hooks=[writer])
    return folder / "report.html"


def plan_rerun(
    source: Path,
    *,
    slots: Sequence[str] | None = None,
    sets: Sequence[str] = (),
    seed: int | None = None,
    is_all: bool = False,
) -> Rerun:
    """What to run for a run folder or a run.mcap.

    slots: `combine.lidar`, or `lidar` in every machine; None = the sensors and the motion that carried them,
    with `is_all` everything but the header
    sets, seed: changes to the scenario, as of `swath run`. InputError where the source or a slot will not do
    """
    log = open_log(source)
    with code_unread():
        recorded = recorded_scenario(log, source, ())
    recorded_outputs = {s: own_outputs(log, s) for s in slot_names(recorded)}
    exact = [s for s, outputs in recorded_outputs.items() if any(outputs.values())]
    if not exact:
        held = "expected a run.mcap of swath with every sample (run.record: exact), it has messages only"
        raise InputError("recording", log.path.name, held, file=log.path)
    played = _named(slots, exact) if slots is not None else _default_slots(exact, is_all)
    changes = [f"{slot}={_entry(recorded, slot, log.path)}" for slot in played]
    flags = {f"--seed {seed}": f"seed={seed}"} if seed is not None else {}
    return Rerun(log, recorded_scenario(log, source, layered(changes, sets), flags), tuple(played))


def recorded_scenario(
    log: Log, source: Path, sets: Sequence[str], flags: dict[str, str] | None = None
) -> Scenario:
    """The scenario beside the recording, or the one within it."""
    for folder in (source, log.path.parent):
        if os.path.isfile(folder / "scenario.yaml"):
            return load_scenario(folder / "scenario.yaml", sets=sets, flags=flags)
    stored = log.attachment("scenario.yaml")
    if stored is None:
        expected = "expected a recording of swath; for any other, make a scenario with level: log"
        raise InputError("recording", log.path.name, expected, file=log.path)
    try:
        text = stored.decode()
    except UnicodeDecodeError:
        expected = "expected its scenario.yaml in UTF-8"
        raise InputError("recording", log.path.name, expected, file=log.path) from None
    more = [f"{change}" for change in (flags or {}).values()]
    return parse_scenario(text, base=log.path.resolve().parent, sets=[*sets, *more])


def _default_slots(exact: Sequence[str], is_all: bool) -> list[str]:
    """Sensors, and the motion: with another path under it, what the sensors saw would be out of place."""

    def is_played(slot: str) -> bool:
        kind = kind_of(slot.rpartition(".")[2])
        if is_all:
            return kind is not None and kind.name != "header"
        is_sensor = kind is not None and not kind.is_control and kind.packages[0].startswith(SENSING)
        return is_sensor or (kind is not None and kind.name == "motion")

    return [s for s in exact if is_played(s)]


def _named(slots: Sequence[str], exact: Sequence[str]) -> list[str]:
    chosen = [s for s in exact if any(name in (s, s.rpartition(".")[2]) for name in slots)]
    for name in slots:
        if not any(name in (s, s.rpartition(".")[2]) for s in exact):
            raise InputError("--slots", name, f"expected some of {', '.join(exact)}")
    return chosen


def _entry(recorded: Scenario, slot: str, file: Path) -> str:
    """The scenario section of a slot that plays the log at the rate at which it was recorded."""
    machine, _, name = slot.partition(".")
    choice = recorded.machines[machine].slots[name]
    common, overlap = choice.common, getattr(choice.params, "overlap_m", 0.0)
    about = {"rate_hz": common.rate_hz, "offset_ms": common.offset_ms, "latch": common.latch}
    if overlap:
        about["overlap_m"] = overlap
    return json.dumps({"level": "log", "file": str(file.resolve()), **about})
