"""`swath fleet run JOB --level sensors`: the plan of a job driven by machines with sensors."""

import io
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import SwathError
from swath.core.schedule import NS
from swath.job.engine import Job
from swath.job.events import Events
from swath.job.fleet import FleetFile
from swath.job.machines import Fleet, fleet_of
from swath.job.plan import FieldPlan, Shared, shapely_here
from swath.job.timeline import Timeline
from swath.job.work import JobResult, MachineResult, plan_of
from swath.machine.fuel import tractor_fuel
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.job import run_job, run_unrecorded
from swath.scenario.scenario import Scenario, parse_scenario
from swath.signals import (
    EngineState,
    HeapState,
    JobState,
    MachineLoad,
    MachineState,
    Phase,
    Signal,
    UnloadState,
)
from swath.tools.fleet.scenario import scenario_of
from swath.tools.fleet.work_plan import WorkPlan, work_plan

STATES = {
    Phase.WAITS: "wait", Phase.CUTS: "cut", Phase.TURNS: "turn", Phase.STANDS: "wait",
    Phase.DRIVES: "transport", Phase.BESIDE: "wait", Phase.EMPTIES: "unload",
}  # fmt: skip
WAY_EVERY = 0.5  # m between two points of a way
SAME_LOAD = 15.0  # s without grain, less than that is no other load
FINEST = 0.1  # m between the points at which it is asked whether crop stands
MOST_POINTS = 4_000_000
MOVES = 0.1  # m/s
STILL_FOR = 1200.0  # s without a machine that moves or grain that flows: the job does not go on; more than
# `give_up_s` of one that hears nothing


@dataclass
class _Seen:
    """What is kept of a machine. way: points that it drove through [m]; loads: poured, of a cart brought to
    the truck; poured_at: when grain left its pipe last [s]; fuel: of a tractor [kg]
    """

    timeline: Timeline = field(default_factory=Timeline)
    latest: dict[type[Signal], Signal] = field(default_factory=dict)
    way: list[tuple[float, float]] = field(default_factory=list)
    since: float = 0.0
    loads: int = 0
    poured_at: float = -math.inf
    fuel: float = 0.0


class Watch(RunHook):
    """Goes along: who does what when, and what stands in the end. brought_at: when the last grain left a box
    at the truck [s], as at the other levels the end of the job; its cart still drives away then
    Ends a run in which nothing moves any more, with where each machine stands.
    """

    def __init__(self, plan: FieldPlan) -> None:
        self.plan = plan
        self.machines: dict[str, _Seen] = {}
        self.pass_times: dict[int, tuple[float, float]] = {}
        self.uncut, self.ended, self.duration, self.brought_at = math.nan, "", 0.0, 0.0
        self._moved_at = 0.0

    def begin(self, run: ActiveRun) -> None:
        """Listen."""
        self._world = run.world
        self.machines = {name: _Seen() for name in run.world.machines}
        run.observers.append(self._see)

    def _see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        name = slot.partition(".")[0]
        if name not in self.machines:
            return
        seen = self.machines[name]
        for signal in outputs.values():
            if isinstance(signal, JobState):
                self._note(seen, signal)
                self._burn(name, seen, signal)
            elif isinstance(signal, MachineState):
                x, y = signal.pose.position[:2].tolist()
                if not seen.way or math.hypot(x - seen.way[-1][0], y - seen.way[-1][1]) >= WAY_EVERY:
                    seen.way.append((x, y))
                self._moved_at = t / NS if abs(signal.speed) > MOVES else self._moved_at
            elif isinstance(signal, UnloadState) and signal.flow > 0.0:
                self._moved_at = t / NS
                seen.loads += t / NS > seen.poured_at + SAME_LOAD
                seen.poured_at = t / NS
            elif isinstance(signal, HeapState) and signal.emptied > _emptied(seen):
                self.brought_at = self._moved_at = signal.t / NS
            seen.latest[type(signal)] = signal
        if t / NS - self._moved_at > STILL_FOR and not self._world.graph.ended:
            self._world.graph.ended = self._stuck()

    def _stuck(self) -> str:
        """Where each machine stands that has been told."""
        told = []
        for name, seen in self.machines.items():
            job, state = seen.latest.get(JobState), seen.latest.get(MachineState)
            if isinstance(job, JobState) and isinstance(state, MachineState):
                x, y = state.pose.position[:2].tolist()
                task = f" (pass {job.task})" if job.task >= 0 else ""
                told.append(f"{name} {Phase(job.phase).name.lower()}{task} at {x:.1f}, {y:.1f} m")
        return f"nothing moves for {STILL_FOR:.0f} s: {'; '.join(told)}"

    def _note(self, seen: _Seen, job: JobState) -> None:
        """What a machine did since its last sample."""
        now, state = job.t / NS, STATES.get(Phase(job.phase))
        if job.phase in (Phase.STANDS, Phase.BESIDE) and self._is_pouring(seen, job):
            state = "unload" if job.phase == Phase.STANDS else "load"
        if state is not None:
            before = seen.timeline.spans[-1].state if seen.timeline.spans else ""
            seen.timeline.add(state, seen.since, now, job.task if state == "cut" else -1)
            seen.loads += job.phase == Phase.EMPTIES and before != state
        if job.phase == Phase.CUTS:
            begin, _ = self.pass_times.get(job.task, (seen.since, 0.0))
            self.pass_times[job.task] = begin, now

    def _is_pouring(self, seen: _Seen, job: JobState) -> bool:
        """Whether grain leaves the own pipe, or that of the machine whose pass a cart is beside."""
        for other in self.machines.values():
            pipe, work = other.latest.get(UnloadState), other.latest.get(JobState)
            own = other is seen or (isinstance(work, JobState) and work.task == job.task)
            if isinstance(pipe, UnloadState) and pipe.flow > 0.0 and own:
                return True
        return False

    def _burn(self, name: str, seen: _Seen, job: JobState) -> None:
        """Fuel of a tractor, whose data sheet has no engine; and the time is taken."""
        state, heap = seen.latest.get(MachineState), seen.latest.get(HeapState)
        now = job.t / NS
        if isinstance(state, MachineState) and isinstance(heap, HeapState):
            rate = tractor_fuel(self._world.machines[name].sheet, heap.grain, state.speed)
            seen.fuel += rate * (now - seen.since)
        seen.since = now

    def summarize(self, t: int) -> dict[str, Any]:
        """Look at the field once all is done."""
        self.uncut, self.duration = share_uncut(self._world.field, self.plan), t / NS
        self.ended = self._world.graph.ended or ""
        return {"uncut_share": self.uncut}


def share_uncut(ground: Any, plan: FieldPlan) -> float:
    """Share of the field's area on which crop stands, from points at most FINEST apart."""
    shapely = shapely_here()
    west, south = plan.boundary.min(axis=0).tolist()
    east, north = plan.boundary.max(axis=0).tolist()
    step = max(FINEST, math.sqrt((east - west) * (north - south) / MOST_POINTS))
    polygon = shapely.Polygon(plan.boundary)
    shapely.prepare(polygon)
    rows = np.arange(south + 0.5 * step, north, step)
    x = np.arange(west + 0.5 * step, east, step)
    inside = standing = 0
    for y in rows.tolist():
        own = x[shapely.contains_xy(polygon, x, np.full(len(x), y))]
        inside += len(own)
        standing += int(np.count_nonzero(ground.standing(own, np.full(len(own), y))))
    return standing / max(inside, 1)


def scenario_text(file: FleetFile, work: WorkPlan, fleet: Fleet, base: Path | None) -> str:
    """The scenario of a job as YAML."""
    from ruamel.yaml import YAML

    writer = YAML(typ="safe")
    writer.default_flow_style = None
    writer.representer.ignore_aliases = lambda *_: True
    text = io.StringIO()
    writer.dump(scenario_of(file, work, fleet, base), text)
    return text.getvalue()


def with_sensors(
    file: FleetFile, base: Path | None = None, out: Path | None = None, sets: tuple[str, ...] = ()
) -> tuple[JobResult, dict[str, Any]]:
    """Run a job with simulated machines until the field is empty: its result, and the summary of the run.

    out: folder of the run (report, replay), None = no files; sets: changes of the scenario, as `--set`
    SwathError where it does not end.
    """
    fleet = fleet_of(file, base)
    work = work_plan(file, plan_of(file, fleet, base), fleet)
    text, plan = scenario_text(file, work, fleet, base), work.shared.plan
    scenario: Scenario = parse_scenario(text, base=base or Path.cwd(), sets=list(sets))
    watch = Watch(plan)
    if out is None:
        summary = run_unrecorded(scenario, hooks=[watch])
    else:
        summary = run_job(scenario, out, hooks=[watch], progress=True).summary
    if not watch.ended.startswith(tuple(f"{n}.job: the field is empty" for n in watch.machines)):
        raise SwathError(
            f"the job does not end: {watch.ended or 'time is over'}, after {watch.duration:.0f} s"
        )
    made = _result(file, plan, fleet, watch, summary)
    return replace(made, notes=(*made.notes, _by_events(file, work.shared, fleet))), summary


def _by_events(file: FleetFile, shared: Shared, fleet: Fleet) -> str:
    """What the cheapest level says, for the same passes of each combine."""
    job = Job(file, shared, fleet, Events())
    try:
        job.run()
    except SwathError as error:
        return f"by events, if each combine cuts the same passes: {error}"
    return f"{job.time / 3600.0:.2f} h by events, if each combine cuts the same passes"


def _result(
    file: FleetFile, plan: FieldPlan, fleet: Fleet, watch: Watch, summary: dict[str, Any]
) -> JobResult:
    """In the shape of the other levels."""
    machines = tuple(_machine(name, seen) for name, seen in watch.machines.items())
    area = plan.area * (1.0 - watch.uncut)
    harvest = max(end for _, end in watch.pass_times.values())
    grain = file.field.yield_t_ha / 10.0 * plan.width
    possible = math.fsum(c.speed_in(grain) * c.sheet.header_width for c in fleet.combines)
    emptied = math.fsum(_emptied(seen) for seen in watch.machines.values())
    notes = (*plan.notes, *_notes(watch, summary))
    return JobResult(
        "sensors", file, plan, machines, max(watch.brought_at, harvest), harvest, area, emptied,
        mass_error=float(summary["field"]["mass_balance_error"]),
        field_efficiency=area / (possible * harvest), pass_times=watch.pass_times,
        ways=tuple(np.array(m.way) for m in watch.machines.values()), notes=notes,
    )  # fmt: skip


def _notes(watch: Watch, summary: dict[str, Any]) -> list[str]:
    told = [f"{100.0 * watch.uncut:.3f} % of the area is uncut"]
    contacts = [int(summary["machines"][name].get("contact_count", 0)) for name in watch.machines]
    told.append(f"{max(contacts, default=0)} contacts")
    kept = math.fsum(_grain_on(seen) for seen in watch.machines.values())
    told.append(f"{kept:.0f} kg of grain are not at the truck")
    if "spill_share" in summary["field"]:
        told.append(f"{100.0 * summary['field']['spill_share']:.3f} % of the grain handed over is spilled")
    return told


def _emptied(seen: _Seen) -> float:
    """What a cart has brought to the truck [kg]."""
    heap = seen.latest.get(HeapState)
    return float(heap.emptied) if isinstance(heap, HeapState) else 0.0


def _grain_on(seen: _Seen) -> float:
    """What a machine holds in its tank or box [kg]."""
    load, heap = seen.latest.get(MachineLoad), seen.latest.get(HeapState)
    held = float(heap.grain) if isinstance(heap, HeapState) else 0.0
    return held + (float(load.tank_grain) if isinstance(load, MachineLoad) else 0.0)


def _machine(name: str, seen: _Seen) -> MachineResult:
    state, load = (seen.latest.get(k) for k in (MachineState, MachineLoad))
    engine = seen.latest.get(EngineState)
    way = float(state.distance) if isinstance(state, MachineState) else 0.0
    if isinstance(load, MachineLoad):
        fuel = float(engine.fuel_used) if isinstance(engine, EngineState) else 0.0
        grain = float(load.unloaded_grain)
        return MachineResult(name, "combine", seen.timeline, way, fuel, grain, seen.loads)
    return MachineResult(name, "cart", seen.timeline, way, seen.fuel, _emptied(seen), seen.loads)
