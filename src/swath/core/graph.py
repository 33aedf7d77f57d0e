"""Components, their connections and the schedule: a runnable, saveable whole, alone or in step."""

import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.abilities import Ending, EndsRun, StepsAnyLength
from swath.core.asked import PRESENT, asking
from swath.core.blocks import Block, Blocks, Seen, Shown
from swath.core.component import Component, Outputs, Port, State, check_fit
from swath.core.errors import SwathError, WiringError
from swath.core.fault import FaultyOutput
from swath.core.foreign_code import of_exit
from swath.core.onlookers import Audience, Onlookers, audiences
from swath.core.ops import Goal, Member, Op, Program
from swath.core.random import Stream
from swath.core.rows import Row, Waiting, held_row, row_with
from swath.core.schedule import Plan, Slot
from swath.core.signal import Signal
from swath.core.together import EndsWorlds, InWorlds, Samples, StepsTogether, Together, takes_all

Wire = tuple[str, str]
Ints = NDArray[np.int64]
Given = Samples | Mapping[int, Signal]  # what an output sent: in all worlds, or in some by their numbers
Observer = Callable[[str, int, Mapping[str, Signal]], None]


@dataclass
class Cost:
    """What the steps of a slot took. sharers: worlds that are stepped at once."""

    seconds: float = 0.0
    steps: int = 0
    sharers: int = 1


@dataclass
class Node:
    """A component in its slot. wires: input name -> (source slot, output name).

    fault: what goes wrong with what the slot sends, whatever component fills it
    """

    slot: Slot
    component: Component
    wires: dict[str, tuple[str, str]] = field(default_factory=dict)
    fault: FaultyOutput | None = None
    cost: Cost = field(default_factory=Cost)

    @property
    def cost_s(self) -> float:
        """Time that the steps of this node took so far: its share where several were stepped together [s]."""
        return self.cost.seconds / self.cost.sharers

    @property
    def step_count(self) -> int:
        """How often it was stepped."""
        return self.cost.steps


class EndOfRun(Exception):
    """Raised by a `before_tick`: the run ends before that tick. Its text says why."""


class Graph:
    """Runs the components of a scenario by their plan.

    observers are called with (slot name, time [ns], outputs) after every step, in order, or look now and then
    (`core/blocks.py`), and may end the run (`EndsRun`); they must not change anything that a component
    reads. watches: slot -> the same for this slot alone, called before them. follows: slot -> the same
    for who asks for nothing but its newest sample: called before a part in Python is stepped, at the latest
    before_tick: called with the time [ns] of a tick before its steps run, for those who wait (a real clock, a
    paused run); they change no result, but may raise EndOfRun
    ended: why a run stopped before its end, empty where it did not
    outside: slots that are not in this graph -> their outputs; whoever runs it puts their samples in
    lockstep: what steps it, alone or with graphs of other worlds
    """

    def __init__(
        self, nodes: list[Node], seed: int, *, outside: Mapping[str, Mapping[str, Port]] | None = None
    ) -> None:
        self.nodes = nodes
        self.seed = seed
        self.outside = dict(outside or {})
        self.t = 0
        self.ended = ""
        self.plan = Plan(tuple(n.slot for n in nodes))
        self.observers: list[Any] = []
        self.watches: dict[str, Observer] = {}
        self.follows: dict[str, Observer] = {}
        self.before_tick: list[Callable[[int], None]] = []
        self._names = {n.slot.name: n for n in nodes}
        for node in nodes:
            self._check(node)
        self.lockstep = Lockstep([self])

    def reset(self) -> None:
        """Bring every component to t = 0 and collect the outputs valid there."""
        self.lockstep.reset()

    def run(self, until: int, stop: Callable[[], bool] | None = None) -> None:
        """Advance to time `until` [ns], or to the first tick after which `stop()` is true."""
        self.lockstep.go_on()
        for _ in self.lockstep.advance(until, stop=stop):
            pass
        self.lockstep.raise_error()

    def finish(self) -> None:
        """The end: parts that can (`StepsAnyLength`) take in what was sent to them since their last step."""
        self.lockstep.finish()

    def let_go(self) -> None:
        """Forget those who watch, wait and step.

        They hold the graph, too: then all go when nobody uses them, and not whenever Python looks for such
        circles. What was sent last stays.
        """
        self.observers, self.watches, self.follows, self.before_tick = [], {}, {}, []
        self.lockstep.let_go()

    def put(self, slot: str, output: str, sample: Signal) -> None:
        """A sample from outside: components that step from now on see it."""
        self.lockstep.put((slot, output), sample)

    def latest(self, slot: str, output: str) -> Signal | None:
        """The newest sample of an output, None before there is one."""
        row = self.lockstep.newest((slot, output))
        return None if row is None else row.view(self.lockstep.place(self))

    def exchange(
        self,
        slot: str,
        component: Component,
        wires: Mapping[str, Wire],
        state: State | None = None,
        guard: Callable[[FaultyOutput | None], FaultyOutput | None] = lambda fault: fault,
    ) -> None:
        """Another component in a slot, from its next step on.

        It begins with `reset`, at the present time, or goes on from `state`; what the slot sent last stays
        until it sends anew. The period stays, and the fault, which `guard` may make anew. Raises
        WiringError when it does not fit, and what the component raises; then nothing has changed.
        """
        with asking(slot):
            component.reset(Stream(self.seed, slot))
        if state is not None:
            component.load(state)
        node = self._names[slot]
        before = node.component, node.wires, node.fault
        node.component, node.wires, node.fault = component, dict(wires), guard(node.fault)
        if node.fault is not None and node.fault is not before[2]:
            node.fault.reset(Stream(self.seed, slot))
            if before[2] is not None:
                node.fault.load(before[2].save())
        try:
            for each in self.nodes:
                self._check(each)
        except WiringError:
            node.component, node.wires, node.fault = before
            raise
        self.lockstep.connect()

    def save(self) -> State:
        """Everything needed to go on from here, byte for byte."""
        return {
            "t": self.t,
            "components": {n.slot.name: n.component.save() for n in self.nodes},
            "faults": {n.slot.name: n.fault.save() for n in self.nodes if n.fault is not None},
            **self.lockstep.save(),
        }

    def load(self, state: Mapping[str, Any]) -> None:
        """Go back to a saved moment. Components are reset first, so that each knows its random stream."""
        watching = self.observers, self.watches, self.follows
        self.observers, self.watches, self.follows = [], {}, {}
        self.reset()
        self.observers, self.watches, self.follows = watching
        for node in self.nodes:
            node.component.load(state["components"][node.slot.name])
            if node.fault is not None:
                node.fault.load(state["faults"][node.slot.name])
        self.lockstep.load(state)

    def _check(self, node: Node) -> None:
        """Check every wire of a node."""
        ports = {p.name: p for p in node.component.inputs}
        for name in node.wires:
            if name not in ports:
                raise WiringError(f"{node.slot.name}.{name}: there is no such input; it has {sorted(ports)}")
        for port in ports.values():
            if port.name in node.wires:
                source, output = node.wires[port.name]
                check_fit(source, self._output_port(source, output, node, port), node.slot.name, port)
            elif not port.optional:
                every = ((n.slot.name, out) for n in self.nodes for out in n.component.outputs)
                fits = [f"{name}.{out.name}" for name, out in every if issubclass(out.signal, port.signal)]
                kind = port.signal.__name__
                said = f"wires: {{{port.name}: ...}} of its slot may name {' or '.join(fits)}"
                why = said if fits else f"no slot sends a {kind}"
                raise WiringError(f"{node.slot.name}.{port.name}: input is not connected, {why}")

    def _output_port(self, source: str, output: str, node: Node, port: Port) -> Port:
        end = f"{source}.{output} -> {node.slot.name}.{port.name}"
        if source not in self._names and source not in self.outside:
            raise WiringError(
                f"{end}: there is no slot {source}: name it in the scenario; there are {sorted(self._names)}"
            )
        ports = dict(self.outside.get(source, {}))
        if source in self._names:
            ports = {p.name: p for p in self._names[source].component.outputs}
        if output not in ports:
            raise WiringError(f"{end}: {source} has no output {output}; it has {sorted(ports)}")
        return ports[output]


class _Rank:
    """A slot of all worlds. nodes, parts: of each; batch: those that step at once, None = world by world.

    wires: port of which the newest sample is read -> where that is; sources: the same of ports with a
    history; queues: what came to these since the last step; sends: output -> its type
    """

    def __init__(self, nodes: Sequence[Node]) -> None:
        first = nodes[0]
        self.nodes, self.name, self.slot = nodes, first.slot.name, first.slot
        self.parts = [node.component for node in nodes]
        ports = [(port, first.wires.get(port.name)) for port in self.parts[0].inputs]
        self.wires = [(p.name, wire) for p, wire in ports if wire is None or not p.history]
        self.queues = {p.name: Waiting() for p, wire in ports if wire and p.history}
        self.sources = {p.name: wire for p, wire in ports if wire and p.history}
        self.sends = {port.name: port.signal for port in self.parts[0].outputs}
        self.may_end = any(isinstance(part, EndsRun) for part in self.parts)
        self.batch: Together | None = None
        # what checks samples, and changes none, of the worlds whose part is not swath's own
        self.checks = [fault for fault in (node.fault for node in nodes) if fault and not fault.changes]
        if not self.slot.latch and not any(node.fault and node.fault.changes for node in nodes):
            self.batch = self._batch()
        self.cost = first.cost if len(nodes) == 1 else Cost(sharers=len(nodes))
        for node in nodes:
            node.cost = self.cost

    def _batch(self) -> Together | None:
        """Of one world, that of its part once it is reset; of several what their class makes of them."""
        part, kind = self.parts[0], type(self.parts[0])
        if not takes_all(kind, "step") or any(type(other) is not kind for other in self.parts):
            return None
        if len(self.parts) == 1:
            return part.alone if isinstance(part, InWorlds) else None
        with asking(self.name):
            return kind.together(self.parts) if isinstance(kind, StepsTogether) else None

    @property
    def is_op(self) -> bool:
        """Whether compiled code may step it."""
        batch: Any = self.batch
        return isinstance(batch, Op) and batch.walks and not self.checks

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Given]:
        """Outputs valid at t = 0."""
        if self.batch is not None and len(self.parts) > 1:
            return self.batch.reset(streams)
        each: list[Outputs] = []
        for node, stream in zip(self.nodes, streams, strict=True):
            made = node.component.reset(stream)
            if node.fault is not None:
                node.fault.reset(stream)
                made = node.fault.pass_on(0, made)
            self.check(made)
            each.append(made)
        if len(self.parts) == 1 and not self.slot.latch and len(self.checks) == bool(self.nodes[0].fault):
            self.batch = self._batch()  # which a part that goes in worlds has made anew
        own: Mapping[str, Given] = self.batch.sent if isinstance(self.batch, Op) else {}
        return {name: own.get(name) or by_world(dict(enumerate(each)), name) for name in each[0]}

    def reasons(self, going: Sequence[int], t: int) -> Mapping[int, str]:
        """Why worlds are to end before the tick at t [ns]."""
        batch: Any = self.batch
        if len(self.parts) > 1 and isinstance(batch, EndsWorlds):
            return {w: Ending.by(self.name, batch.reasons[w]) for w in going if batch.reasons.get(w)}
        parts: Sequence[Any] = self.parts
        return {w: Ending.by(self.name, why) for w in going if (why := parts[w].end_reason(t))}

    def check(self, outputs: Any) -> None:
        """WiringError where a component gave what it does not declare."""
        if not isinstance(outputs, dict):
            raise WiringError(f"{self.name}: gave {outputs!r}, expected a dict of {sorted(self.sends)}")
        for output, signal in outputs.items():
            if output not in self.sends:
                given = f"{self.name}.{output}"
                raise WiringError(f"{given}: there is no such output; it has {sorted(self.sends)}")
            if type(signal) is not (kind := self.sends[output]) and not isinstance(signal, kind):
                given = type(signal).__name__
                raise WiringError(f"{self.name}.{output}: gave a {given}, expected a {kind.__name__}")

    def newest(self, latest: Mapping[Wire, Row], world: int) -> dict[str, Any]:
        """Inputs of one world; whoever asks for those of the last one clears `queues`."""
        found: dict[str, Any] = {}
        for name, wire in self.wires:
            row = latest.get(wire) if wire is not None else None
            found[name] = None if row is None else row.view(world)
        for name, queue in self.queues.items():
            found[name] = tuple(queue.samples(world))
        return found

    def newest_of_all(self, latest: Mapping[Wire, Row]) -> dict[str, Any]:
        """Inputs of all worlds at once."""
        found: dict[str, Any] = {}
        for name, wire in self.wires:
            row = latest.get(wire) if wire is not None else None
            found[name] = None if row is None else row.stacked
        for name, queue in self.queues.items():
            found[name] = tuple(row.stacked for row in queue.rows())
            queue.clear()
        return found


def by_world(made: Mapping[int, Outputs], output: str) -> dict[int, Signal]:
    """An output of what parts of some worlds gave."""
    return {world: own[output] for world, own in made.items()}


class Lockstep:
    """Steps graphs whose slots, rates and wires are alike, each of a world; a graph alone is one of one.

    Parts whose class has `together` (`core/together.py`) are stepped at once, all others world by world.
    t [ns]; going, active: worlds that still run, as numbers and as an array; errors: of worlds that cannot
    blocks: what was sent since observers of the graphs looked
    """

    def __init__(self, graphs: Sequence[Graph]) -> None:
        self.graphs: Sequence[Graph] = graphs
        self.t = graphs[0].t
        self.plan = graphs[0].plan
        self.going = list(range(len(graphs)))
        self.active = np.ones(len(graphs), np.bool_)
        self.errors: dict[int, Exception] = {}
        self._failed: list[int] = []
        self.blocks = Blocks()
        self._watched: list[Onlookers] = []
        self._taken: dict[tuple[str, type[Signal]], bool] = {}  # whether somebody takes what a slot sends
        self._audience: dict[tuple[object, ...], list[Audience]] = {}  # by slot and types
        self._looking: dict[str, dict[Any, Any]] = {}  # compiled, by slot and audience
        self._followers: dict[str, list[tuple[int, Observer]]] = {}
        self._looked_at: list[tuple[int, Audience]] | None = None  # ops, by place
        self._enders: list[tuple[int, EndsRun]] | None = None  # who looks on, by world
        self._has_news = True  # for them, since they were asked last
        self._latest: dict[Wire, Row] = {}
        self._before: dict[Wire, Row] = {}
        self._ranks: list[_Rank] = []
        self._program: Program | None = None
        self._until, self._has_room = 0, False  # the next look [ns]; room for what ops send until then
        self._linked: set[Wire] = set()  # what ops read that parts in Python send
        self._readers: dict[Wire, list[Waiting]] = {}  # inputs with a history
        # what ops send that observers take, and to whom of these that are no ops; with its period [ns]
        self._senders: list[tuple[Wire, Row, int]] = []
        self._waits: list[tuple[Waiting, Row, int]] = []
        self.connect()
        for graph in graphs:
            graph.lockstep = self

    def connect(self) -> None:
        """Join outputs and inputs, again where a component was exchanged: what waited at inputs waits on."""
        self._dismiss()
        waiting = {(rank.name, port): queue for rank in self._ranks for port, queue in rank.queues.items()}
        every = zip(*(graph.nodes for graph in self.graphs), strict=True)
        self._ranks = ranks = [_Rank(nodes) for nodes in every]
        batches: list[Any] = [rank.batch for rank in ranks]
        for op in (batch for batch in batches if isinstance(batch, Op)):
            op.active = self.active
        self._names = {rank.name: rank for rank in ranks}
        self._places = {rank.name: place for place, rank in enumerate(ranks)}
        self._ending = [rank for rank in ranks if rank.may_end]
        self._latches = any(rank.slot.latch for rank in ranks)
        self._readers = {}
        for rank in ranks:
            for name, wire in rank.sources.items():
                queue = rank.queues[name] = waiting.get((rank.name, name), rank.queues[name])
                self._readers.setdefault(wire, []).append(queue)
        self.look_around(anew=True)

    def reset(self) -> None:
        """Bring every component to t = 0 and collect the outputs valid there."""
        self.t = 0
        self._dismiss()
        self.go_on()
        self.look_around()
        for graph in self.graphs:
            graph.t, graph.ended = 0, ""
        self._latest.clear()
        for rank in self._ranks:
            for queue in rank.queues.values():
                queue.clear()
        for rank in self._ranks:
            with asking(rank.name):
                made = rank.reset([Stream(graph.seed, rank.name) for graph in self.graphs])
            self._send(rank, 0, made)
        self._before = dict(self._latest)
        self.look()

    def look(self) -> None:
        """Give observers that look now and then what was sent since they did, of worlds that run."""
        self._count_steps()
        self._tell_found()
        self._has_room = False
        trails = self.blocks.take()
        self._has_news |= bool(trails)
        sent = (*[(trail.wire[0], trail.row.kind) for trail, _ in trails],)
        for world in self.going if trails else ():
            if takers := self._watched[world].takers:
                seen = Seen([Block(trail, world, count) for trail, count in trails], sent)
                for taker in takers:
                    taker.take(seen)

    def look_around(self, *, anew: bool = False) -> None:
        """Take note of the observers that there are. anew: of what they look at, too."""
        self._followers, self._has_news = {}, True
        for world, graph in enumerate(self.graphs):
            for slot, follow in graph.follows.items():
                self._followers.setdefault(slot, []).append((world, follow))
        pairs = zip(self._watched, self.graphs, strict=False)
        if self._watched and not anew and all(w.is_same(g.observers, g.watches) for w, g in pairs):
            return
        self._watched = [Onlookers(graph.observers, graph.watches) for graph in self.graphs]
        known, self._taken = self._taken, {}
        if self._looking or any(self._takes(*sent) != taken for sent, taken in known.items()):
            self._dismiss()
        self._forget_audience()
        for taker in (taker for watched in self._watched for taker in watched.takers):
            taker.look = self.look

    def _takes(self, slot: str, kind: type[Signal]) -> bool:
        """Whether an observer takes samples of a type from a slot."""
        found = self._taken.get((slot, kind))
        if found is None:
            found = any(watched.takes(slot, kind) for watched in self._watched)
            self._taken[slot, kind] = found
        return found

    def advance(
        self,
        until: int,
        goal: Goal | None = None,
        stop: Callable[[], bool] | None = None,
        *,
        looks: bool = True,
    ) -> Iterator[list[int]]:
        """Step to a time [ns]; gives worlds as they end: by a part, an EndOfRun, an error (see `errors`), or
        because they have reached the goal. They are no longer stepped. stop: asked after every tick; looks:
        observers look at the end, and not only where they are asked for something.
        """
        self.look_around()
        self._until, self._has_room = until, False
        program = self._prepared(goal)
        while (t := program.next) <= until:
            end = t if stop is not None else self._end_of_walk(program, t, until)
            if end > t:
                self._go(program, end)
                t = program.t
                self._follow(program, t, program.by_place)
            else:
                if over := self._ended_before(t):
                    self.stop(over)
                    yield over
                if not self.going:
                    return
                if self._program is not program:  # a component was exchanged before this tick
                    program = self._prepared(goal)
                self._step_all(program, t)
            self.t = t
            for world in self.going:
                self.graphs[world].t = t
            over, self._failed = self._failed, []
            if goal is not None and program.may_have_reached() and (there := self.reached(goal)).any():
                over += [world for world in self.going if there[world]]
            if stop is not None and stop():
                over = self.going
            if over:
                self.stop(over)
                yield over
                if not self.going:
                    self._dismiss()  # what was due at its last tick may be due still
                    return
            if self._program is not program:  # something came to a slot for the first time, or too much
                program = self._prepared(goal)
        self.t = max(self.t, until)
        for world in self.going:
            self.graphs[world].t = self.t
        if looks:
            self.look()

    def reached(self, goal: Goal) -> NDArray[np.bool_]:
        """Worlds that have reached a goal."""
        found = np.zeros(len(self.graphs), np.bool_)
        for row in (self._latest.get(wire) for wire in goal.wires):
            if row is not None and goal.name in row.arrays:
                found |= row.arrays[goal.name] >= goal.least
        return found

    def _end_of_walk(self, program: Program, t: int, until: int) -> int:
        """Up to before which time compiled code may walk from a tick on [ns]; that tick where it may not."""
        end = min(program.python_due, until + 1)
        if end <= t or any(self.graphs[world].before_tick for world in self.going):
            return t
        for place, awake in self._sleeps(program):
            if awake < end:
                end = min(end, self.plan.slots[place].after(max(awake, t) - 1))
        return t if end <= t or self._parts_end(end - 1) or self._observers_end(end - 1) else end

    def _sleeps(self, program: Program) -> Iterator[tuple[int, int]]:
        """Places of ops that somebody looks at, and from when on [ns] each sample has to be shown."""
        if self._looked_at is None:
            every = ((place, [row.kind for row in sends.values()]) for place, sends in program.sends.items())
            seen = ((place, self._shown_to(self._ranks[place], kinds)) for place, kinds in every)
            self._looked_at = [(place, audience) for place, own in seen for audience in own]
        for place, audience in self._looked_at:
            yield place, audience.sleeps()

    def _step_all(self, program: Program, t: int) -> None:
        """All that is due at a tick: parts in Python one by one, ops between them by compiled code."""
        if self._latches:
            self._before = {wire: row.kept() for wire, row in self._latest.items()}
        awake = {place for place, until in self._sleeps(program) if until <= t}
        for places in program.pieces(t, awake):
            last = places[-1]
            if self._program is not program or last not in program.by_place:
                for place in places:
                    self._step(self._ranks[place], t)
            elif self.going:
                self._go(program, t, last + 1)
                self._follow(program, t, places)
                if last in awake and self.going:
                    self._show(self._ranks[last], t, program.sends[last], is_walked=True)

    def _go(self, program: Program, until: int, before: int = 0) -> None:
        """Walk ops as `Program.walk` does, and give them what they need."""
        if not self._has_room:
            self._reserve()
        need = program.walk(until, before)
        while need is not None:
            (member, op, stage), started = need, time.perf_counter()
            op.needs[0] = 0
            if op is not member.op:
                op.supply(stage)
                self._has_news = True
                program.end_with_tick()  # it may end the world, or want to be shown samples from now on
                need = program.go_on()
                continue
            PRESENT.part = self._ranks[member.place].name
            op.supply(stage)
            PRESENT.part = None
            self._ranks[member.place].cost.seconds += time.perf_counter() - started
            if errors := {world: error for world, error in op.errors.items() if self.active[world]}:
                self._fail(errors)
                program.end_with_tick()
                self._reserve()
            elif isinstance(op, EndsWorlds) and op.reasons:
                program.end_with_tick()  # before the next one they end
            if not self.going:
                return
            need = program.go_on()

    def _reserve(self) -> None:
        """Room for what ops send until the next look."""
        span = self._until - self.t + 1  # times are rounded
        self.blocks.reserve(self._senders, span)
        for queue, row, period in self._waits:
            queue.trail(row).reserve(span // period + 1)
        self._has_room = True

    def _follow(self, program: Program, t: int, places: Collection[int]) -> None:
        """Who follows ops learns of the newest that they sent."""
        for name in self._followers:
            if (place := self._places.get(name, -1)) in places:
                self._tell(name, t, program.sends[place])

    def _show(self, rank: _Rank, t: int, outputs: Mapping[str, Row], *, is_walked: bool = False) -> None:
        """Show what a slot sent to those who look at it at its time.

        is_walked: by compiled code, as what looks at it and is compiled, too
        """
        for op in () if is_walked else self._looking.get(rank.name, {}).values():
            if any(row is given for row in outputs.values() for given in op.given.values()):
                op.clock[1] = t
                op.go()
                self._has_news = True
        for audience in self._shown_to(rank, [row.kind for row in outputs.values()]):
            self._has_news |= audience.show(rank.name, t, outputs, self.blocks) and audience.may_end

    def _tell(self, slot: str, t: int, outputs: Mapping[str, Row]) -> None:
        """Tell who follows a slot of its newest sample."""
        for world, follow in self._followers.get(slot, ()):
            if self.active[world]:
                follow(slot, t, Shown(outputs, world))

    def _prepared(self, goal: Goal | None) -> Program:
        """The program of the components and observers that there are."""
        program = self._program
        if program is None or not program.aim(goal, self.active):
            self._dismiss()
            program = self._program = self._compile(goal)
            program.aim(goal, self.active)
            self._has_room = False
        return program

    def _compile(self, goal: Goal | None) -> Program:
        """Link ops with what they read, and write their program."""
        clock = np.zeros(3, np.int64)
        ops: dict[str, Any] = {}
        if not self._latches:
            ops = {rank.name: rank.batch for rank in self._ranks if rank.is_op}
        while wrong := [name for name in ops if not self._link(name, ops, clock)]:
            self._loosen()  # those that read from these have to be linked anew
            for name in wrong:
                del ops[name]
        members = list[Member]()
        self._senders, self._waits = [], []
        for place, rank in enumerate(self._ranks):
            if (op := ops.get(rank.name)) is None:
                continue
            keeps, period = {}, max(int(rank.slot.period), 1)
            for output, row in op.sent.items():
                wire = rank.name, output
                keeps[output] = [self.blocks.head(wire)] if self._takes(rank.name, row.kind) else []
                self._senders += [(wire, row, period)] if keeps[output] else []
                if (latest := self._latest[wire]) is not row:
                    row.take(latest.stacked)
                    self._latest[wire] = row
                queues = self._readers.get(wire, ())
                keeps[output] += [queue.trail(row).head for queue in queues]
                self._waits += [(queue, row, period) for queue in queues if not queue.trail(row).is_fixed]
            members.append(Member(place, op, keeps))
        self._set_looking({r.name: own for r in self._ranks if (own := self._looks_at(r, clock))})
        for member in members:
            member.lookers = [*self._looking.get(self._ranks[member.place].name, {}).values()]
        return Program(self.t, self.plan.slots, members, clock, goal, self.blocks.order)

    def _looks_at(self, rank: _Rank, clock: Ints) -> dict[Any, Any]:
        """What looks, compiled, at what a slot sends, by whom it looks for."""
        machine, found = rank.name.partition(".")[0], {}
        near = {w: row for w, row in self._latest.items() if w[0] in self._names}
        own = [row for (slot, _), row in near.items() if slot == rank.name]
        beside = [row for (slot, _), row in near.items() if slot.partition(".")[0] == machine]
        kinds = (*(row.kind for row in own),)
        for audience in audiences(dict(enumerate(self._watched)), rank.name, kinds):
            is_whole = len(audience.worlds) == len(self.graphs)
            if (op := audience.looking(rank.name, kinds) if is_whole else None) is None:
                continue
            fits = {
                port: [row for row in own if issubclass(row.kind, kind)]
                or [row for row in beside if issubclass(row.kind, kind)]
                for port, kind in op.reads.items()
            }
            if all(len(rows) == 1 for rows in fits.values()):
                op.active, op.blocks = self.active, self.blocks
                op.link({port: row for port, (row,) in fits.items()}, {}, clock)
                if op.calls() is not None:
                    found[audience.key] = op
        return found

    def _link(self, name: str, ops: Mapping[str, Any], clock: Ints) -> bool:
        """Let an op read where its inputs lie; False where that cannot be."""
        rank = self._names[name]
        every = {port: wire for port, wire in [*rank.wires, *rank.sources.items()] if wire is not None}
        rows = {port: self._row(ops, wire) for port, wire in every.items()}
        known = {port: row for port, row in rows.items() if row is not None}
        if len(known) < len(rows):
            return False
        trails, op = {}, ops[name]
        self._linked.update(every.values())
        for row in known.values():
            row.check()
        for port in rank.sources:
            row = known[port]
            sender = self._names[rank.sources[port][0]]
            longest = rank.slot.period + rank.slot.offset  # of its steps
            trails[port] = rank.queues[port].fixed(row, longest // sender.slot.period + 2)
        op.link(known, trails, clock)
        return op.calls() is not None

    def _row(self, ops: Mapping[str, Any], wire: Wire) -> Row | None:
        """Where the newest sample of an output lies; None where compiled code cannot read it."""
        slot, output = wire
        row: Row | None = ops[slot].sent[output] if slot in ops else self._latest.get(wire)
        return None if row is None or row.has_objects or slot not in self._names else row

    def _dismiss(self) -> None:
        """Forget the program; what waits at inputs waits on."""
        self._count_steps()
        self._loosen()
        self._tell_found()
        self._set_looking({})
        self._program, self._looked_at = None, None

    def _set_looking(self, looking: dict[str, dict[Any, Any]]) -> None:
        """Who looks, compiled: no samples are shown to whom it looks for."""
        if looking or self._looking:
            self._looking = looking
            self._forget_audience()

    def _tell_found(self) -> None:
        """Who looks on learns what was found for it."""
        for own in self._looking.values():
            for op in own.values():
                op.look()

    def _loosen(self) -> None:
        """Nothing is read by compiled code."""
        self._linked = set()
        for trail in (t for queues in self._readers.values() for queue in queues for t in queue.trails):
            trail.is_fixed = False

    def _count_steps(self) -> None:
        """What the steps of ops took, into the costs of their slots."""
        program = self._program
        if program is None or not program.seconds:
            return
        cycles = int(np.add.reduce([member.about[1] + member.aside[1] for member in program.members]))
        for member in program.members:
            cost = self._ranks[member.place].cost
            cost.steps += int(member.about[0])
            cost.seconds += program.seconds * int(member.about[1]) / max(cycles, 1)
            member.about[:] = member.aside[:] = 0
        program.seconds = 0.0

    def go_on(self) -> None:
        """Step all of them, those too that have ended."""
        if not self.active.all():
            self.active[:], self.going = True, list(range(len(self.graphs)))
            self._forget_audience()

    def stop(self, worlds: Iterable[int]) -> None:
        """Step these no longer."""
        self.look()
        over = [*worlds]
        self.active[over] = False
        self.going = np.flatnonzero(self.active).tolist()
        self._forget_audience()
        if self._program is not None and self._program.goal is not None:
            self._program.least[over] = np.inf

    def let_go(self) -> None:
        """Forget a graph that was alone, and who looks on."""
        if len(self.graphs) == 1:
            self.graphs, self._watched, self._followers, self._looking = (), [], {}, {}
            self._forget_audience()
            for part in (rank.parts[0] for rank in self._ranks):
                if isinstance(part, InWorlds):
                    part.alone = None  # which holds the part

    def raise_error(self) -> None:
        """Raise what the part of a graph alone raised."""
        if self.errors:
            raise self.errors.pop(0)

    def newest(self, wire: Wire) -> Row | None:
        """The newest samples of an output; those of worlds that have ended mean nothing."""
        return self._latest.get(wire)

    def place(self, graph: Graph) -> int:
        """The number of a graph."""
        return self.graphs.index(graph) if len(self.graphs) > 1 else 0

    def put(self, wire: Wire, sample: Signal) -> None:
        """A sample from outside, for a graph alone."""
        self._arrive(wire, sample.t, {0: sample})

    def take_out(self, world: int) -> None:
        """Its graph is alone from now on: what it sent last stays, and it can be finished."""
        graph = self.graphs[world]
        for rank in self._ranks:
            part = rank.parts[world]
            if rank.batch is not None and isinstance(part, StepsAnyLength) and len(self.graphs) > 1:
                part.reset(Stream(graph.seed, rank.name))
                part.load(rank.batch.save(world))
        saved = self.save(world)
        Lockstep([graph]).load(saved)

    def finish(self) -> None:
        """As `Graph.finish`, of a graph alone."""
        self.go_on()
        self.look_around()
        for rank in self._ranks:
            slot, part, queues = rank.slot, rank.parts[0], rank.queues
            waits = any(queues.values()) or not queues
            last = slot.due(slot.count(self.t))
            if waits and last < self.t and isinstance(part, StepsAnyLength) and part.steps_any_length:
                with asking(rank.name):
                    made = part.step(last, self.t - last, self._inputs(rank, 0))
                for queue in queues.values():
                    queue.clear()
                if (fault := rank.nodes[0].fault) is not None:
                    made = fault.pass_on(self.t, made)
                rank.check(made)
                self._send(rank, self.t, {name: {0: signal} for name, signal in made.items()})
        self.look()

    def save(self, world: int = 0) -> State:
        """What was sent last, and what waits at inputs, of one world."""
        every = ((rank.name, port, queue) for rank in self._ranks for port, queue in rank.queues.items())
        return {
            "t": self.graphs[world].t,
            "latest": {wire: row.view(world) for wire, row in self._latest.items()},
            "queues": {(name, port): queue.samples(world) for name, port, queue in every},
        }

    def load(self, state: Mapping[str, Any]) -> None:
        """Back to it, of a graph alone."""
        self._dismiss()
        self.t = self.graphs[0].t = state["t"]
        self._latest = {wire: row_with(sample) for wire, sample in state["latest"].items()}
        for rank in self._ranks:
            for port, queue in rank.queues.items():
                queue.set(state["queues"][rank.name, port])

    def _ended_before(self, t: int) -> list[int]:
        """Worlds that end before the tick at t [ns]; their graphs know why."""
        found = self._parts_end(t)
        for world in self.going:
            graph = self.graphs[world]
            if world not in found and graph.before_tick:
                try:
                    for wait in graph.before_tick:
                        wait(t)
                except EndOfRun as end:
                    found[world] = str(end)
        found = {**self._observers_end(t), **found}
        for world, reason in found.items():
            self.graphs[world].ended = reason
        return list(found)

    def _parts_end(self, t: int) -> dict[int, str]:
        """Worlds that a part wants to end before a tick, and why; once it does, it does later, too."""
        found: dict[int, str] = {}
        for rank in self._ending:
            found = {**rank.reasons(self.going, t), **found}
        return found

    def _observers_end(self, t: int) -> dict[int, str]:
        """The same of those that look on."""
        if self._enders is None:
            self._has_news = True
            self._enders = [(world, e) for world in self.going for e in self._watched[world].enders]
        asked = self._enders if self._has_news else ()
        found = [(world, reason) for world, ender in asked if (reason := ender.end_reason(t))]
        self._has_news = bool(found)  # once one does, it does later, too
        return dict(reversed(found))

    def _step(self, rank: _Rank, t: int) -> None:
        dt, batch = rank.slot.length(t), rank.batch
        outputs: Mapping[str, Given]
        started, PRESENT.part = time.perf_counter(), rank.name
        if batch is None:
            outputs = self._step_each(rank, t, dt)
        else:
            outputs = batch.step(t - dt, dt, rank.newest_of_all(self._latest))
            if batch.errors:
                self._fail(batch.errors)
            if rank.checks:
                self._check(rank, t, outputs)
        PRESENT.part = None
        rank.cost.seconds += time.perf_counter() - started
        rank.cost.steps += 1
        if self.going:
            self._send(rank, t, outputs)

    def _check(self, rank: _Rank, t: int, outputs: Mapping[str, Samples]) -> None:
        """Look at the samples of a part that is not swath's own, in every world."""
        wrong: dict[int, Exception] = {}
        for world in self.going:
            if (fault := rank.nodes[world].fault) is not None:
                try:
                    fault.pass_on(t, {name: samples.of(world) for name, samples in outputs.items()})
                except SwathError as error:
                    wrong[world] = error
        if wrong:
            self._fail(wrong)

    def _step_each(self, rank: _Rank, t: int, dt: int) -> Mapping[str, Given]:
        """Step the parts of a slot world by world."""
        made: dict[int, Outputs] = {}
        for world in self.going:
            node = rank.nodes[world]
            try:
                own = node.component.step(t - dt, dt, self._inputs(rank, world))
                if node.fault is not None:
                    own = node.fault.pass_on(t, own)
                rank.check(own)
            except (Exception, SystemExit) as error:  # a user's own part may raise anything
                self.errors[world] = of_exit(error) if isinstance(error, SystemExit) else error
                continue
            made[world] = own
        for queue in rank.queues.values():
            queue.clear()
        if len(made) < len(self.going):
            self._fail({world: self.errors[world] for world in self.going if world not in made})
        return {name: by_world(made, name) for name in next(iter(made.values()), {})}

    def _inputs(self, rank: _Rank, world: int) -> dict[str, Any]:
        return rank.newest(self._before if rank.slot.latch else self._latest, world)

    def _fail(self, errors: Mapping[int, Exception]) -> None:
        """Worlds that cannot go on, those of them that still run."""
        failed = {world: error for world, error in errors.items() if self.active[world]}
        self.errors |= failed
        self._failed += failed
        self.stop(failed)

    def _send(self, rank: _Rank, t: int, outputs: Mapping[str, Given]) -> None:
        """Publish what a slot gave at t in every world."""
        rows = {output: self._arrive((rank.name, output), t, given) for output, given in outputs.items()}
        self.blocks.add(rank.name, t, {o: r for o, r in rows.items() if self._takes(rank.name, r.kind)})
        self._tell(rank.name, t, rows)
        self._show(rank, t, rows)

    def _arrive(self, wire: Wire, t: int, given: Given) -> Row:
        """The newest sample of an output: who reads it has it from now on; where it lies."""
        row = latest = self._latest.get(wire)
        if isinstance(given, Row):
            row = given
            row.renew()
        else:
            kind = given.kind if isinstance(given, Samples) else type(next(iter(given.values())))
            if row is None or row.kind is not kind or not row.is_held:
                row = held_row(kind, len(self.graphs))
            try:
                row.take(given)
            except SwathError as error:
                raise SwathError(f"{wire[0]}.{wire[1]}: {error}") from error
        if row is not latest:  # what reads it has to be linked to it
            self._dismiss()
            self._latest[wire] = row
        if wire in self._linked:
            row.check()
        for trail in [queue.trail(row) for queue in self._readers.get(wire, ())]:
            if trail.is_full:
                self._dismiss()
            trail.append(t)
        return row

    def _forget_audience(self) -> None:
        """Other worlds run, or others look on."""
        self._audience, self._looked_at, self._enders = {}, None, None

    def _shown_to(self, rank: _Rank, kinds: Sequence[type[Signal]]) -> list[Audience]:
        """Who of the worlds that run has to be shown samples of these types from a slot."""
        key = rank.name, *kinds
        if key not in self._audience:
            own, compiled = {w: self._watched[w] for w in self.going}, self._looking.get(rank.name, {})
            every = audiences(own, rank.name, (*kinds,))
            self._audience[key] = [audience for audience in every if audience.key not in compiled]
        return self._audience[key]
