"""Worlds of one scenario in step: a slot of all of them is stepped at once where its class can do that.

Every world has its own parts, digest and evaluation, and comes to what a run of its own comes to, byte for
byte. Parts whose class has `together` (`core/together.py`) are one batch; all others go world by world.
"""

import time
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from swath.core.abilities import EndsRun, StepsAnyLength
from swath.core.component import Port
from swath.core.errors import SwathError
from swath.core.graph import EndOfRun, Node
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.signal import Signal
from swath.core.stopping import raise_if_lost
from swath.core.together import EndsWorlds, GoesWith, Samples, StepsTogether, Together, takes_all
from swath.judge.together import EvaluationOfAll, kind_of
from swath.record.digest import Digests
from swath.runtime.hooks import RunHook
from swath.runtime.job import Running
from swath.runtime.loop import REPORT_EVERY
from swath.runtime.world import World
from swath.scenario.scenario import Scenario
from swath.signals import MachineState

Wire = tuple[str, str]
Each = list[Signal]  # a sample for each world
Sent = Samples | Each
Ended = dict[str, Any] | SwathError  # a world's summary, or why there is none
ALONE = 2  # observers of a run without tracks and hooks: digest, evaluation
LOOK = ("lidar", "camera", "radar")  # kinds of slots beside which the others cost little


class _Slot:
    """A slot of all worlds. parts: of each; all: those that step at once, None = world by world"""

    def __init__(self, nodes: Sequence[Node]) -> None:
        first = nodes[0]
        self.nodes, self.name, self.slot = nodes, first.slot.name, first.slot
        self.parts = [node.component for node in nodes]
        self.ports: dict[str, Port] = {port.name: port for port in self.parts[0].inputs}
        self.wires: dict[str, Wire | None] = {name: first.wires.get(name) for name in self.ports}
        self.queues: dict[str, list[Sent]] = {
            name: [] for name, port in self.ports.items() if port.history and self.wires[name] is not None
        }
        self.all: Together | None = None
        kinds = {type(part) for part in self.parts}
        if len(kinds) == 1 and not any(node.fault for node in nodes) and not self.slot.latch:
            kind: Any = kinds.pop()
            if takes_all(kind, "step") and isinstance(kind, StepsTogether):
                self.all = kind.together(self.parts)
        self.seconds, self.steps = 0.0, 0
        self.may_end = any(isinstance(part, EndsRun) for part in self.parts)


class Worlds:
    """Worlds whose schedules and wires are alike; drives them to their ends.

    hooks: of each world; is_whole: False where nothing but limits is judged, and there are no digests
    active: whether a world still runs; t [ns]
    errors: of worlds that cannot go on
    """

    def __init__(
        self,
        worlds: Sequence[World],
        hooks: Sequence[Sequence[RunHook]] = (),
        *,
        is_whole: bool = True,
    ) -> None:
        self.worlds, self.t = worlds, 0
        graphs = [world.graph for world in worlds]
        self.plan = graphs[0].plan
        self.slots = [_Slot(nodes) for nodes in zip(*(graph.nodes for graph in graphs), strict=True)]
        self.active = np.ones(len(worlds), np.bool_)
        going = hooks or [()] * len(worlds)
        self.runs = [Running(world, None, None, own, ()) for world, own in zip(worlds, going, strict=True)]
        self._latest: dict[Wire, Sent] = {}
        self._before: dict[Wire, Sent] = {}
        self._queues: dict[Wire, list[list[Sent]]] = {}
        self._latches = any(slot.slot.latch for slot in self.slots)
        for slot in self.slots:
            for name, queue in slot.queues.items():
                wire = slot.wires[name]
                if wire is not None:
                    self._queues.setdefault(wire, []).append(queue)
        self._digests = Digests([run.digest for run in self.runs]) if is_whole else None
        for run in self.runs:
            run.begin(())
        self._has_more = [len(run.observers) > ALONE for run in self.runs]
        self._judges: EvaluationOfAll | None = None
        if not any(self._has_more) and not any(run.evaluation.has_windows for run in self.runs):
            self._judges = EvaluationOfAll([run.evaluation for run in self.runs], is_whole=is_whole)
        self._watched = {
            slot for world in worlds if not world.bodies.is_alone for slot in world.graph.watches
        }
        self._ending = [slot for slot in self.slots if slot.may_end]
        runs = [world.scenario.run for world in worlds]
        self._distance = np.array([run.distance_m for run in runs])
        self._ends = np.array([round(run.max_duration_s * NS) for run in runs])
        self.errors: dict[int, SwathError] = {}
        self._ended = [""] * len(worlds)
        self._end_t = np.zeros(len(worlds), np.int64)

    def drive(self) -> Iterator[tuple[int, Ended]]:
        """Drive all of them; gives number and summary, or error, of each as it ends."""
        started = time.perf_counter()
        yield from self._finished(self.begin(), started)
        for ending in self.advance(int(self._ends.max())):
            yield from self._failed()
            yield from self._finished(ending, started)
        self._end_t[self.active] = self._ends[self.active]
        yield from self._finished(self._running(), started)

    def begin(self) -> list[int]:
        """Bring all to t = 0; gives those that end there."""
        self._reset()
        found: list[int] = np.flatnonzero((self._ends <= 0) | self._arrived()).tolist()
        return found

    def advance(self, until: int) -> Iterator[list[int]]:
        """Step to a time [ns]; gives, tick by tick, the worlds that end. They, and those that `errors` names,
        are to be taken out of `active` and `errors` before the next tick.
        """
        first = int(self._ends.min())
        for t, due in self.plan.walk(self.t, until):
            if t > first:
                over = self.active & (t > self._ends)
                self._end_t[over] = self._ends[over]
                yield np.flatnonzero(over).tolist()
            yield self._stopped(t)
            if not self.active.any():
                return
            if self._latches:
                self._before = {wire: _kept(sent) for wire, sent in self._latest.items()}
            for index in due:
                self._step(self.slots[index], t)
            self._end_t[self.active] = self.t = t
            raise_if_lost()
            yield np.flatnonzero(self.active & self._arrived()).tolist()
        self._end_t[self.active] = self.t = until

    def _running(self) -> list[int]:
        found: list[int] = np.flatnonzero(self.active).tolist()
        return found

    def _reset(self) -> None:
        for world in self.worlds:
            world.reset_field()
        for slot in self.slots:
            streams = [Stream(world.graph.seed, slot.name) for world in self.worlds]
            outputs: Mapping[str, Sent]
            if slot.all is not None:
                outputs = slot.all.reset(streams)
            else:
                each = []
                for node, stream in zip(slot.nodes, streams, strict=True):
                    made = node.component.reset(stream)
                    if node.fault is not None:
                        node.fault.reset(stream)
                        made = node.fault.pass_on(0, made)
                    each.append(made)
                outputs = _turned(each)
            self._send(slot, 0, outputs)
        self._before = dict(self._latest)

    def _step(self, slot: _Slot, t: int) -> None:
        period = slot.slot.period
        started = time.perf_counter()
        outputs: Mapping[str, Sent]
        if slot.all is not None:
            outputs = slot.all.step(t - period, period, self._inputs(slot))
            self.errors |= {w: error for w, error in slot.all.errors.items() if self.active[w]}
            slot.all.errors.clear()
        else:
            inputs = self._inputs_each(slot)
            each: list[Any] = []
            for world, node in enumerate(slot.nodes):
                made = None
                if self.active[world]:
                    try:
                        made = node.component.step(t - period, period, inputs[world])
                        if node.fault is not None:
                            made = node.fault.pass_on(t, made)
                    except Exception as error:  # a user's own part may raise anything
                        self.errors[world] = as_ours(error)
                each.append(made)
            outputs = _turned(each, self._latest, slot.name)
        for world in self.errors:
            self.active[world] = False
        slot.seconds += time.perf_counter() - started
        slot.steps += 1
        self._send(slot, t, outputs)

    def _inputs(self, slot: _Slot) -> dict[str, Any]:
        """For parts that step at once."""
        found: dict[str, Any] = {}
        for name, wire in slot.wires.items():
            if name in slot.queues:
                found[name] = tuple(self._together(sent) for sent in slot.queues[name])
                slot.queues[name].clear()
            else:
                sent = self._latest.get(wire) if wire is not None else None
                found[name] = None if sent is None else self._together(sent)
        return found

    def _together(self, sent: Sent) -> Samples:
        return sent if isinstance(sent, Samples) else Samples.joined(sent, self.active.tolist())

    def _inputs_each(self, slot: _Slot) -> list[dict[str, Any]]:
        """For parts that are stepped world by world."""
        found: list[dict[str, Any]] = [{} for _ in self.worlds]
        latest = self._before if slot.slot.latch else self._latest
        for name, wire in slot.wires.items():
            if name in slot.queues:
                queue = [_each(sent) for sent in slot.queues[name]]
                slot.queues[name].clear()
                for world, inputs in enumerate(found):
                    inputs[name] = tuple(sent[world] for sent in queue)
            else:
                sent = latest.get(wire) if wire is not None else None
                each = [None] * len(found) if sent is None else _each(sent)
                for inputs, sample in zip(found, each, strict=True):
                    inputs[name] = sample
        return found

    def _send(self, slot: _Slot, t: int, outputs: Mapping[str, Sent]) -> None:
        """Publish what a slot gave in every world, and show it to digest and evaluation."""
        for output, sent in outputs.items():
            wire = slot.name, output
            self._latest[wire] = sent
            for queue in self._queues.get(wire, ()):
                queue.append(_kept(sent))
        if self._digests is not None:
            self._digests.take(slot.name, t, outputs, self.active)
        if slot.name in self._watched:
            for world in self._running():
                if (watch := self.worlds[world].graph.watches.get(slot.name)) is not None:
                    watch(slot.name, t, {output: _of(sent, world) for output, sent in outputs.items()})
        if self._judges is not None:
            self._judges(slot.name, t, outputs, self.active)
        else:
            self._show_each(slot.name, t, outputs)

    def _show_each(self, slot: str, t: int, outputs: Mapping[str, Sent]) -> None:
        """Show samples to the evaluators of each world, and to what else looks on."""
        kinds = tuple(kind_of(sent) for sent in outputs.values())
        wanted = [
            world for world in self._running()
            if self._has_more[world] or self.runs[world].evaluation.wants(slot, t, kinds)
        ]  # fmt: skip
        if not wanted:
            return
        each = {output: _each(sent) for output, sent in outputs.items()}
        for world in wanted:
            own = {output: samples[world] for output, samples in each.items()}
            for see in self.runs[world].observers[1:]:
                see(slot, t, own)

    def _stopped(self, t: int) -> list[int]:
        """Worlds that a part or an evaluator ends before the tick at t [ns]."""
        found: list[int] = []
        reasons = [_reasons_of(slot.all) for slot in self._ending]
        is_quiet = all(told is not None and not told for told in reasons)
        if is_quiet and self._judges is not None and not self._judges.may_end:
            return found
        for world in self._running():
            try:
                self._end_with_parts(world, reasons, t)
                if self._judges is not None:
                    self._judges.end_with(world, t)
                elif reason := self.runs[world].evaluation.end_reason(t):
                    raise EndOfRun(reason)
            except EndOfRun as end:
                self._ended[world] = str(end)
                at = (t - 1) // REPORT_EVERY * REPORT_EVERY
                self._end_t[world] = max(int(self._end_t[world]), at)
                found.append(world)
        return found

    def _end_with_parts(self, world: int, reasons: Sequence[Mapping[int, str] | None], t: int) -> None:
        """EndOfRun where a part of a world wants that. reasons: of parts that step at once, by slot"""
        for slot, told in zip(self._ending, reasons, strict=True):
            part: Any = slot.parts[world]
            reason = part.end_reason(t) if told is None else told.get(world, "")
            if reason:
                raise EndOfRun(f"{slot.name}: {reason}")

    def _arrived(self) -> Any:
        """Which worlds have driven their distance."""
        return self.driven() >= self._distance

    def driven(self) -> Any:
        """How far each has driven, as `loop.driven_m` counts it [m]."""
        found = np.zeros(len(self.worlds))
        for slot in self.worlds[0].driving:
            sent = self._latest.get((slot, "state"))
            if isinstance(sent, Samples):
                if sent.kind is MachineState:
                    found = np.maximum(found, sent.arrays["distance"])
            elif sent is not None:
                driven = [s.distance if isinstance(s, MachineState) else 0.0 for s in sent]
                found = np.maximum(found, driven)
        return found

    def latest(self, slot: str, output: str) -> Samples | None:
        """The newest samples of an output; those of worlds that have ended mean nothing."""
        sent = self._latest.get((slot, output))
        return None if sent is None else self._together(sent)

    def ended(self, world: int) -> tuple[int, str]:
        """Until when a world was stepped [ns], and why a part or an evaluator ended it."""
        return int(self._end_t[world]), self._ended[world]

    def judged(self, world: int, names: Collection[str] | None = None) -> Running:
        """What goes along with a world, its evaluators knowing what was seen so far.

        names: the evaluators of these metrics alone
        """
        if self._judges is not None:
            self._judges.give(world, names)
        return self.runs[world]

    def _finished(self, ending: Sequence[int], started: float) -> Iterator[tuple[int, Ended]]:
        """End worlds as a run of its own ends."""
        for index in ending:
            self.active[index] = False
            try:
                found: Ended = self._finish(index, time.perf_counter() - started)
            except Exception as error:
                found = as_ours(error)
            yield index, found

    def _failed(self) -> Iterator[tuple[int, Ended]]:
        """Worlds that cannot go on."""
        for index, error in list(self.errors.items()):
            self.worlds[index].close()
            self.worlds[index].graph.let_go()
            yield index, error
        self.errors.clear()

    def _finish(self, index: int, wall_s: float) -> dict[str, Any]:
        world, run = self.worlds[index], self.runs[index]
        graph = world.graph
        graph.t, graph.ended = int(self._end_t[index]), self._ended[index]
        if self._digests is not None:
            self._digests.give(index)
        if self._judges is not None:
            self._judges.give(index)
        for (name, output), sent in self._latest.items():
            graph.put(name, output, _of(sent, index))
        for node, slot in zip(graph.nodes, self.slots, strict=True):
            node.cost_s, node.step_count = slot.seconds / len(self.worlds), slot.steps
            if slot.all is not None and isinstance(node.component, StepsAnyLength):
                node.component.reset(Stream(graph.seed, slot.name))
                node.component.load(slot.all.save(index))
        graph.observers = [*run.observers]
        graph.finish_from(
            {
                (slot.name, port): [_of(sent, index) for sent in q]
                for slot in self.slots
                for port, q in slot.queues.items()
            }
        )
        world.close()
        summary = run.finish(wall_s, incomplete=False)
        graph.let_go()
        return summary


def _reasons_of(parts: Any) -> Mapping[int, str] | None:
    """Why parts that step at once want worlds to end; None where each is asked."""
    return parts.reasons if isinstance(parts, EndsWorlds) else None


def as_ours(error: Exception) -> SwathError:
    """An error of a world, whatever it is."""
    return error if isinstance(error, SwathError) else SwathError(f"{type(error).__name__}: {error}")


def warn_of_batch(error: Exception) -> None:
    """Worlds failed in step, and none of them alone: the fault is in a part's `together`."""
    warnings.warn(f"these worlds fail in step and were run one by one: {as_ours(error)}", stacklevel=3)


def _of(sent: Sent, world: int) -> Signal:
    return sent.of(world) if isinstance(sent, Samples) else sent[world]


def _kept(sent: Sent) -> Sent:
    return sent.copy() if isinstance(sent, Samples) else sent


def _each(sent: Sent) -> Each:
    return sent.each() if isinstance(sent, Samples) else sent


def _turned(
    each: Sequence[Mapping[str, Signal] | None], latest: Mapping[Wire, Sent] | None = None, slot: str = ""
) -> dict[str, Sent]:
    """Outputs of each world as samples by output; of a world that has ended its last one stays."""
    first = next((made for made in each if made is not None), None)
    if first is None:
        return {}
    found: dict[str, Sent] = {}
    for output in first:
        own: Each = []
        for world, made in enumerate(each):
            if made is not None:
                own.append(made[output])
            else:
                sent = (latest or {})[slot, output]
                own.append(sent.of(world) if isinstance(sent, Samples) else sent[world])
        found[output] = own
    return found


def gains_in_step(scenario: Scenario) -> bool:
    """Whether runs of a scenario cost less in step: all their scanners, cameras and radars step at once, no
    part is a link to other software, and the run is not paced by the clock.
    """
    every = [choice for machine in scenario.machines.values() for choice in machine.slots.values()]
    if scenario.is_paced or any(choice.found.is_link for choice in every):
        return False
    return all(takes_all(choice.found.component, "step") for choice in every if choice.kind.name in LOOK)


def groups_in_step(worlds: Sequence[World]) -> list[list[int]]:
    """Numbers of worlds that go in step: their slots, rates and wires are alike. A world with a fault that
    loses or delays samples goes alone.
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
    each world
    """
    for group in groups_in_step(worlds):
        own = [hooks[number] for number in group] if hooks else ()
        for place, found in Worlds([worlds[number] for number in group], own).drive():
            yield group[place], found
