"""The loop: sense, decide, move, cut, record; and again, until the distance is driven.

The components do the work in the order of their slots (`scenario/slots.py`): motion, header, process, lidar,
odometry, edge, steer, speed, steering. Observers record and judge.
"""

from collections.abc import Callable, Iterator, Sequence

from swath.core.abilities import EndsRun
from swath.core.graph import EndOfRun, Observer
from swath.core.schedule import NS
from swath.core.stopping import raise_if_lost
from swath.runtime.world import World
from swath.signals import MachineState

REPORT_EVERY = NS // 4  # simulated time between progress reports [ns]

Progress = Callable[[float, float], None]


def drive(
    world: World,
    observers: Sequence[Observer] = (),
    *,
    until_s: float | None = None,
    progress: Progress | None = None,
    resume: bool = False,
) -> None:
    """Run a world to the end of its scenario, where what the header cut last is taken in, or to a time.

    observers see every sample in order, and may end the run (`core.abilities.EndsRun`); progress is called
    with (driven distance [m], simulated time [s]); resume: go on from where the world stands instead of from
    the start
    """
    graph, run = world.graph, world.scenario.run
    graph.observers = [*observers]
    seen: Sequence[object] = observers
    ending = [o for o in seen if isinstance(o, EndsRun)]

    def end_with_observers(t: int) -> None:
        for observer in ending:
            if reason := observer.end_reason(t):
                raise EndOfRun(reason)

    if ending:
        graph.before_tick.append(end_with_observers)
    if not resume:
        world.reset()
    limit_s = run.max_duration_s if until_s is None else min(until_s, run.max_duration_s)
    end = round(limit_s * NS)
    arrived = _arrival(world)
    while graph.t < end and not arrived() and not graph.ended:
        graph.run(min((graph.t // REPORT_EVERY + 1) * REPORT_EVERY, end), stop=arrived)
        raise_if_lost()
        if progress is not None:
            progress(driven_m(world), graph.t / NS)
    if ending:
        graph.before_tick.remove(end_with_observers)
    if until_s is None:
        graph.finish()


def ticks(world: World, observers: Sequence[Observer] = ()) -> Iterator[int]:
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


def driven_m(world: World) -> float:
    """The longest distance that a machine that cuts has driven; without one, that any has [m]."""
    driven = 0.0
    for slot in world.driving:
        state = world.graph.latest(slot, "state")
        if isinstance(state, MachineState) and state.distance > driven:
            driven = state.distance
    return driven


def has_arrived(world: World) -> bool:
    """True when the scenario's distance is driven."""
    return _arrival(world)()


def _arrival(world: World) -> Callable[[], bool]:
    """`has_arrived`, asked after every tick: what stays is looked up once."""
    latest, slots, distance = world.graph.latest, world.driving, world.scenario.run.distance_m

    def arrived() -> bool:
        for slot in slots:
            state = latest(slot, "state")
            if isinstance(state, MachineState) and state.distance >= distance:
                return True
        return distance <= 0.0

    return arrived
