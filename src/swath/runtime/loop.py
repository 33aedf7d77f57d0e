"""The loop: sense, decide, move, cut, record; and again, until the distance is driven.

The components do the work in the order of their slots (`scenario/slots.py`): motion, header, process, lidar,
odometry, edge, steer, speed, steering. Observers record and judge.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from swath.core.graph import Lockstep
from swath.core.ops import Goal
from swath.core.process.stopping import raise_if_lost
from swath.core.schedule import NS
from swath.runtime.world import World
from swath.signals import MachineState

BEAT = NS // 4  # simulated time between looks of observers and progress reports [ns]
LONG_BEAT = 2 * NS  # the same of worlds in step, at which nobody looks meanwhile
MOST_WAITING = 64 * NS  # simulated time of all worlds together for which samples are held at most (estimated)

Progress = Callable[[float, float], None]


def drive(
    world: World,
    observers: Sequence[Any] = (),
    *,
    until_s: float | None = None,
    progress: Progress | None = None,
    resume: bool = False,
) -> None:
    """Run a world to the end of its scenario, where what the header cut last is taken in, or to a time.

    Parameters
    ----------
    world : World
        As `assemble` gives it.
    observers : sequence
        They see every sample in order, and may end the run (`core.abilities.EndsRun`).
    until_s : float
        Time at which to stop [s], by default the end of the scenario.
    progress : callable
        Called with (driven distance [m], simulated time [s]).
    resume : bool
        Whether to go on from where the world stands instead of from the start.
    """
    graph, lockstep = world.graph, world.graph.lockstep
    graph.observers = [*observers]
    if not resume:
        world.reset()
    lockstep.go_on()
    for _ in drive_all([world], lockstep, until_s=until_s, progress=progress):
        lockstep.raise_error()
    if until_s is None:
        graph.finish()


def drive_all(
    worlds: Sequence[World],
    lockstep: Lockstep,
    *,
    until_s: float | None = None,
    progress: Progress | None = None,
) -> Iterator[list[int]]:
    """Drive worlds that were reset or loaded to the ends of their scenarios, or to a time.

    Gives those that end, as they do, some of them with an error (`lockstep.errors`). progress: of the first
    """
    ends = [round(world.scenario.run.max_duration_s * NS) for world in worlds]
    there = lockstep.reached(_arrival(worlds))
    latest = max(ends) if until_s is None else round(until_s * NS)
    over = [w for w, world in enumerate(worlds) if there[w] or world.graph.ended or ends[w] <= lockstep.t]
    for until in sorted({min(end, latest) for end in ends}):
        if over:
            lockstep.stop(over)
            yield over
        yield from advance(worlds, lockstep, until, progress)
        over = [world for world in lockstep.going if ends[world] <= until]
    if over:
        lockstep.stop(over)
        yield over


def advance(
    worlds: Sequence[World], lockstep: Lockstep, until: int, progress: Progress | None = None
) -> Iterator[list[int]]:
    """Step worlds to a time [ns]; gives those that end, as they do (`Lockstep.advance`)."""
    goal = _arrival(worlds)
    longest = BEAT if len(worlds) == 1 else max(BEAT, min(LONG_BEAT, MOST_WAITING // len(worlds)))
    while lockstep.t < until and lockstep.going:
        beat = min([getattr(o, "beat", longest) for w in worlds for o in w.graph.observers], default=longest)
        beat = min(beat, longest)
        look = (lockstep.t // beat + 1) * beat
        looks = len(worlds) == 1 or look <= until
        yield from lockstep.advance(min(look, until), goal, looks=looks)
        raise_if_lost()
        if progress is not None:
            progress(driven_m(worlds[0]), lockstep.t / NS)


def ticks(world: World, observers: Sequence[Any] = ()) -> Iterator[int]:
    """Drive tick by tick, for a loop of one's own or a debugger: gives the time [ns] after each tick.

    All of them are what `drive` does; between two of them samples can be looked at (`world.graph.latest`) and
    the world be saved and loaded.
    """
    graph = world.graph
    graph.observers = [*observers]
    world.reset()
    for t, _ in graph.plan.walk(0, round(world.scenario.run.max_duration_s * NS)):
        graph.run(t)
        if graph.ended:
            break
        yield t
        if has_arrived(world):
            break
    graph.finish()


def driven(worlds: Sequence[World], lockstep: Lockstep) -> list[float]:
    """How far each world got: the farthest machine that cuts; without one, the farthest [m]."""
    found = [0.0] * len(worlds)
    for slot in worlds[0].driving:
        row = lockstep.newest((slot, "state"))
        if row is not None and issubclass(row.kind, MachineState):
            found = [max(way) for way in zip(found, row.values("distance"), strict=True)]
    return found


def driven_m(world: World) -> float:
    """As `driven`, of a world that runs alone."""
    return driven([world], world.graph.lockstep)[0]


def has_arrived(world: World) -> bool:
    """True when the scenario's distance is driven."""
    return bool(world.graph.lockstep.reached(_arrival([world]))[0])


def _arrival(worlds: Sequence[World]) -> Goal:
    """Condition that a machine has driven the scenario's distance."""
    wires = tuple((slot, "state") for slot in worlds[0].driving)
    return Goal(wires, "distance", np.array([world.scenario.run.distance_m for world in worlds]))
