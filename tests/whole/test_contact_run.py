"""A combine that drives into something: the run ends there and says with what; nothing near, nothing said."""

import pytest

from swath.judge.evaluator import EvaluatorSetup
from swath.judge.evaluators.contact import LEVEL
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario

TEXT = """
format: swath scenario 2
name: contact
run: {distance_m: 12}
field:
  edge: {shape: straight}
  obstacles: [OBSTACLE]
machines:
  combine: {lidar: off, edge: truth, start: {along_edge_m: -2}}
"""


class Watching:
    """The evaluator of the combine as an observer of the graph."""

    def __init__(self, world):
        machines = {name: machine.recorded() for name, machine in world.machines.items()}
        self.watch = LEVEL.component(EvaluatorSetup(world.field, machines, "combine", bodies=world.bodies))

    def __call__(self, slot, t, outputs):
        if slot.startswith("combine."):
            self.watch.see(slot, t, outputs)

    def end_reason(self, t):
        return self.watch.end_reason(t)


@pytest.mark.parametrize(
    ("obstacle", "name"),
    [
        ("{kind: post, x_m: 3, y_m: 5}", "post 1"),
        ("{kind: box, x_m: 9, y_m: 6, length_m: 1, width_m: 1, name: shed}", "shed"),
        ("{kind: stone, x_m: 3, y_m: 5, height_m: 0.12}", ""),
        ("{kind: post, x_m: -2, y_m: 5}", ""),
    ],
)
def test_a_run_ends_where_the_machine_touches_something(obstacle, name):
    world = assemble(parse_scenario(TEXT.replace("OBSTACLE", obstacle)))
    observer = Watching(world)
    drive(world, [observer])
    events = observer.watch.events()
    assert [e.other for e in events] == ([name] if name else [])
    assert world.graph.ended.startswith(f"touched {name} at ") if name else world.graph.ended == ""
    distance = world.graph.latest("combine.motion", "state").distance
    assert (distance < 8.0) == bool(name)
