"""Worlds of one scenario in step: a slot of all of them is stepped at once where its class can do that.

Every world has its own parts, digest and evaluation, and comes to what a run of its own comes to, byte for
byte. Parts whose class has `together` (`core/together.py`) are one batch; all others go world by world.
"""

import time
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

from swath.core.errors import SwathError
from swath.core.graph import Lockstep
from swath.core.schedule import NS
from swath.core.together import GoesWith, takes_all
from swath.runtime.hooks import RunHook
from swath.runtime.job import Running
from swath.runtime.loop import advance, driven
from swath.runtime.world import World
from swath.scenario.scenario import Scenario

Ended = dict[str, Any] | SwathError  # a world's summary, or why there is none
LOOK = ("lidar", "camera", "radar")  # kinds of slots beside which the others cost little


class Worlds:
    """Worlds whose schedules and wires are alike, and what goes along with each; drives them to their ends.

    hooks: of each world; is_whole: False where nothing but limits is judged, and there are no digests
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
        started, lockstep = time.perf_counter(), self.lockstep
        ends = [round(world.scenario.run.max_duration_s * NS) for world in self.worlds]
        over = self.begin()
        lockstep.stop(over)
        yield from self._ended(over, started)
        for until in sorted({*ends}):
            for ending in self.advance(until):
                yield from self._ended(ending, started)
            over = [world for world in lockstep.going if ends[world] <= until]
            lockstep.stop(over)
            yield from self._ended(over, started)

    def begin(self) -> list[int]:
        """Bring all to t = 0; gives those that end there."""
        for world in self.worlds:
            world.reset_field()
        self.lockstep.reset()
        runs = (world.scenario.run for world in self.worlds)
        about = enumerate(zip(runs, self.driven(), strict=True))
        return [w for w, (run, way) in about if way >= run.distance_m or run.max_duration_s <= 0.0]

    def advance(self, until: int) -> Iterator[list[int]]:
        """Step to a time [ns]; gives the worlds that end, as they do."""
        return advance(self.worlds, self.lockstep, until)

    def driven(self) -> list[float]:
        """How far each has driven [m]."""
        return driven(self.worlds, self.lockstep)

    def _ended(self, ending: Sequence[int], started: float) -> Iterator[tuple[int, Ended]]:
        """End worlds as a run of its own ends."""
        for index in ending:
            world, run = self.worlds[index], self.runs[index]
            try:
                if (error := self.lockstep.errors.get(index)) is not None:
                    raise error
                self.lockstep.take_out(index)
                world.graph.finish()
                world.close()
                found: Ended = run.finish(time.perf_counter() - started, incomplete=False)
            except Exception as error:
                world.close()
                found = as_ours(error)
            world.graph.let_go()
            yield index, found


def as_ours(error: Exception) -> SwathError:
    """An error of a world, whatever it is."""
    return error if isinstance(error, SwathError) else SwathError(f"{type(error).__name__}: {error}")


def warn_of_batch(error: Exception) -> None:
    """Worlds failed in step, and none of them alone: the fault is in a part's `together`."""
    warnings.warn(f"these worlds fail in step and were run one by one: {as_ours(error)}", stacklevel=3)


def gains_in_step(scenario: Scenario) -> bool:
    """Whether runs of a scenario cost less in step: all their scanners, cameras and radars step at once, no
    part is a link to other software, and the run is not paced by the clock.
    """
    every = [choice for machine in scenario.machines.values() for choice in machine.slots.values()]
    if scenario.is_paced or any(choice.found.is_link for choice in every):
        return False
    return all(takes_all(choice.found.component, "step") for choice in every if choice.kind.name in LOOK)


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
    """Drive worlds, in step where they can; gives what each comes to by its number, as it ends. hooks: of
    each world.
    """
    for group in groups_in_step(worlds):
        own = [hooks[number] for number in group] if hooks else ()
        for place, found in Worlds([worlds[number] for number in group], own).drive():
            yield group[place], found
