"""One slot of a scenario without the others: what it takes comes from outside, what it gives is kept."""

import os
from collections import deque
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from swath.core.component import Port
from swath.core.errors import InputError
from swath.core.graph import Observer
from swath.core.number_text import num
from swath.core.schedule import NS
from swath.record.read.feed import exact_samples, exact_topic
from swath.record.read.files import Log
from swath.runtime.assembly import assemble
from swath.scenario.scenario import Scenario, short_names, slot_names
from swath.signals import MachineState, Signal

Output = tuple[str, str]  # full name of a slot, its output


class Arrival(NamedTuple):
    """A sample that is published at t [ns]."""

    t: int
    output: Output
    sample: Signal


class IsolatedPart:
    """A slot in a world of its own.

    ports: what it takes from outside; needed: those that it cannot do without
    given: what it gives, but for what is recorded with full detail only
    names: full name of a slot -> what a table calls it
    """

    def __init__(self, scenario: Scenario, slot: str) -> None:
        self.slot, self.names = slot, short_names(scenario)
        self._order = slot_names(scenario)
        self.world = assemble(scenario, only=[slot])
        graph = self.world.graph
        (self.node,) = graph.nodes
        outside = graph.outside.items()
        self.ports: dict[Output, Port] = {(s, o): p for s, ports in outside for o, p in ports.items()}
        wires = self.node.wires
        self.needed = {wires[p.name] for p in self.node.component.inputs if not p.optional}
        sent = {(slot, p.name): p for p in self.node.component.outputs}
        self.given = {key: p for key, p in sent.items() if p.signal.about.samples != "full"}

    def column(self, output: Output, number: str) -> str:
        """The name of a number in a table: `header.flow.grain`."""
        return f"{self.names.get(output[0], output[0])}.{output[1]}.{number}"

    def run(
        self, arrivals: Iterable[Arrival], *, end: int = 0, observers: Sequence[Observer] = ()
    ) -> list[Arrival]:
        """From t = 0 to the last arrival, or to `end` [ns] where that is later; returns what the slot gave.

        At each of its steps the slot sees what it would see in the machine: what was published before, and
        what slots that run earlier in the order of the scenario published at this very moment. InputError
        where an output that it needs has no sample by its first step.
        """
        graph, rank = self.world.graph, {name: i for i, name in enumerate(self._order)}
        is_late = {o: self.node.slot.latch or rank.get(o[0], -1) > rank[self.slot] for o in self.ports}
        waiting = deque(sorted(arrivals, key=lambda a: (a.t, is_late[a.output])))
        end = max(end, waiting[-1].t if waiting else 0)
        first, _ = next(((t, due) for t, due in graph.plan.walk(0, end) if due), (end + 1, ()))
        there = {a.output for a in waiting if (a.t, is_late[a.output]) <= (first, False)}
        lists = {self.node.wires[p.name] for p in self.node.component.inputs if p.history}
        if first <= end and (lacking := sorted(".".join(o) for o in self.needed - there - lists)):
            expected = f"expected a sample by its first step at {num(first / NS)} s"
            raise InputError(", ".join(lacking), None, expected)
        found: list[Arrival] = []

        def feed(t: int) -> None:
            while waiting and (waiting[0].t, is_late[waiting[0].output]) <= (t, False):
                put(waiting.popleft())

        def put(arrival: Arrival) -> None:
            slot, output = arrival.output
            graph.put(slot, output, arrival.sample)
            if isinstance(arrival.sample, MachineState):
                self.world.place_bodies(slot, arrival.t, {output: arrival.sample})

        def keep(slot: str, t: int, outputs: dict[str, Signal]) -> None:
            found.extend(Arrival(t, (slot, o), s) for o, s in outputs.items() if (slot, o) in self.given)

        graph.before_tick.insert(0, feed)
        graph.observers = [keep, *observers]
        try:
            self.world.reset()
            graph.run(end)
            while waiting:
                put(waiting.popleft())
            graph.finish()
        finally:
            graph.before_tick.remove(feed)
        return found

    def recorded(self, log: Log) -> list[Arrival]:
        """What the slot took in a recorded run, bit for bit.

        InputError naming every output that it needs and the recording does not hold sample by sample.
        """
        topics, held = {o: exact_topic(*o) for o in self.ports}, log.topics()
        lacking = sorted(".".join(o) for o in self.needed if topics[o] not in held)
        if lacking:
            expected = f"expected every sample (run.record: exact) of {', '.join(lacking)}"
            raise InputError("--input", str(log.path), expected)
        return [
            Arrival(published, output, sample)
            for output, topic in topics.items()
            if topic in held
            for published, sample in exact_samples(log.messages((topic,)))
        ]


def is_table(path: Path) -> bool:
    """True for what is read as CSV."""
    return os.path.isfile(path) and path.suffix.lower() in (".csv", ".txt")
