"""A graph of some slots only: samples of the others are put in from outside."""

from dataclasses import dataclass, field

import pytest

from swath.core.component import Port
from swath.core.errors import WiringError
from swath.core.graph import Graph, Node
from swath.core.schedule import Slot
from swath.signals import FeedReading

MS = 1_000_000


@dataclass
class Keeper:
    """Keeps what it is given."""

    inputs: tuple = (Port("now", FeedReading), Port("all", FeedReading, history=True))
    outputs: tuple = ()
    seen: list = field(default_factory=list)

    def reset(self, stream):
        self.seen = []
        return {}

    def step(self, t, dt, inputs):
        self.seen.append((t + dt, inputs["now"], inputs["all"]))
        return {}

    def save(self):
        return {"seen": list(self.seen)}

    def load(self, state):
        self.seen = list(state["seen"])


def make(outside):
    wires = {"now": ("m.feed", "feed"), "all": ("m.feed", "feed")}
    keeper = Keeper()
    return keeper, Graph([Node(Slot("m.keeper", 10 * MS), keeper, wires)], 1, outside=outside)


def test_samples_from_outside_are_seen_and_queued_and_saved():
    keeper, graph = make({"m.feed": {"feed": Port("feed", FeedReading)}})
    graph.reset()
    a, b, c = (FeedReading(k * 5 * MS, float(k)) for k in range(3))
    for sample in (a, b):
        graph.put("m.feed", "feed", sample)
    graph.run(5 * MS)
    state = graph.save()
    for _ in range(2):
        graph.put("m.feed", "feed", c)
        graph.run(20 * MS)
        assert keeper.seen == [(10 * MS, c, (a, b, c)), (20 * MS, c, ())]
        graph.load(state)


def test_outside_ports_must_fit_too():
    with pytest.raises(WiringError, match=r"m\.feed has no output feed"):
        make({"m.feed": {"other": Port("other", FeedReading)}})
    with pytest.raises(WiringError, match=r"sends \[kg/s\]"):
        make({"m.feed": {"feed": Port("feed", FeedReading, unit="kg/s")}})
    with pytest.raises(WiringError, match=r"there is no slot m\.feed"):
        make(None)
