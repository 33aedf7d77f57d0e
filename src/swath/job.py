"""Jobs: what the command line does with a scenario, from reading to the finished folder."""

import dataclasses
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from swath import __version__
from swath.core.errors import InputError
from swath.core.graph import Observer
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.signals import F64, Image, MachineState, Scan, ScanTruth
from swath.link.realtime import Pacer, make_pacer, paced
from swath.sim.defaults import default_lines
from swath.sim.digest import Digest
from swath.sim.interventions import Interventions, Restart, Script
from swath.sim.loop import Progress, drive
from swath.sim.record import Recorder
from swath.sim.runfolder import clear_run_folder
from swath.sim.scenario import Scenario
from swath.sim.world import World, assemble
from swath.study.converge import Settling
from swath.study.metrics import is_broken
from swath.study.referee import Referee
from swath.study.summary import make_summary, write_summary
from swath.view.keep import ScanKeeper


@dataclass(frozen=True)
class JobResult:
    """summary: as in summary.json; exit_code: 0 limits kept, 1 a limit broken; folder of the run."""

    summary: dict[str, Any]
    exit_code: int
    folder: Path

    def __repr__(self) -> str:
        verdicts = [entry["verdict"] for entry in self.summary.get("expect", {}).values()]
        limits = f"{verdicts.count('kept')} of {len(verdicts)} limits kept" if verdicts else "no limits"
        name, seed = self.summary.get("name"), self.summary.get("seed")
        return f"<run of {name}, seed {seed}: {limits}, in {self.folder}>"


class Companion(Protocol):
    """Somebody who goes along with a run: shows it elsewhere, acts on it.

    join: before the start, again when the run begins anew; rest: to be told how long a pause was [ns]
    leave: what summary.json is to say of it
    """

    def join(
        self, world: World, changes: Interventions, recorder: Recorder, rest: Callable[[int], None]
    ) -> None: ...
    def leave(self) -> dict[str, Any]: ...


class Judge(Protocol):
    """An observer of a run that has something to say about it in summary.json."""

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Any]) -> None: ...
    def verdict(self, t: int) -> dict[str, Any]: ...


def run_job(
    scenario: Scenario,
    out: Path,
    *,
    progress: bool = False,
    report: bool = True,
    events: Sequence[Mapping[str, Any]] = (),
    companion: Companion | None = None,
    judge: Judge | None = None,
    begun: Callable[[], None] | None = None,
) -> JobResult:
    """Run a scenario into a folder.

    events: changes on the way, as an earlier run's summary.json has them; companion: goes along; judge: looks
    on, and adds to the summary; begun: called once the world is assembled, before the first tick

    The folder appears only once the world is assembled, so bad input leaves nothing behind. Ctrl-C and
    crashes leave a valid folder marked incomplete; the exception goes on.
    """
    while True:
        try:
            return _run_once(scenario, out, progress, report, events, companion, judge, begun)
        except Restart:
            begun = None


def _run_once(
    scenario: Scenario,
    out: Path,
    progress: bool,
    report: bool,
    events: Sequence[Mapping[str, Any]],
    companion: Companion | None,
    judge: Judge | None,
    begun: Callable[[], None] | None,
) -> JobResult:
    world = assemble(scenario)
    _spare_what_is_read(world, out)
    pacer = make_pacer(world)
    out.mkdir(parents=True, exist_ok=True)
    clear_run_folder(out)
    (out / "scenario.yaml").write_text(scenario.resolved(), encoding="utf-8")
    watch = Watch(world, out, pacer, judge)
    if begun is not None:
        begun()
    started = time.perf_counter()
    try:
        with _progress_bar(world, progress) as show, watch.recorder, paced(world.graph, pacer):
            watch.accompany(events, companion)
            drive(world, watch.observers, progress=show)
    except BaseException:
        watch.finish(time.perf_counter() - started, incomplete=True, report=False)
        raise
    finally:
        world.close()
    summary = watch.finish(time.perf_counter() - started, incomplete=False, report=report)
    return JobResult(summary, 1 if is_broken(summary["expect"]) else 0, out)


def _spare_what_is_read(world: World, out: Path) -> None:
    """A run must not be written over the recording that it plays."""
    for machine in world.machines.values():
        for part in machine.parts.values():
            for file in getattr(part, "reads", ()):
                if file.resolve().parent == out.resolve():
                    raise InputError(
                        "--out", str(out), f"expected another folder, {file.name} in it is played"
                    )


class Watch:
    """Everything that looks on while a world runs: digest, referee, recorder, keeper of scans."""

    def __init__(
        self, world: World, out: Path, pacer: Pacer | None = None, judge: Judge | None = None
    ) -> None:
        self.world, self.out, self.pacer, self.judge = world, out, pacer, judge
        self.changes: Interventions | None = None
        self.companion: Companion | None = None
        leader = world.leader
        recorded = {name: machine.recorded() for name, machine in world.machines.items()}
        self.digest = Digest()
        self.referees = {
            name: Referee(world.field, recorded[name], overlap=machine.overlap)
            for name, machine in world.machines.items()
        }
        referee = self.referees[leader.name]
        self.keeper = ScanKeeper(recorded[leader.name], referee)
        extra = {name: r.columns() for name, r in self.referees.items()}
        self.recorder = Recorder(
            out,
            list(recorded.values()),
            extra=extra,
            detail=world.scenario.run.record,
            scenario=world.scenario.resolved(),
        )
        self.observers: list[Observer] = [self.digest, *self.referees.values(), self.keeper, self.recorder]
        self.observers += [] if judge is None else [judge]

    def accompany(self, events: Sequence[Mapping[str, Any]], companion: Companion | None) -> None:
        """Let changes come, from a list and from a companion."""
        if not events and companion is None:
            return
        self.changes, self.companion = Interventions(self.world), companion
        if companion is not None:
            rest = self.pacer.rest if self.pacer is not None else lambda duration: None
            companion.join(self.world, self.changes, self.recorder, rest)
        self.world.graph.before_tick.append(Script(self.changes, events))

    def finish(self, wall_s: float, *, incomplete: bool, report: bool) -> dict[str, Any]:
        """Judge, write summary.json and the report; returns the summary."""
        world, scenario = self.world, self.world.scenario
        self.recorder.close()
        summary = make_summary(
            {
                "name": scenario.name,
                "summary": scenario.summary,
                "seed": scenario.seed,
                "swath": __version__,
                "machine": world.leader.card.name,
            },
            {**self.referees[world.leader.name].metrics(), **world.leader.coverage()},
            {k: v.model_dump(exclude_none=True) for k, v in scenario.expect.items()},
            simulated_s=world.graph.t / NS,
            wall_s=wall_s,
            ray_count=sum(m.ray_count for m in world.machines.values()),
            digest=self.digest.hex,
            incomplete=incomplete,
            cost={n.slot.name: (n.cost_s, n.step_count) for n in world.graph.nodes},
        )
        notes = [note for machine in world.machines.values() for note in machine.notes]
        if world.graph.ended:
            notes.append(f"the run ended at {world.graph.t / NS:.2f} s: {world.graph.ended}")
        if self.pacer is not None:
            summary["realtime"] = self.pacer.report()
            notes += self.pacer.notes
        if notes:
            summary["notes"] = notes
        if self.changes is not None and self.changes.events:
            summary["events"] = self.changes.events
        if self.companion is not None:
            summary |= self.companion.leave()
        if self.judge is not None:
            summary |= self.judge.verdict(world.graph.t)
        write_summary(self.out, summary)
        if report:
            self._report(summary)
        return summary

    def _report(self, summary: dict[str, Any]) -> None:
        from swath.view.report import collect, write_report

        world, name = self.world, self.world.leader.name
        data = collect(
            summary,
            world.scenario.resolved(),
            default_lines=default_lines(world.scenario),
            field=world.field,
            referee=self.referees[name],
            keeper=self.keeper,
            tracks=self.recorder.tracks[name].arrays(),
            obstacles=world.obstacles,
            driven=world.driven,
        )
        write_report(self.out, data)


def scan_job(
    scenario: Scenario,
    out: Path,
    *,
    at_s: float = 0.0,
    formats: Sequence[str] | None = None,
    camera: bool = False,
) -> list[Path]:
    """One scan of a scenario's first machine after `at_s` of driving, as files `scan.*` in the folder `out`.

    formats: of view/scan.py, None = picture, csv, npz and ply
    camera: what its camera sees then, too: scan.camera.png and scan.camera.npz
    """
    from swath.view.picture import write_picture
    from swath.view.scan import USUAL_FORMATS, check_formats, write_scan

    formats = USUAL_FORMATS if formats is None else formats
    check_formats(formats)
    world, keeper = _drive_to_scan(scenario, at_s, *(("camera",) if camera else ()))
    leader = world.leader
    scan = world.graph.latest(f"{leader.name}.lidar", "scan")
    truth = world.graph.latest(f"{leader.name}.lidar", "truth")
    assert isinstance(scan, Scan)
    if not isinstance(truth, ScanTruth):  # of a real scan from a log nobody knows it
        truth = _no_truth(scan)
    parts = Path(tempfile.mkdtemp(prefix="swath-scan-"))
    try:
        files = write_scan(
            parts,
            scan,
            truth,
            keeper.pick(1)[-1],
            mounting=leader.mountings["lidar"],
            machine=leader.recorded(),
            stand=world.field,
            edge=_edge_line(world),
            formats=formats,
        )
        if camera:
            image = world.graph.latest(f"{leader.name}.camera", "image")
            assert isinstance(image, Image)
            files += write_picture(parts, image)
        out.mkdir(parents=True, exist_ok=True)
        return [Path(shutil.move(f, out / f.name)) for f in files]
    finally:
        shutil.rmtree(parts, ignore_errors=True)


def _no_truth(scan: Scan) -> ScanTruth:
    import numpy as np

    beams, echoes = scan.ranges.shape
    return ScanTruth(scan.t, np.full((beams, echoes, 3), np.nan), np.full((beams, 3), np.nan))


def converge_job(scenario: Scenario, out: Path, *, at_s: float = 0.0) -> tuple[list[dict[str, Any]], str]:
    """How the heights of a scan settle with the number of sub-rays, here, with the next seed, and with plants
    of the other detail.

    Writes scan.converge.png and scan.converge.csv into `out`; returns the rows of the table and a sentence.
    """
    from swath.study.converge import judge, table
    from swath.view.converge import sentence, write_converge

    runs = [_settling(dataclasses.replace(scenario, seed=scenario.seed + k), at_s) for k in range(2)]
    verdict = judge(*runs)
    other = _other_detail(scenario)
    if other is not None:
        runs.append(_settling(other, at_s))
    out.mkdir(parents=True, exist_ok=True)
    write_converge(out, runs, verdict)
    return table(runs), sentence(verdict, runs)


def _other_detail(scenario: Scenario) -> Scenario | None:
    """The scenario with `reduced` plants, or with full ones when it has those; None where a stand has no
    such choice.
    """
    stand = scenario.field.stand
    detail = None if stand is None else getattr(stand.params, "detail", None)
    if stand is None or detail is None:
        return None
    params = dataclasses.replace(stand.params, detail="full" if detail == "reduced" else "reduced")
    changed = dataclasses.replace(scenario.field, stand=dataclasses.replace(stand, params=params))
    return dataclasses.replace(scenario, field=changed)


def _settling(scenario: Scenario, at_s: float) -> Settling:
    """The scans of one seed: the field as it is after `at_s`, with ever more sub-rays, without noise."""
    from swath.sensing.lidar.plants import PlantsLidar
    from swath.study.converge import settle

    world, _ = _drive_to_scan(scenario, at_s)
    leader = world.leader
    lidar = leader.parts["lidar"]
    if not isinstance(lidar, PlantsLidar):
        raise InputError(f"{leader.name}.lidar.level", type(lidar).__name__, "expected plants for --converge")
    stream = Stream(scenario.seed, f"{leader.name}.lidar.converge")

    def look(count: int, sweep: int, origins: F64, rotations: F64) -> F64:
        if count not in copies:
            quiet = dataclasses.replace(lidar.params, sub_rays=count, noise="none")
            copies[count] = PlantsLidar(quiet, lidar.setup)
            copies[count].reset(stream)
        truth = copies[count].scan_from(sweep, origins, rotations)["truth"]
        assert isinstance(truth, ScanTruth)
        return truth.points

    copies: dict[int, PlantsLidar] = {}
    state = world.graph.latest(f"{leader.name}.motion", "state")
    assert isinstance(state, MachineState)
    pose = state.pose @ lidar.mounting
    detail = getattr(world.field.stand, "detail", "full")
    return settle(look, world.field, pose, seed=scenario.seed, beams=len(lidar.azimuth), detail=detail)


def _drive_to_scan(scenario: Scenario, at_s: float, *more: str) -> tuple[World, ScanKeeper]:
    """The world of a scenario once its first machine has driven `at_s` and scanned.

    more: further slots that it must have, and that have taken a step then
    """
    slots = next(iter(scenario.machines.values())).slots
    for name in ("lidar", *more):
        if name not in slots:
            raise InputError(name, "off", f"expected a scenario whose first machine has a {name}")
    world = assemble(scenario)
    leader = world.leader
    referee = Referee(world.field, leader.recorded(), overlap=leader.overlap)
    keeper = ScanKeeper(leader.recorded(), referee)
    waits = [2.0 / slots["lidar"].common.rate_hz, *(1.0 / slots[name].common.rate_hz for name in more)]
    try:
        drive(world, [referee, keeper], until_s=max(at_s, *waits))
    finally:
        world.close()
    return world, keeper


def _edge_line(world: World) -> F64:
    """The initial edge as points (500, 2) in the world [m]."""
    import numpy as np

    edge = world.field.nominal_edge
    return np.asarray(edge.point_at(np.linspace(0.0, edge.length, 500)))


@contextmanager
def _progress_bar(world: World, wanted: bool) -> Iterator[Progress | None]:
    """A rich bar over the driven distance, on stderr; nothing where there is no terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    if not wanted or not console.is_terminal:
        yield None
        return
    text, at = TextColumn("{task.description}"), TextColumn("{task.fields[at]}")
    with Bar(text, BarColumn(), at, TimeRemainingColumn(), console=console, transient=True) as bar:
        run = world.scenario.run
        task = bar.add_task(world.scenario.name, total=run.distance_m, at="")
        yield lambda driven, t: bar.update(task, completed=driven, at=f"{driven:.0f} m, {t:.0f} s simulated")
