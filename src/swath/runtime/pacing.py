"""Paced runs: every tick begins when its time has come by the wall clock.

    pacer = make_pacer(world)         # None where the scenario does not ask for it
    with paced(world.graph, pacer):
        drive(world, ...)
    pacer.report()

Deadlines are absolute: tick t begins at origin + (t - first) / factor, so that one late tick does not delay
the next. What is late by up to the tolerance is caught up; beyond it is an overrun, which belongs to the slot
that used most of the time since the run was last on time. Time that is left before a tick goes into work that
can wait (`Recorder.write_next`) or will be needed anyway (`Field.prepare`). The clock changes no result,
except where a cheaper level takes over; that is always reported with its simulated time.
"""

import gc
import os
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from math import fsum
from typing import Any, Protocol

from swath.core.asked import bare
from swath.core.errors import SwathError
from swath.core.graph import Graph
from swath.core.number_text import num
from swath.core.schedule import NS
from swath.runtime.assembly import exchange, make_part
from swath.runtime.world import World
from swath.scenario.sections import RealTime


class Clock(Protocol):
    """A clock that never goes back. A test brings its own."""

    def now(self) -> int:
        """Time [ns]."""
        ...

    def sleep(self, duration: int) -> None:
        """Come back after `duration` [ns], or later."""
        ...


class WallClock:
    """The monotonic clock of the system. A sleep ends with a busy wait of `spin` [ns]."""

    def __init__(self, spin: int = 500_000) -> None:
        self._spin = spin

    def now(self) -> int:
        """Time [ns]."""
        return time.monotonic_ns()

    def sleep(self, duration: int) -> None:
        """Come back after `duration` [ns], or later: the system may wake us late."""
        until = time.monotonic_ns() + duration
        if duration > self._spin:
            time.sleep((duration - self._spin) * 1e-9)
        while time.monotonic_ns() < until:
            pass


@contextmanager
def scheduling(priority: int | None) -> Iterator[str]:
    """Schedule by SCHED_FIFO with a priority (1 to 99) inside the block, where the system allows it.

    Yields the scheduling that was granted: `default`, `fifo 50`, or `fifo 50 refused: why`. The priority None
    asks for nothing.
    """
    if priority is None:
        yield "default"
        return
    wanted = f"fifo {priority}"
    if not hasattr(os, "sched_setscheduler"):
        yield f"{wanted} refused: not known to this system"
        return
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        yield f"{wanted} refused: {error.strerror}"
        return
    try:
        yield wanted
    finally:
        os.sched_setscheduler(0, *before)


MS = 1_000_000
STEPS_MS = (0.1, 1.0, 5.0, 20.0, 50.0, 100.0)  # lateness is counted between these
PIECE = 3_500_000  # ns that have to be left before a tick for a piece of work in advance, at least
SHORT = 1_500_000  # the same for work that can wait, but not for long
FORGET = 0.99  # factor per tick on the longest piece of work so far, for which there must be room, too
SEARCHES = 700, 10, 10  # of garbage collection, as `gc.set_threshold` has them: each takes up to 2 ms
SYSTEM = "system"  # the run slept and was woken late
REST = "recording"  # time that no slot used: observers, files


class OverrunError(SwathError):
    """A paced run could not keep up, and its scenario says that it fails then."""


@dataclass(frozen=True)
class Exchange:
    """A slot that changed to a cheaper level at the simulated time t [ns]."""

    t: int
    slot: str
    before: str
    after: str


class Pacer:
    """Waits before every tick of a graph; put it into `Graph.before_tick`.

    costs: slot -> wall time used so far [s]
    relieve: takes the next cheaper level at a simulated time [ns]; None when there is none left
    prepare: does a piece of work in advance, of some ms; False when there is none
    deferred: does a piece of the work that can wait, but has to be done soon; False when there is none
    """

    def __init__(
        self,
        plan: RealTime,
        costs: Callable[[], Mapping[str, float]] = dict,
        *,
        clock: Clock | None = None,
        relieve: Callable[[int], Exchange | None] = lambda t: None,
        prepare: Callable[[], bool] = lambda: False,
    ) -> None:
        self._plan, self._costs, self._relieve, self._prepare = plan, costs, relieve, prepare
        self._clock = clock or WallClock(round(plan.spin_ms * MS))
        self._tolerance, self._window, self._patience = round(plan.tolerance_ms * MS), 0, 0
        if plan.on_overrun == "degrade":
            self._window, self._patience = round(plan.window_s * NS), plan.patience
        self._origin: tuple[int, int] | None = None  # simulated and wall time [ns] that belong together
        self._grace_end = 0
        self._on_time, self._used = 0, dict(costs())  # wall time [ns] and costs when last on time
        self._recent: deque[int] = deque()
        self.ticks, self.max_late = 0, 0
        self.slipped = self.grace_slipped = 0
        self.late = [0] * (len(STEPS_MS) + 1)
        self.overruns: Counter[str] = Counter()
        self.exchanges: list[Exchange] = []
        self.priority, self.scheduling = plan.priority, "default"
        self._piece = float(PIECE)
        self.after_grace: Callable[[], None] | None = None  # called once
        self.deferred: Callable[[], bool] = lambda: False

    def __call__(self, t: int) -> None:
        """Come back when the tick at t [ns] is due. OverrunError when it is too late and that is to fail."""
        now = self._clock.now()
        if self._origin is None:
            self._begin(t, now)
        if self.after_grace is not None and t > self._grace_end:
            self.after_grace()
            self.after_grace = None
        due = self._due(t)
        slept = now < due
        now = self._work_ahead(now, due)
        if slept:
            self._mark(now)
            self._clock.sleep(max(due - now, 0))
            now = self._clock.now()
        late = max(0, now - due)
        self.ticks += 1
        self.late[sum(late > 1e6 * step for step in STEPS_MS)] += 1
        if late > self._tolerance:
            self._overrun(t, late, SYSTEM if slept else self._culprit(now))
            self._mark(now)
        self.max_late = max(self.max_late, late if t > self._grace_end else 0)

    def rest(self, duration: int) -> None:
        """Do not count a pause of `duration` [ns] by the wall clock as lateness."""
        if self._origin is not None:
            first, began = self._origin
            self._origin = (first, began + duration)
            self._mark(self._clock.now())

    def report(self) -> dict[str, Any]:
        """What happened, for summary.json."""
        edges = [f"up to {num(step)} ms" for step in STEPS_MS]
        names = [*edges, f"over {num(STEPS_MS[-1])} ms"]
        return {
            "factor": self._plan.factor,
            "on_overrun": self._plan.on_overrun,
            "scheduling": self.scheduling,
            "ticks": self.ticks,
            "late": dict(zip(names, self.late, strict=True)),
            "max_late_ms": self.max_late / MS,
            "overruns": self.overruns.total(),
            "overruns_by_slot": dict(self.overruns.most_common()),
            "slipped_s": self.slipped / NS,
            "start_slipped_s": self.grace_slipped / NS,
            "degraded": [
                {"t_s": e.t / NS, "slot": e.slot, "from": e.before, "to": e.after} for e in self.exchanges
            ],
        }

    @property
    def notes(self) -> list[str]:
        """The same in a few lines for people."""
        found = [f"real time: latest tick {num(self.max_late / MS)} ms"]
        if self.overruns:
            by_slot = ", ".join(f"{slot} {count}" for slot, count in self.overruns.most_common())
            found[0] += (
                f", {self.overruns.total()} overruns over {num(self._plan.tolerance_ms)} ms ({by_slot})"
            )
            found[0] += f", {num(self.slipped / NS, places=2)} s slipped"
        if "refused" in self.scheduling:
            found.append(f"real time: scheduling {self.scheduling}")
        changed = [f"{e.slot} went from {e.before} to {e.after} at {num(e.t / NS)} s" for e in self.exchanges]
        return found + [f"real time: {text}" for text in changed]

    def _work_ahead(self, now: int, due: int) -> int:
        """What was deferred, then work in advance, as long as a piece fits in; the time then [ns]."""
        while due - now > SHORT and self.deferred():
            now = self._clock.now()
        while due - now > self._piece and self._prepare():
            began, now = now, self._clock.now()
            self._piece = max(self._piece, now - began)
        self._piece = max(float(PIECE), FORGET * self._piece)
        return now

    def _begin(self, t: int, now: int) -> None:
        self._origin = (t, now)
        self._grace_end = t + round(self._plan.grace_s * NS)
        self._mark(now)

    def _due(self, t: int) -> int:
        assert self._origin is not None
        first, began = self._origin
        return began + round((t - first) / self._plan.factor)

    def _mark(self, now: int) -> None:
        self._on_time, self._used = now, dict(self._costs())

    def _culprit(self, now: int) -> str:
        """The slot that used most of the wall time since the run was last on time."""
        used = {slot: s - self._used.get(slot, 0.0) for slot, s in self._costs().items()}
        used[REST] = (now - self._on_time) / NS - fsum(used.values())
        return max(used, key=lambda slot: used[slot])

    def _overrun(self, t: int, late: int, culprit: str) -> None:
        self._slip(late)
        if t <= self._grace_end:
            self.grace_slipped += late
            return
        self.slipped += late
        self.overruns[culprit] += 1
        if self._plan.on_overrun == "fail":
            raise OverrunError(
                f"realtime: {num(late / MS)} ms late at {num(t / NS)} s of simulated time, expected at most "
                f"{num(self._plan.tolerance_ms)} ms; {culprit} used most of the time"
            )
        if self._plan.on_overrun == "degrade":
            self._degrade(t)

    def _slip(self, late: int) -> None:
        assert self._origin is not None
        first, began = self._origin
        self._origin = (first, began + late)

    def _degrade(self, t: int) -> None:
        self._recent.append(t)
        while self._recent[0] <= t - self._window:
            self._recent.popleft()
        if len(self._recent) < self._patience:
            return
        self._recent.clear()
        done = self._relieve(t)
        if done is not None:
            self.exchanges.append(done)
            self._grace_end = t + round(self._plan.grace_s * NS)


class Relief:
    """The cheaper levels of a scenario, made beforehand, so that bad input shows at once."""

    def __init__(self, world: World) -> None:
        self._world = world
        section = world.scenario.realtime
        if section is not None and section.common.on_overrun != "degrade":
            section = bare(section)
        self._left = deque(
            (name, choice, *make_part(world, name, choice))
            for name, choice in (section.cheaper if section is not None else ())
        )
        self._level = {
            f"{machine.name}.{slot}": choice.level
            for machine in world.scenario.machines.values()
            for slot, choice in machine.slots.items()
        }

    def __call__(self, t: int) -> Exchange | None:
        """Take the next cheaper level at t [ns]."""
        if not self._left:
            return None
        name, choice, component, wires = self._left.popleft()
        exchange(self._world, name, component, wires)
        before, self._level[name] = self._level[name], choice.level
        return Exchange(t, name, before, choice.level)


def make_pacer(world: World, *, clock: Clock | None = None) -> Pacer | None:
    """The pacer that a world's scenario asks for, or None. InputError where a cheaper level cannot be had."""
    section = world.scenario.realtime
    if section is None or not world.scenario.is_paced:
        return None
    nodes = world.graph.nodes
    world.field.compile()

    def costs() -> dict[str, float]:
        return {n.slot.name: n.cost_s for n in nodes}

    return Pacer(section.common, costs, clock=clock, relieve=Relief(world), prepare=world.field.prepare)


@contextmanager
def paced(graph: Graph, pacer: Pacer | None) -> Iterator[None]:
    """Inside the block the graph waits for its pacer, with the scheduling that was asked for.

    What was there before, and what is loaded in the grace, is left out of garbage collection: going through
    all of it takes some 50 ms. What comes later is searched in small parts.
    """
    if pacer is None:
        yield
        return
    graph.before_tick.append(pacer)
    gc.collect()
    gc.freeze()
    pacer.after_grace = gc.freeze
    before = gc.get_threshold()
    gc.set_threshold(*SEARCHES)
    try:
        with scheduling(pacer.priority) as pacer.scheduling:
            yield
    finally:
        gc.set_threshold(*before)
        gc.unfreeze()
        graph.before_tick.remove(pacer)
