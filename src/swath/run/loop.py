"""The loop: sense, decide, move, cut, record; and again, until the distance is driven.

The components do the work in the order of their slots (`scenario/slots.py`): motion, header, process, lidar,
odometry, edge, steer, speed, steering. Observers record and judge.
"""

from collections.abc import Callable, Sequence

from swath.core.graph import Observer
from swath.core.schedule import NS
from swath.run.world import World
from swath.signals import MachineState

BREATH = NS // 4  # simulated time between progress reports [ns]

Progress = Callable[[float, float], None]


def drive(
    world: World,
    observers: Sequence[Observer] = (),
    *,
    until_s: float | None = None,
    progress: Progress | None = None,
    resume: bool = False,
) -> None:
    """Run a world to the end of its scenario, or to a simulated time.

    observers see every sample in order; progress is called with (driven distance [m], simulated time [s]);
    resume: go on from where the world stands instead of from the start
    """
    graph, run = world.graph, world.scenario.run
    graph.observers = [world.place_bodies, *observers]
    if not resume:
        graph.reset()
    limit_s = run.max_duration_s if until_s is None else min(until_s, run.max_duration_s)
    end = round(limit_s * NS)
    while graph.t < end and not has_arrived(world) and not graph.ended:
        graph.run(min(graph.t + BREATH, end), stop=lambda: has_arrived(world))
        if progress is not None:
            progress(driven_m(world), graph.t / NS)


def driven_m(world: World) -> float:
    """Distance the first machine has driven [m]."""
    state = world.graph.latest(f"{world.leader.name}.motion", "state")
    return state.distance if isinstance(state, MachineState) else 0.0


def has_arrived(world: World) -> bool:
    """True when the scenario's distance is driven."""
    return driven_m(world) >= world.scenario.run.distance_m
