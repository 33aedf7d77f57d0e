"""A finished run gone back in: another run that is the same up to a time, and has something changed there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.foreign_code import code_in, file_of, only_code
from swath.core.number_text import num
from swath.core.schedule import NS
from swath.documents.yaml_document import parse_value
from swath.judge.summary import read_summary
from swath.replay.writer import ReplayWriter
from swath.report.report import ReportWriter
from swath.runtime.branch import Start, branched_events
from swath.runtime.changes import after_change, read_events
from swath.runtime.folder import check_run_folder
from swath.runtime.hooks import RunHook
from swath.runtime.job import JobResult, run_job
from swath.runtime.saves import EVERY_S, Saves, is_readable, saves_in
from swath.scenario.scenario import Scenario, code_of, load_scenario

OUTSIDE = ("ros2", "twist", "ackermann", "can")  # levels whose state another process or box keeps


@dataclass(frozen=True)
class PlannedBranch:
    """start: where it branches off; events: all changes of the new run; saved_s: time of the save from which
    it goes on, 0 where it has to begin at the start [s]; has_unreadable: it has saves of another version.
    """

    scenario: Scenario
    start: Start
    events: Sequence[Mapping[str, Any]]
    saved_s: float
    allow: Sequence[str] = ()
    has_unreadable: bool = False

    def run(
        self,
        out: Path,
        *,
        progress: bool = False,
        report: bool = True,
        replay: bool = True,
        save_every_s: float | None = None,
    ) -> JobResult:
        """Make the run. report: with its pages, replay: replay.html among them.

        save_every_s: 0 = without saves, None = with them where the earlier one has some
        """
        if save_every_s is None:
            save_every_s = EVERY_S if saves_in(self.start.folder) else 0.0
        pages: list[RunHook] = [ReportWriter(), *([ReplayWriter()] if replay else [])] if report else []
        hooks = [*pages, *([Saves(save_every_s)] if save_every_s else [])]
        return run_job(
            self.scenario,
            out,
            progress=progress,
            events=self.events,
            hooks=hooks,
            allow=self.allow,
            start=self.start,
        )


def plan_branch(run: Path, at_s: float, sets: Mapping[str, Any], allow: Sequence[str] = ()) -> PlannedBranch:
    """What to run. sets: keys and values as after `--set`; allow: as of `swath run`. InputError."""
    check_run_folder(run, "scenario.yaml", "summary.json")
    summary = read_summary(run / "summary.json")
    scenario, events = load_scenario(run / "scenario.yaml"), read_events(run)
    end_s = summary.get("simulated_s")
    if not isinstance(end_s, int | float):
        raise InputError("RUN", str(run), "expected a summary.json with simulated_s")
    if not 0.0 < at_s <= end_s:
        raise InputError("--at-s", at_s, f"expected a time of the run, above 0 and up to {num(end_s)} s")
    _check_repeats(scenario, summary)
    allow = [*allow, *code_in([parse_value(str(value), key) for key, value in sets.items()])]
    with only_code((*code_of(scenario), *map(file_of, allow))):
        changed = scenario
        for event in branched_events(events, at_s, sets):
            changed = after_change(changed, event["set"], event["value"])
    start = Start(run, round(at_s * NS))
    saves = {t: is_readable(file) for t, file in saves_in(run).items() if t < start.at}
    new = branched_events(events, at_s, sets)
    saved = max((t for t, is_good in saves.items() if is_good), default=0)
    return PlannedBranch(scenario, start, new, saved / NS, tuple(allow), not all(saves.values()))


def pairs(texts: Sequence[str]) -> dict[str, str]:
    """Keys and values of texts as after `--set`. InputError."""
    found = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals:
            raise InputError(f"--set {text}", None, "expected KEY=VALUE")
        found[key.strip()] = value
    return found


def _check_repeats(scenario: Scenario, summary: Mapping[str, Any]) -> None:
    """A run that would not come to the same moment again has none to go back to."""
    if "realtime" in summary:
        expected = "expected a run without --real-time: at the pace of real time none repeats"
        raise InputError("RUN", scenario.name, expected)
    for machine in scenario.machines.values():
        for slot, choice in machine.slots.items():
            if choice.level in OUTSIDE:
                expected = "expected parts of this process, the state of this one cannot be saved"
                raise InputError(f"{machine.name}.{slot}.level", choice.level, expected)
