from dataclasses import dataclass

import pytest

from swath.core.component import Port
from swath.core.errors import WiringError
from swath.core.graph import Graph, Node
from swath.core.schedule import Slot
from swath.signals import Signal, SpeedCommand

MS = 1_000_000


@dataclass(frozen=True)
class Number(Signal):
    value: float


class Counter:
    """Adds its input (if wired) and a random draw to a running sum."""

    inputs = (Port("addend", Number, optional=True),)
    outputs = (Port("total", Number),)

    def reset(self, stream):
        self.stream, self.total = stream, 0.0
        return {"total": Number(0, 0.0)}

    def step(self, t, dt, inputs):
        addend = inputs["addend"]
        self.total += 1.0 + (addend.value if addend else 0.0) + self.stream.at(t).random()
        return {"total": Number(t + dt, self.total)}

    def save(self):
        return {"total": self.total}

    def load(self, state):
        self.total = state["total"]


class History:
    inputs = (Port("samples", Number, history=True),)
    outputs = (Port("times", Number),)

    def reset(self, stream):
        self.seen = []
        return {"times": Number(0, 0.0)}

    def step(self, t, dt, inputs):
        self.seen.append(tuple(s.t for s in inputs["samples"]))
        return {"times": Number(t + dt, float(len(inputs["samples"])))}

    def save(self):
        return {"seen": list(self.seen)}

    def load(self, state):
        self.seen = list(state["seen"])


def graph(seed=1, latch=False):
    fast = Node(Slot("fast", 5 * MS), Counter(), {"addend": ("slow", "total")})
    slow = Node(Slot("slow", 20 * MS, latch=latch), Counter(), {"addend": ("fast", "total")})
    log = Node(Slot("log", 20 * MS), History(), {"samples": ("fast", "total")})
    return Graph([fast, slow, log], seed)


def trace(g, until, pieces=None):
    seen = []
    g.observers.append(lambda name, t, out: seen.append((name, t, out)))
    if pieces is None:
        g.reset()
    g.run(until)
    return seen


def test_save_and_load_in_the_middle_changes_nothing():
    whole = trace(graph(), 300 * MS)
    first = graph()
    head = trace(first, 137 * MS)
    state = first.save()
    first.observers.clear()
    first.run(250 * MS)  # going on must not change what was saved
    second = graph()
    second.load(state)
    tail = trace(second, 300 * MS, pieces=True)
    assert head + tail == whole


def test_seed_matters_and_repeats():
    assert trace(graph(1), 100 * MS) == trace(graph(1), 100 * MS)
    assert trace(graph(1), 100 * MS) != trace(graph(2), 100 * MS)


def test_later_slot_sees_this_tick_and_latched_slot_the_one_before():
    for latch, expected in ((False, 20 * MS), (True, 15 * MS)):
        g = graph(latch=latch)
        seen = []
        slow = g.nodes[1].component
        step = slow.step
        slow.step = lambda t, dt, i, step=step, seen=seen: (seen.append(i["addend"].t), step(t, dt, i))[1]
        g.reset()
        g.run(20 * MS)
        assert seen == [expected]


def test_history_port_receives_every_sample_once_with_the_one_at_t0():
    g = graph()
    g.reset()
    g.run(40 * MS)
    assert g.nodes[2].component.seen == [
        (0, 5 * MS, 10 * MS, 15 * MS, 20 * MS),
        (25 * MS, 30 * MS, 35 * MS, 40 * MS),
    ]


class Source:
    inputs = ()

    def __init__(self, *ports):
        self.outputs = ports


class Sink(Source):
    outputs = ()

    def __init__(self, *ports):
        self.inputs = ports


@pytest.mark.parametrize(
    ("out", "into", "words"),
    [
        (Port("o", Number, "m"), Port("i", SpeedCommand, "m"), "sends Number, expected SpeedCommand"),
        (Port("o", Number, "m"), Port("i", Number, "mm"), r"sends \[m\], expected \[mm\]"),
        (Port("o", Number, "m", (3,)), Port("i", Number, "m", (4,)), "shape"),
        (Port("o", Number, "m", (3, 2)), Port("i", Number, "m", (None,)), "shape"),
    ],
)
def test_wrong_connection_names_both_ends(out, into, words):
    nodes = [Node(Slot("a", MS), Source(out)), Node(Slot("b", MS), Sink(into), {"i": ("a", "o")})]
    with pytest.raises(WiringError, match=rf"a\.o -> b\.i: .*{words}"):
        Graph(nodes, 1)


def test_fitting_open_shape_is_accepted():
    nodes = [
        Node(Slot("a", MS), Source(Port("o", Number, "m", (3,)))),
        Node(Slot("b", MS), Sink(Port("i", Signal, "m", (None,))), {"i": ("a", "o")}),
    ]
    assert [node.wires for node in Graph(nodes, 1).nodes] == [{}, {"i": ("a", "o")}]


@pytest.mark.parametrize(
    ("wires", "words"),
    [
        ({}, r"b\.i: input is not connected, wires: \{i: \.\.\.\} of its slot may name a\.o$"),
        ({"i": ("c", "o")}, "no slot c"),
        ({"i": ("a", "x")}, "no output x"),
        ({"i": ("a", "o"), "j": ("a", "o")}, "no such input"),
    ],
)
def test_open_and_dangling_wires_are_refused(wires, words):
    port = Port("o", Number, "m")
    nodes = [Node(Slot("a", MS), Source(port)), Node(Slot("b", MS), Sink(Port("i", Number, "m")), wires)]
    with pytest.raises(WiringError, match=words):
        Graph(nodes, 1)


@pytest.mark.parametrize(
    ("gives", "words"),
    [
        (None, r"a: gave None, expected a dict of \['total'\]"),
        ({"totl": Number(0, 1.0)}, r"a\.totl: there is no such output; it has \['total'\]"),
        ({"total": 1.0}, r"a\.total: gave a float, expected a Number"),
    ],
)
def test_what_a_component_gives_must_be_what_it_declares(gives, words):
    class Wrong(Counter):
        def step(self, t, dt, inputs):
            return gives

    made = Graph([Node(Slot("a", 10 * MS), Wrong())], 1)
    made.reset()
    with pytest.raises(WiringError, match=words):
        made.run(10 * MS)
