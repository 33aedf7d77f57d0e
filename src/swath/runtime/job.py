"""Jobs: a scenario driven into a folder, from assembly or a saved moment of an earlier run to its summary."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from swath import __version__
from swath.core.abilities import DISTANCE, OTHER, STOPPED, TIME, Ending, ReadsFiles
from swath.core.errors import InputError, SwathError
from swath.core.files.whole_file import write_whole
from swath.core.foreign_code import through
from swath.core.graph import Observer
from swath.core.number_text import num
from swath.core.packed_state import UnpackableState
from swath.core.process.stopping import stoppable, unstopped
from swath.core.schedule import NS
from swath.documents.contents import hashes
from swath.judge.evaluation import Evaluation
from swath.judge.limits import exit_code_of
from swath.judge.summary import make_summary, write_summary
from swath.judge.windows import FIELD
from swath.record.digest import Digest
from swath.record.recorder import Recorder
from swath.runtime.assembly import assemble
from swath.runtime.branch import Branch, Start
from swath.runtime.changes import Interventions, Restart, Script
from swath.runtime.credibility import Credibility, annotate
from swath.runtime.evaluation import make_evaluation
from swath.runtime.folder import occupied
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.inputs import SUMMARY as INPUTS
from swath.runtime.inputs import inputs_of
from swath.runtime.kept import KeptFields
from swath.runtime.loop import Progress, drive, driven_m, has_arrived
from swath.runtime.pacing import Pacer, make_pacer, paced
from swath.runtime.saves import read_save, saved_before
from swath.runtime.unused import unused
from swath.runtime.world import ASKED_BY, World
from swath.scenario.scenario import Scenario
from swath.terminal.outcome import NOT_JUDGED, result_of


class UnusableSave(SwathError):
    """A save turned out not to fit after it was taken over: the run has to begin at the start."""


@dataclass(frozen=True)
class Resumed:
    """Brings a run to a saved moment. The run has been assembled, and nothing has seen it yet."""

    world: World
    digest: Digest
    evaluation: Evaluation
    recorder: Recorder
    changes: Interventions

    def load(self, start: Start, events: Sequence[Mapping[str, Any]]) -> int:
        """Load the newest save before the branch; 0 where there is none. Returns how many events it holds.

        UnusableSave.
        """
        for data in saved_before(start.folder, start.at) if start.saves else ():
            try:
                state = read_save(data, start.folder, self.evaluation.shared)
            except UnpackableState:
                continue
            done = len(state["events"])
            if list(events[:done]) == state["events"]:
                self._take(state, start.folder)
                return done
        return 0

    def _take(self, state: Mapping[str, Any], folder: Path) -> None:
        try:
            self.world.reset()
            for event in state["events"]:
                self.changes.set(round(event["t_s"] * NS), event["set"], event["value"])
            self.world.load(state["world"])
            self.digest.load(state["digest"])
            self.evaluation.load(state["evaluation"])
            self.recorder.load(state["recorder"], folder)
        except (SwathError, LookupError, TypeError, ValueError, AttributeError) as error:
            raise UnusableSave(f"a save of {folder} does not fit ({error})") from error


CHANGED = "# changed on the way: swath run THIS --events THIS repeats it, THIS being the folder of the run\n"


@dataclass(frozen=True)
class JobResult:
    """A finished run.

    Attributes
    ----------
    summary : dict
        As in summary.json.
    exit_code : int
        0 all limits pass, 1 a limit fails, 3 none fails but one was not measured or not judged.
    folder : Path
        Folder of the run.
    """

    summary: dict[str, Any]
    exit_code: int
    folder: Path

    def __repr__(self) -> str:
        results = [result_of(entry) for entry in self.summary.get("expect", [])]
        limits = f"{results.count('pass')} of {len(results)} limits pass" if results else "no limits"
        for what in ("not measured", NOT_JUDGED):
            limits += f", {results.count(what)} {what}" if what in results else ""
        name, seed = self.summary.get("name"), self.summary.get("seed")
        return f"<run of {name}, seed {seed}: {limits}, in {self.folder}>"


def run_job(
    scenario: Scenario,
    out: Path,
    *,
    progress: bool = False,
    events: Sequence[Mapping[str, Any]] = (),
    hooks: Sequence[RunHook] = (),
    begun: Callable[[], None] | None = None,
    allow: Sequence[str] = (),
    fields: KeptFields | None = None,
    start: Start | None = None,
) -> JobResult:
    """Run a scenario into a folder.

    events: changes on the way, as an earlier run's summary.json has them; hooks: go along, in this order
    begun: called once the world is assembled, before the first tick
    allow: code that changes on the way may name beside the scenario's own, as `file.py:Class` or an FMU
    fields: of runs before, of which this one may have the same
    start: the run branches off from an earlier one, whose events before that time are among `events`

    The folder appears only once the world is assembled, so bad input leaves nothing behind. Ctrl-C, SIGTERM
    and crashes leave a valid folder marked incomplete; the exception goes on.
    """
    with stoppable():
        while True:
            try:
                summary = _run_once(scenario, out, progress, events, hooks, begun, allow, fields, start)
            except Branch as branch:
                out, events, start, begun = branch.out, branch.events, branch.start, None
            except (Restart, UnusableSave):
                begun, start = None, None if start is None else replace(start, saves=False)
            else:
                return JobResult(summary, exit_code_of(summary["expect"]), out)


def run_unrecorded(
    scenario: Scenario, fields: KeptFields | None = None, *, hooks: Sequence[RunHook] = ()
) -> dict[str, Any]:
    """Run a scenario without a folder; returns what summary.json would hold. The rest is as in `run_job`."""
    with stoppable():
        return _run_once(scenario, None, hooks=hooks, fields=fields)


def _run_once(
    scenario: Scenario,
    out: Path | None,
    progress: bool = False,
    events: Sequence[Mapping[str, Any]] = (),
    hooks: Sequence[RunHook] = (),
    begun: Callable[[], None] | None = None,
    allow: Sequence[str] = (),
    fields: KeptFields | None = None,
    start: Start | None = None,
) -> dict[str, Any]:
    world = assemble(scenario, fields=fields)
    try:
        pacer = make_pacer(world)
        world.open_devices()
        with ExitStack() as around:
            with unstopped():  # a folder is never there without what writes its summary
                around.enter_context(_folder(out, world, is_changed=bool(events)))
                running = Running(world, out, pacer, hooks, allow)
                if start is not None:
                    running.resume(start, events)
                around.enter_context(running)
            if begun is not None:
                begun()
            is_resumed = world.graph.t > 0
            try:
                return _drive(running, progress, events)
            except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
                if not is_resumed:
                    raise
                raise UnusableSave(f"a run from a save failed ({error})") from error
    finally:
        world.close()
        world.graph.let_go()


def _drive(running: "Running", progress: bool, events: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Drive to the end and finish; returns the summary."""
    world = running.world
    with _progress_bar(world, progress) as show, running.recorder, paced(world.graph, running.pacer):
        running.begin(events)
        drive(world, running.observers, progress=show, resume=world.graph.t > 0)
    world.close()
    return running.finish(incomplete=False)


def unheard(world: World) -> list[str]:
    """Notes on settings that no part takes, and no device passes on."""
    taken = {source for node in world.graph.nodes for source, _ in node.wires.values()}
    slots = [f"{m.name}.{slot}" for m in world.machines.values() for slot in m.slots_of("settings")]
    unread = [] if world.devices else [slot for slot in slots if slot not in taken]
    return [f"{slot}: no part takes these settings, level organs of process does" for slot in unread]


def _grid(world: World) -> dict[str, Any]:
    """`map_grid`: how the world's axes lie on Earth, where its place there is known."""
    origin = next((m.origin for m in world.machines.values()), None)
    return {} if origin is None else {"map_grid": origin.grid()}


def _machines(world: World) -> str:
    """The data sheet of the machine, or of each by its name."""
    names = {name: machine.sheet.name for name, machine in world.machines.items()}
    if len(names) == 1:
        return world.leader.sheet.name
    return "; ".join(f"{name}: {sheet}" for name, sheet in names.items())


@contextmanager
def _folder(out: Path | None, world: World, *, is_changed: bool) -> Iterator[None]:
    """Inside the block the run has the folder, with its scenario in it.

    is_changed: the run has changes on its way, which a scenario does not hold
    """
    if out is None:
        yield
        return
    _spare_what_is_read(world, out)
    with occupied(out, world.scenario.name):
        write_whole(out / "scenario.yaml", (CHANGED if is_changed else "") + world.scenario.resolved())
        yield


def _spare_what_is_read(world: World, out: Path) -> None:
    """A run must not be written over the recording that it plays."""
    for machine in world.machines.values():
        for part in machine.parts.values():
            for file in part.reads if isinstance(part, ReadsFiles) else ():
                if file.resolve().parent == out.resolve():
                    raise InputError(
                        "--out", str(out), f"expected another folder, {file.name} in it is played"
                    )


class Running:
    """What goes along while a world runs: digest, evaluation, recorder, hooks.

    An exception that ends a block with it marks the run as incomplete, where it is not finished.
    """

    def __init__(
        self,
        world: World,
        out: Path | None,
        pacer: Pacer | None,
        hooks: Sequence[RunHook],
        allow: Sequence[str],
    ) -> None:
        self.world, self.out, self.pacer, self.hooks = world, out, pacer, hooks
        recorded = world.recorded(is_drawn=out is not None)
        record = world.scenario.run.record
        detail = "none" if out is None else record
        self.digest = Digest()
        self.evaluation = make_evaluation(world)
        self.changes = Interventions(world, allow)
        has_all = detail != "none" or any(hook.READS_TRACKS for hook in hooks)
        read = self.evaluation.read_columns
        self.recorder = Recorder(
            out or Path(),
            list(recorded.values()),
            extra={name: self.evaluation.columns(name) for name in recorded},
            only=None if has_all else read,
            detail=detail,
            scenario="" if out is None else world.scenario.resolved(),
        )
        self.observers: list[Observer] = [self.digest, self.evaluation]
        self.has_tracks = has_all or bool(read)
        if self.has_tracks:
            self.observers.append(self.recorder)
        self.start: Start | None = None
        self._saved_s, self._done = 0.0, 0  # time of the save it goes on from, events before
        self._begun: list[RunHook] = []
        self._started, self._is_finished = time.perf_counter(), False

    def __enter__(self) -> "Running":
        return self

    def __exit__(self, kind: type[BaseException] | None, *about: object) -> None:
        if kind is not None and not self._is_finished:
            with suppress(OSError):  # on a full disk the first error says what matters
                self.finish(incomplete=True)

    def resume(self, start: Start, events: Sequence[Mapping[str, Any]]) -> None:
        """Go on from the newest save before `start`, if there is one. UnusableSave."""
        self.start = start
        resumed = Resumed(self.world, self.digest, self.evaluation, self.recorder, self.changes)
        try:
            self._done = resumed.load(start, events)
        except BaseException:
            self.recorder.close()
            raise
        self._saved_s = self.world.graph.t / NS

    def begin(self, events: Sequence[Mapping[str, Any]]) -> None:
        """Let hooks and changes come."""
        self._started = time.perf_counter()
        rest = self.pacer.rest if self.pacer is not None else lambda duration: None
        for hook in self.hooks:
            hook.begin(
                ActiveRun(
                    self.world,
                    self.out,
                    self.recorder,
                    self.evaluation,
                    self.observers,
                    self.changes,
                    rest,
                    self.digest,
                    self.start,
                )
            )
            self._begun.append(hook)
        self.world.before_asking.append(self.recorder.write_waiting)
        if self.pacer is not None:
            self.recorder.defer()
            self.pacer.deferred = self.recorder.write_next
        if events:
            self.world.graph.before_tick.append(Script(self.changes, events[self._done :]))

    def finish(self, *, incomplete: bool) -> dict[str, Any]:
        """Judge, write summary.json, let the hooks that have begun finish; returns the summary.

        A stop waits until the summary is written.
        """
        with unstopped():
            self._is_finished = True
            self.recorder.close()
            summary = self._summary(time.perf_counter() - self._started, incomplete)
            if self.out is not None:
                write_summary(self.out, summary)
        for hook in self._begun:
            hook.finish(summary)
        return summary

    def _summary(self, wall_s: float, incomplete: bool) -> dict[str, Any]:
        world, scenario = self.world, self.world.scenario
        summary = make_summary(
            {
                "name": scenario.name,
                "summary": scenario.summary + ("; changed on its way" if self.changes.events else ""),
                "seed": scenario.seed,
                "swath": __version__,
                "machine": _machines(world),
                **_grid(world),
            },
            self.evaluation,
            dict(self.recorder.tracks) if self.has_tracks else {},
            sensors={name: machine.coverage() for name, machine in world.machines.items()},
            simulated_s=world.graph.t / NS,
            wall_s=wall_s,
            ray_count=sum(m.ray_count for m in world.machines.values()),
            digest=self.digest.hex,
            incomplete=incomplete,
            cost={n.slot.name: (n.cost_s, n.step_count) for n in world.graph.nodes},
        )
        notes = world.field.notes
        notes += [note for machine in world.machines.values() for note in machine.notes]
        notes += [*unheard(world), *unused(world), *self.evaluation.notes()]
        notes += [f"expect.{e.former}: it is called {e.name}" for e in world.scenario.expect if e.former]
        if asked_by := world.asked_by:
            summary[ASKED_BY] = asked_by
        with through(scenario.gate):
            if files := hashes(scenario.plain()):
                summary["files"] = files
        if (watch := self.evaluation.find(FIELD, Credibility)) is not None:
            notes += annotate(summary, watch, self.evaluation.catalogue)
        if self.out is not None and (inputs := inputs_of(world, self.evaluation)):
            summary[INPUTS] = inputs
        if world.devices:
            summary["devices"] = {device.setup.name: device.summary() for device in world.devices}
            notes += [note for device in world.devices for note in device.notes]
        summary["ended"] = ended = _ended(world, incomplete=incomplete)
        notes += [ended["text"]] if ended["text"] else []
        if (weather := world.field.weather) is not None:
            notes += [said for said in weather.beyond(world.graph.t) if said not in notes]
        if self.pacer is not None:
            summary["realtime"] = self.pacer.report()
            notes += self.pacer.notes
        if left_out := self.recorder.left_out:
            notes.append(f"thinned: in run.mcap these have no message: {left_out}; all are there bit for bit")
        if notes:
            summary["notes"] = notes
        if self.changes.events:
            summary["events"] = self.changes.events
        if self.start is not None:
            summary |= self.start.entry(self._saved_s)
        for hook in self._begun:
            summary |= hook.summarize(world.graph.t)
        return summary


def _ended(world: World, *, incomplete: bool) -> dict[str, str]:
    """Why a run ended: `reason`, one of ENDINGS; `text`, a note where its distance was not driven."""
    run, why = world.scenario.run, world.graph.ended
    if why:
        kind = why.kind if isinstance(why, Ending) else OTHER
        return {"reason": kind, "text": f"the run ended at {num(world.graph.t / NS, places=2)} s: {why}"}
    if incomplete or has_arrived(world):
        return {"reason": STOPPED if incomplete else DISTANCE, "text": ""}
    what = f"the run ended at max_duration_s = {num(run.max_duration_s)}"
    return {"reason": TIME, "text": f"{what}, after {num(driven_m(world))} of {num(run.distance_m)} m"}


@contextmanager
def _progress_bar(world: World, wanted: bool) -> Iterator[Progress | None]:
    """A rich bar over the driven distance, on stderr; nothing where there is no terminal."""
    if not wanted:
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    if not (console.is_terminal or console.is_jupyter):
        yield None
        return
    text, at = TextColumn("{task.description}"), TextColumn("{task.fields[at]}")
    with Bar(text, BarColumn(), at, TimeRemainingColumn(), console=console, transient=True) as bar:
        run = world.scenario.run
        task = bar.add_task(world.scenario.name, total=run.distance_m, at="")
        yield lambda driven, t: bar.update(
            task, completed=driven, at=f"{num(driven)} m, {num(t)} s simulated"
        )
