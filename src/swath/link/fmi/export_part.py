"""Some slots of a scenario as one system with inputs, outputs and communication steps: what an FMU runs.

The slots keep their rates and their order. A communication step from t to t + h runs every step of theirs
that is due in (t, t + h], with the inputs held; outputs are the newest samples. So h may be any, shorter or
longer than a slot's period or no multiple of it: the slots are sampled by their own clocks. Times are kept in
whole microseconds, or are those of samples that are due within half of one.

Amounts (kg, m2, stems of a flow) are per `dt`: an input means the rate amount / dt over the communication
step, or with dt = 0 the amount in this step; an output is the sum over the step, with dt = h. Nothing is lost
or counted twice when sender and receiver have the same steps, or the receiver's divide the sender's.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

from swath.core.component import KeepsState, Outputs
from swath.core.errors import InputError
from swath.core.graph import Graph
from swath.core.schedule import NS, Slot
from swath.runtime.world import World
from swath.signals import MachineState, Signal
from swath.signals.flat import amounts, build, read

MICRO = 1_000
Source = tuple[str, str]  # slot, output


@dataclasses.dataclass
class Held(KeepsState):
    """An input sample as it was set: values by number, held until set again.

    is_given: False while nothing is known of it, which the component sees as None
    """

    kept = ("values", "is_given")
    values: dict[str, Any]
    is_given: bool

    def set(self, name: str, value: Any) -> None:
        """One number, or an array; `t` is the time of the sample [s], < 0 = now."""
        self.values[name] = value
        self.is_given = True


class Feed(KeepsState):
    """Puts one input into a graph: where samples queue up, each arrives once and every amount is kept."""

    kept = ("held", "_pending", "_length", "_sample", "_is_fresh")

    def __init__(
        self, graph: Graph, source: Source, held: Held, readers: list[Slot], is_queued: bool
    ) -> None:
        self.held, self._graph, self._source = held, graph, source
        self._signal = graph.outside[source[0]][source[1]].signal
        self._readers, self._is_queued = readers, is_queued
        self._amounts = _sums(self._signal) if is_queued else ()
        self._since, self._step = 0, 1
        self._sample: Signal | None = None
        self.start()

    def start(self) -> None:
        """What there is at t = 0; amounts begin with the first step."""
        self._sample, self._is_fresh, self._length = None, False, 0
        self._pending = dict.fromkeys(self._amounts, 0.0)
        if self.held.is_given and not self._amounts:
            self.put(0)

    def begin(self, start: int, end: int, first: int) -> None:
        """A communication step [ns]; first: the first tick in it, or its end."""
        self._since = start
        length = float(self.held.values.get("dt", 0.0)) if self._amounts else 0.0
        self._step = round(length * NS) if length > 0.0 else end - start
        if self.held.is_given and not self._amounts:
            self.put(first)

    def put(self, t: int) -> None:
        """The sample as it is set now, valid at t [ns] unless it says when."""
        values = dict(self.held.values)
        stamp = float(values.pop("t", -1.0))
        self._sample = build(self._signal, t if stamp < 0.0 else round(stamp * NS), values)
        self._graph.put(*self._source, self._sample)
        self._is_fresh = True

    def at_tick(self, t: int) -> None:
        """Before the steps of a tick [ns]: what has come up to now, if a slot takes it."""
        if not self._is_queued or not self.held.is_given:
            return
        if not any(s.after(t - 1) == t for s in self._readers):
            return
        if self._amounts:
            self.gather(t)
            values = {**self.held.values, **self._pending, "dt": self._length / NS}
            self._graph.put(*self._source, build(self._signal, t, values))
            self._pending, self._length = dict.fromkeys(self._amounts, 0.0), 0
        elif not self._is_fresh and self._sample is not None:
            self._graph.put(*self._source, dataclasses.replace(self._sample, t=t))
        self._is_fresh = False

    def gather(self, t: int) -> None:
        """Add up what came since the last time, up to t [ns]."""
        if self._amounts and self.held.is_given and t > self._since:
            share = (t - self._since) / self._step
            for name in self._amounts:
                self._pending[name] += self.held.values[name] * share
            self._length += t - self._since
            self._since = t


class Part(KeepsState):
    """Runs a world that was assembled with `only`; `inputs`: what its graph has outside, as it is set."""

    kept = ("world", "_feeds", "_sums", "_origin", "_step_s")

    def __init__(self, world: World, inputs: Mapping[Source, Held]) -> None:
        self.world, graph = world, world.graph
        self._feeds = {s: Feed(graph, s, held, *_readers(graph, s)) for s, held in inputs.items()}
        self._sums: dict[Source, Signal] = {}
        self._is_counting = False
        self._origin: int | None = None
        self._step_s = 0.0
        graph.observers = [self._count]
        graph.before_tick += [feed.at_tick for feed in self._feeds.values()]

    @property
    def t(self) -> float:
        """Simulated time [s] since the first communication point."""
        return self.world.graph.t / NS

    def reset(self) -> None:
        """To t = 0, with the inputs as they are set now."""
        self._is_counting = False
        self._sums.clear()
        self._origin = None
        self.world.graph.reset()
        for source, feed in self._feeds.items():
            feed.start()
            self._place(source)

    def step(self, t: float, h: float) -> None:
        """One communication step from t to t + h [s]. InputError when it does not go on from the last one."""
        if self._origin is None:
            self._origin = _whole(t)
        begin, end = (self._since(_whole(point) - self._origin) for point in (t, t + h))
        graph = self.world.graph
        if begin != graph.t:
            at = (graph.t + self._origin) / NS
            raise InputError("communication point", round(t, 6), f"expected {at:g} s, where the FMU stands")
        if end <= begin:
            raise InputError("communication step", h, "expected at least 1e-6 s")
        self._sums.clear()
        self._is_counting = True
        first = next((tick for tick, _ in graph.plan.walk(begin, end)), end)
        for source, feed in self._feeds.items():
            feed.begin(begin, end, first)
            self._place(source)
        graph.run(end)
        for feed in self._feeds.values():
            feed.gather(end)
        self._is_counting = False
        self._step_s = (end - begin) / NS

    def _since(self, at: int) -> int:
        """A time since the first communication point [ns], or that of a sample that is due about then."""
        due = (node.slot.after(at - MICRO // 2 - 1) for node in self.world.graph.nodes)
        return max((t for t in due if t <= at + MICRO // 2), default=at)

    def read(self, slot: str, output: str, name: str) -> Any:
        """One number of an output, or an array; None while there is no sample."""
        sample = self.world.graph.latest(slot, output)
        if sample is None:
            return None
        if (names := _sums(type(sample))) and self._origin is not None:
            if name == "dt":
                return self._step_s
            if name in names:
                summed = self._sums.get((slot, output))
                return 0.0 if summed is None else read(summed, name)
        return sample.t / NS if name == "t" else read(sample, name)

    def _place(self, source: Source) -> None:
        """Bodies of the machines stand where the motion from outside says."""
        sample = self.world.graph.latest(*source)
        if isinstance(sample, MachineState):
            self.world.place_bodies(source[0], sample.t, {source[1]: sample})

    def _count(self, slot: str, t: int, outputs: Outputs) -> None:
        """Observer: add up the amounts of a communication step."""
        if not self._is_counting:
            return
        for output, sample in outputs.items():
            names = _sums(type(sample))
            if not names:
                continue
            before = self._sums.get((slot, output))
            if before is not None:
                sums = {n: getattr(before, n) + getattr(sample, n) for n in names}
                sample = dataclasses.replace(sample, **sums)
            self._sums[(slot, output)] = sample


def _sums(signal: type[Signal]) -> tuple[str, ...]:
    """Amounts of a sample; the time that they belong to counts apart."""
    return tuple(name for name in amounts(signal) if name != "dt")


def _readers(graph: Graph, source: Source) -> tuple[list[Slot], bool]:
    """Slots that take samples of a source, and whether they queue up for one of them."""
    queued: list[Slot] = []
    others: list[Slot] = []
    for node in graph.nodes:
        history = {p.name for p in node.component.inputs if p.history}
        for name, wire in node.wires.items():
            if wire == source:
                (queued if name in history else others).append(node.slot)
    return (queued, True) if queued else (others, False)


def _whole(seconds: float) -> int:
    """Time [ns] in whole microseconds."""
    return round(seconds * (NS // MICRO)) * MICRO
