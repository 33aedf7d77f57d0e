"""Components, their connections and the schedule: a runnable, saveable whole."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from swath.core.abilities import StepsAnyLength
from swath.core.component import Component, Outputs, Port, State, check_fit
from swath.core.errors import WiringError
from swath.core.fault import FaultyOutput
from swath.core.random import Stream
from swath.core.schedule import Plan, Slot, make_plan
from swath.core.signal import Signal

Wire = tuple[str, str]
Observer = Callable[[str, int, Outputs], None]
Queue = list[Signal]
Held = dict[str, Any]  # what a component will be given, by port
Readers = tuple[list[tuple[Held, str]], list[Queue]]  # of an output: those of the newest sample, of every one
Sends = tuple[type[Signal], Wire, list[tuple[Held, str]], list[Queue]]  # type, place of the newest, readers
NOBODY: Readers = [], []


@dataclass
class Node:
    """A component in its slot. wires: input name -> (source slot, output name).

    fault: what goes wrong with what the slot sends, whatever component fills it
    """

    slot: Slot
    component: Component
    wires: dict[str, tuple[str, str]] = field(default_factory=dict)
    fault: FaultyOutput | None = None
    cost_s: float = 0.0
    step_count: int = 0


@dataclass(slots=True)
class _Links:
    """What joins a node to others, looked up once.

    gathers: not all of its inputs are the newest samples
    wires: port of which the newest sample is read -> where that is; held: these samples, kept up to date
    queues: port -> samples since the last step; sends: by output
    """

    node: Node
    gathers: bool
    wires: list[tuple[str, Wire | None]]
    held: Held
    queues: list[tuple[str, Queue]]
    sends: dict[str, Sends]


class EndOfRun(Exception):
    """Raised by a `before_tick`: the run ends before that tick. Its text says why."""


class Graph:
    """Runs the components of a scenario by their plan.

    observers are called with (slot name, time [ns], outputs) after every step, in order; they must not
    change anything that a component reads. watches: slot -> the same for this slot alone, called before
    them. before_tick: called with the time [ns] of a tick before its steps
    run, for those who wait (a real clock, a paused run); they change no result, but may raise EndOfRun
    ended: why a run stopped before its end, empty where it did not
    outside: slots that are not in this graph -> their outputs; whoever runs it puts their samples in
    """

    def __init__(
        self, nodes: list[Node], seed: int, *, outside: Mapping[str, Mapping[str, Port]] | None = None
    ) -> None:
        self.nodes = nodes
        self.seed = seed
        self.outside = dict(outside or {})
        self.t = 0
        self.ended = ""
        self.plan: Plan = make_plan([n.slot for n in nodes])
        self.observers: list[Observer] = []
        self.watches: dict[str, Observer] = {}
        self.before_tick: list[Callable[[int], None]] = []
        self._names = {n.slot.name: n for n in nodes}
        self._latest: dict[tuple[str, str], Signal] = {}
        self._before: dict[tuple[str, str], Signal] = {}
        self._queues: dict[tuple[str, str], Queue] = {}  # by slot and port
        self._links: dict[str, _Links] = {}
        self._steps: list[_Links] = []  # the same in the order of the nodes
        self._readers: dict[Wire, Readers] = {}
        self._connect()
        self._latches = any(n.slot.latch for n in nodes)

    def reset(self) -> None:
        """Bring every component to t = 0 and collect the outputs valid there."""
        self.t = 0
        self.ended = ""
        self._latest.clear()
        for queue in self._queues.values():
            queue.clear()
        self._hold()
        for links in self._steps:
            node = links.node
            stream = Stream(self.seed, node.slot.name)
            outputs = node.component.reset(stream)
            if node.fault is not None:
                node.fault.reset(stream)
            self._send(links, 0, outputs)
        self._before = dict(self._latest)

    def run(self, until: int, stop: Callable[[], bool] | None = None) -> None:
        """Advance to time `until` [ns], or to the first tick after which `stop()` is true."""
        clock = time.perf_counter
        for t, due in self.plan.walk(self.t, until):
            try:
                for wait in self.before_tick:
                    wait(t)
            except EndOfRun as end:
                self.ended = str(end)
                return
            if self._latches:
                self._before = dict(self._latest)
            steps = self._steps  # others where a component was exchanged before this tick
            for index in due:
                links = steps[index]
                node, period = links.node, links.node.slot.period
                started = clock()
                inputs = self._gather(links) if links.gathers else links.held.copy()
                outputs = node.component.step(t - period, period, inputs)
                node.cost_s += clock() - started
                node.step_count += 1
                self._send(links, t, outputs)
            self.t = t
            if stop is not None and stop():
                return
        self.t = max(self.t, until)

    def finish(self) -> None:
        """The end: parts that can (`StepsAnyLength`) take in what was sent to them since their last step."""
        for links in self._steps:
            slot = links.node.slot
            queues = [queue for _, queue in links.queues]
            waits = any(queues) or not queues
            last = slot.offset + max(self.t - slot.offset, 0) // slot.period * slot.period
            part = links.node.component
            if waits and last < self.t and isinstance(part, StepsAnyLength) and part.steps_any_length:
                self._send(links, self.t, part.step(last, self.t - last, self._gather(links)))

    def finish_from(self, queues: Mapping[tuple[str, str], list[Signal]]) -> None:
        """`finish`, of a graph whose parts were stepped by somebody else. queues: by slot and port"""
        for key, queue in self._queues.items():
            queue[:] = queues.get(key, ())
        self.finish()

    def let_go(self) -> None:
        """Forget those who watch and wait. They may hold the graph, too: then both go when nobody uses them,
        and not whenever Python looks for such circles.
        """
        self.observers, self.watches, self.before_tick = [], {}, []

    def put(self, slot: str, output: str, sample: Signal) -> None:
        """A sample from outside: components that step from now on see it."""
        self._latest[(slot, output)] = sample
        readers, queues = self._readers.get((slot, output), NOBODY)
        for held, port in readers:
            held[port] = sample
        for queue in queues:
            queue.append(sample)

    def latest(self, slot: str, output: str) -> Signal | None:
        """The newest sample of an output, None before there is one."""
        return self._latest.get((slot, output))

    def exchange(
        self, slot: str, component: Component, wires: Mapping[str, Wire], state: State | None = None
    ) -> None:
        """Another component in a slot, from its next step on.

        It begins with `reset`, at the present time, or goes on from `state`; what the slot sent last stays
        until it sends anew. The period stays. Raises WiringError when it does not fit, and what the component
        raises; then nothing has changed.
        """
        component.reset(Stream(self.seed, slot))
        if state is not None:
            component.load(state)
        node, queues = self._names[slot], self._queues
        before = node.component, node.wires
        node.component, node.wires = component, dict(wires)
        try:
            self._connect()
        except WiringError:
            node.component, node.wires = before
            self._connect()
            raise
        finally:
            for key, queue in self._queues.items():
                queue += queues.get(key, ())

    def save(self) -> State:
        """Everything needed to go on from here, byte for byte."""
        return {
            "t": self.t,
            "components": {n.slot.name: n.component.save() for n in self.nodes},
            "faults": {n.slot.name: n.fault.save() for n in self.nodes if n.fault is not None},
            "latest": dict(self._latest),
            "queues": {k: list(v) for k, v in self._queues.items()},
        }

    def load(self, state: Mapping[str, Any]) -> None:
        """Go back to a saved moment. Components are reset first, so that each knows its random stream."""
        told = self.observers, self.watches
        self.observers, self.watches = [], {}
        self.reset()
        self.observers, self.watches = told
        self.t = state["t"]
        for node in self.nodes:
            node.component.load(state["components"][node.slot.name])
            if node.fault is not None:
                node.fault.load(state["faults"][node.slot.name])
        self._latest = dict(state["latest"])
        for key, queue in self._queues.items():
            queue[:] = state["queues"][key]
        self._hold()

    def _connect(self) -> None:
        """Check every wire; note who reads what, and who wants every sample."""
        self._queues = {}
        for node in self.nodes:
            ports = {p.name: p for p in node.component.inputs}
            for name in node.wires:
                if name not in ports:
                    raise WiringError(
                        f"{node.slot.name}.{name}: there is no such input; it has {sorted(ports)}"
                    )
            for port in ports.values():
                if port.name not in node.wires:
                    if port.optional:
                        continue
                    raise WiringError(f"{node.slot.name}.{port.name}: input is not connected")
                source, output = node.wires[port.name]
                check_fit(source, self._output_port(source, output, node, port), node.slot.name, port)
                if port.history:
                    self._queues[node.slot.name, port.name] = []
        self._steps = [self._links_of(n) for n in self.nodes]
        self._links = {links.node.slot.name: links for links in self._steps}
        self._join()

    def _join(self) -> None:
        """Give each output its readers."""
        self._readers = {}
        for node in self.nodes:
            links = self._links[node.slot.name]
            for name, source in links.wires:
                if source is not None:
                    self._readers.setdefault(source, ([], []))[0].append((links.held, name))
            for name, queue in links.queues:
                self._readers.setdefault(node.wires[name], ([], []))[1].append(queue)
        for slot, part in ((n.slot.name, n.component) for n in self.nodes):
            for port in part.outputs:
                wire = slot, port.name
                sends = port.signal, wire, *self._readers.get(wire, ([], []))
                self._links[slot].sends[port.name] = sends
        self._hold()

    def _links_of(self, node: Node) -> _Links:
        name, ports = node.slot.name, node.component.inputs
        wires = [(p.name, node.wires.get(p.name)) for p in ports if (name, p.name) not in self._queues]
        queues = [(p.name, self._queues[name, p.name]) for p in ports if (name, p.name) in self._queues]
        return _Links(node, node.slot.latch or bool(queues), wires, {}, queues, {})

    def _hold(self) -> None:
        """What each component will be given, from the newest samples."""
        for links in self._links.values():
            links.held.update((port, self._latest.get(wire) if wire else None) for port, wire in links.wires)

    def _output_port(self, source: str, output: str, node: Node, port: Port) -> Port:
        end = f"{source}.{output} -> {node.slot.name}.{port.name}"
        if source not in self._names and source not in self.outside:
            raise WiringError(f"{end}: there is no slot {source}; there are {sorted(self._names)}")
        ports = dict(self.outside.get(source, {}))
        if source in self._names:
            ports = {p.name: p for p in self._names[source].component.outputs}
        if output not in ports:
            raise WiringError(f"{end}: {source} has no output {output}; it has {sorted(ports)}")
        return ports[output]

    def _gather(self, links: _Links) -> dict[str, Any]:
        values = links.held.copy()
        if links.node.slot.latch:
            values.update((port, self._before.get(wire) if wire else None) for port, wire in links.wires)
        for port, queue in links.queues:
            values[port] = tuple(queue)
            queue.clear()
        return values

    def _send(self, links: _Links, t: int, outputs: Outputs) -> None:
        """Publish what a component gave at t, as its fault leaves it."""
        node, sends, latest = links.node, links.sends, self._latest
        if node.fault is not None:
            outputs = node.fault.pass_on(t, outputs)
        name = node.slot.name
        if not isinstance(outputs, dict):
            raise WiringError(f"{name}: gave {outputs!r}, expected a dict of {sorted(sends)}")
        for output, signal in outputs.items():
            if output not in sends:
                raise _unfit(name, output, signal, sends)
            wanted, wire, readers, queues = sends[output]
            if type(signal) is not wanted and not isinstance(signal, wanted):
                raise _unfit(name, output, signal, sends)
            latest[wire] = signal
            for held, port in readers:
                held[port] = signal
            for queue in queues:
                queue.append(signal)
        if (watch := self.watches.get(name)) is not None:
            watch(name, t, outputs)
        for observe in self.observers:
            observe(name, t, outputs)


def _unfit(slot: str, output: str, signal: Any, sends: Mapping[str, Sends]) -> WiringError:
    if output not in sends:
        return WiringError(f"{slot}.{output}: there is no such output; it has {sorted(sends)}")
    given = type(signal).__name__
    return WiringError(f"{slot}.{output}: gave a {given}, expected a {sends[output][0].__name__}")
