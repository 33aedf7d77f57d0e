"""The last step of a part, when a run ends between two of its steps, leaves it as its fault has it."""

from swath.core.component import Port
from swath.core.fault import Fault, FaultyOutput
from swath.core.graph import Graph, Node
from swath.core.schedule import Slot
from swath.signals import Odometry


class Source:
    """Sends its time; steps of any length."""

    inputs = ()
    outputs = (Port("odometry", Odometry),)
    steps_any_length = True

    def reset(self, stream):
        return {"odometry": Odometry(0, 0.0, 0.0, 0.0)}

    def step(self, t, dt, inputs):
        return {"odometry": Odometry(t + dt, 1.0, 0.0, 0.0)}

    def save(self):
        return {}

    def load(self, state):
        pass


def test_the_part_step_at_the_end_is_faulty_too():
    values = {key: {} for key in ("scale", "noise", "stuck")}
    shares = dict.fromkeys(("beam_loss", "dead_beams", "loss", "burst", "latency"), 0.0)
    fault = Fault(bias={"speed_m_s": 2.0}, hold=(), silent=(), **values, **shares)
    source = Source()
    graph = Graph([Node(Slot("a.odometry", 100), source, fault=FaultyOutput(fault, source.outputs))], 1)
    graph.reset()
    graph.run(250)
    graph.finish()
    sample = graph.latest("a.odometry", "odometry")
    assert (sample.t, sample.speed) == (250, 3.0)
