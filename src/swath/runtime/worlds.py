"""Worlds of one scenario in step: a slot of all of them is stepped at once where its class can do that.

Every world has its own parts, digest and evaluation, and comes to what a run of its own comes to, byte for
byte. Parts whose class has `together` (`core/together.py`) are one batch; all others go world by world.
"""

import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Any, TypeVar

from swath.core.errors import SwathError
from swath.core.graph import Lockstep
from swath.core.process.collector import collected_rarely
from swath.core.process.stopping import stoppable
from swath.core.together import GoesWith, takes_all
from swath.runtime.assembly import assemble
from swath.runtime.hooks import RunHook
from swath.runtime.job import Running
from swath.runtime.loop import advance, drive_all, driven
from swath.runtime.world import World
from swath.scenario.scenario import Scenario

Ended = dict[str, Any] | SwathError  # a world's summary, or why there is none
Job = TypeVar("Job")
LOOK = ("lidar", "camera", "radar")  # kinds of slots beside which the others cost little


class Worlds:
    """Worlds whose schedules and wires are alike, and what goes along with each; drives them to their ends.

    hooks: of each world
    is_whole: False where nothing but limits is judged, and there are no digests
    lockstep: what steps them
    """

    def __init__(
        self,
        worlds: Sequence[World],
        hooks: Sequence[Sequence[RunHook]] = (),
        *,
        is_whole: bool = True,
    ) -> None:
        self.worlds = worlds
        for world in worlds:
            if world.bodies.is_alone:
                world.graph.follows = {}
        self.lockstep = Lockstep([world.graph for world in worlds])
        going = hooks or [()] * len(worlds)
        self.runs = [Running(world, None, None, own, ()) for world, own in zip(worlds, going, strict=True)]
        for run in self.runs:
            run.begin(())
            if not is_whole:
                run.observers.remove(run.digest)
                run.evaluation.only_limits()
            run.world.graph.observers = run.observers

    def drive(self) -> Iterator[tuple[int, Ended]]:
        """Drive all of them; gives number and summary, or error, of each as it ends."""
        self.begin()
        for ending in drive_all(self.worlds, self.lockstep):
            yield from self._ended(ending)

    def begin(self) -> None:
        """Bring all to t = 0."""
        for world in self.worlds:
            world.reset_field()
        self.lockstep.reset()

    def advance(self, until: int) -> Iterator[list[int]]:
        """Step to a time [ns]; gives the worlds that end, as they do."""
        return advance(self.worlds, self.lockstep, until)

    def driven(self) -> list[float]:
        """How far each has driven [m]."""
        return driven(self.worlds, self.lockstep)

    def _ended(self, ending: Sequence[int]) -> Iterator[tuple[int, Ended]]:
        """End worlds as a run of its own ends."""
        for index in ending:
            world, run = self.worlds[index], self.runs[index]
            try:
                if (error := self.lockstep.errors.get(index)) is not None:
                    raise error
                self.lockstep.take_out(index)
                world.graph.finish()
                world.close()
                found: Ended = run.finish(incomplete=False)
            except Exception as error:
                world.close()
                found = as_ours(error)
            world.graph.let_go()
            yield index, found


def as_ours(error: Exception) -> SwathError:
    """An error of a world, whatever it is."""
    return error if isinstance(error, SwathError) else SwathError(f"{type(error).__name__}: {error}")


def gains_in_step(scenario: Scenario) -> bool:
    """Whether runs of a scenario cost less in step: all their scanners, cameras and radars step at once, no
    part is a link to other software, and the run is not paced by the clock.
    """
    every = [choice for machine in scenario.machines.values() for choice in machine.slots.values()]
    if scenario.is_paced or any(choice.found.is_link for choice in every):
        return False
    looking = [choice.found.component for choice in every if choice.kind.name in LOOK]
    return all(isinstance(kind, type) and takes_all(kind, "step") and getattr(kind, "gains", True)
               for kind in looking)  # fmt: skip


def groups_in_step(worlds: Sequence[World]) -> list[list[int]]:
    """Numbers of worlds that go in step: their slots, rates and wires are alike.

    A world with a fault that loses or delays samples goes alone.
    """
    groups: dict[Any, list[int]] = {}
    for number, world in enumerate(worlds):
        nodes = world.graph.nodes
        about = [(node.slot, tuple(sorted(node.wires.items()))) for node in nodes]
        goes_alone = any(node.fault and not node.fault.fault.keeps_time for node in nodes)
        parts = [node.component.goes_with for node in nodes if isinstance(node.component, GoesWith)]
        groups.setdefault((*about, *parts, number if goes_alone else None), []).append(number)
    return list(groups.values())


def drive_together(
    worlds: Sequence[World], hooks: Sequence[Sequence[RunHook]] = ()
) -> Iterator[tuple[int, Ended]]:
    """Drive worlds, in step where they can; gives what each comes to by its number, as it ends.

    hooks: of each world
    """
    for group in groups_in_step(worlds):
        own = [hooks[number] for number in group] if hooks else ()
        for place, found in Worlds([worlds[number] for number in group], own).drive():
            yield group[place], found


def run_each(
    jobs: Sequence[Job],
    make: Callable[[Job], tuple[Scenario, Sequence[RunHook]]],
    alone: Callable[[Job], dict[str, Any]],
) -> Iterator[tuple[int, Ended, float]]:
    """Do runs, several of them in step; gives number, what it comes to, and CPU seconds of each, as it ends.

    make: scenario and hooks of one; alone: does one by itself and gives its summary. So is each done that
    comes to an error in step: what is reported of it is what that run says.
    """
    left, blame = dict(enumerate(jobs)), None
    with collected_rarely():
        if len(jobs) > 1:
            try:
                for number, ended, seconds in _together(jobs, make):
                    if isinstance(ended, dict):
                        del left[number]
                        yield number, ended, seconds
            except Exception as error:  # of one of those that are left
                blame = as_ours(error)
        for number, job in left.items():
            started = time.process_time()
            try:
                ended = alone(job)
            except Exception as error:  # a user's own part may raise anything
                ended, blame = as_ours(error), None
            yield number, ended, time.process_time() - started
    if blame is not None:  # they failed in step, and none of them alone: the fault is in a part's `together`
        warnings.warn(f"these worlds fail in step and were run one by one: {blame}", stacklevel=2)


def _together(
    jobs: Sequence[Job], make: Callable[[Job], tuple[Scenario, Sequence[RunHook]]]
) -> Iterator[tuple[int, Ended, float]]:
    """Drive and judge runs in step, those that can be made."""
    made: list[tuple[int, World, Sequence[RunHook]]] = []
    seconds, since = [0.0] * len(jobs), time.process_time()
    with stoppable():
        try:
            for number, job in enumerate(jobs):
                with suppress(Exception):
                    scenario, hooks = make(job)
                    made.append((number, assemble(scenario), hooks))
                before, since = since, time.process_time()
                seconds[number] += since - before
            running = {number for number, _, _ in made}
            for place, ended in drive_together([world for _, world, _ in made], [h for _, _, h in made]):
                before, since = since, time.process_time()
                for other in running:
                    seconds[other] += (since - before) / len(running)
                number = made[place][0]
                running.discard(number)
                yield number, ended, seconds[number]
                since = time.process_time()
        finally:
            for _, world, _ in made:
                world.close()
