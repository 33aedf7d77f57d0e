"""Some slots of a scenario, the rest put in from outside."""

import numpy as np

from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import load_scenario

CALM = ["run.distance_m=20", "run.max_duration_s=4"]


def test_a_process_alone_does_what_it_did_in_the_machine():
    scenario = load_scenario("feed-rate", sets=CALM)
    whole = assemble(scenario)
    seen, loads = [], []

    def watch(slot, t, outputs):
        if slot in ("combine.motion", "combine.header", "combine.powertrain"):
            seen.append((slot, t, outputs))
        if slot == "combine.process":
            loads.append(outputs["load"])

    drive(whole, [watch])

    part = assemble(scenario, only=["combine.process"])
    graph = part.graph
    assert [n.slot.name for n in graph.nodes] == ["combine.process"]
    assert {s: set(o) for s, o in graph.outside.items()} == {
        "combine.motion": {"state"},
        "combine.header": {"flow"},
        "combine.powertrain": {"engine"},
    }
    graph.reset()
    alone = [graph.latest("combine.process", "load")]
    waiting = list(seen)
    for load in loads[1:]:
        # the powertrain runs after the process: what it says at this moment comes too late for it
        def is_early(entry, end=load.t):
            return entry[1] < end or (entry[1] == end and entry[0] != "combine.powertrain")

        for slot, _, outputs in [e for e in waiting if is_early(e)]:
            for output, sample in outputs.items():
                if output in graph.outside[slot]:
                    graph.put(slot, output, sample)
        waiting = [e for e in waiting if not is_early(e)]
        graph.run(load.t)
        alone.append(graph.latest("combine.process", "load"))
    assert alone == loads
    assert loads[-1].drum_flow > 5.0


def test_control_is_told_the_same_mounting_when_alone():
    scenario = load_scenario("straight")
    part = assemble(scenario, only=["combine.edge"])
    assert [n.slot.name for n in part.graph.nodes] == ["combine.edge"]
    whole = assemble(scenario)
    alone, among = (w.leader.parts["edge"] for w in (part, whole))
    assert all(np.array_equal(a, b) for a, b in zip(alone.row, among.row, strict=True))
    assert (alone.mounting.position == among.mounting.position).all()
