"""Detectors in shadow: each sees the scans of a run that another one steers, at the same moments.

Open loop: where a detector would have steered the machine is not asked. What it says of the edge is judged as
that of the detector at the wheel; a shadow of that one says the same to the last bit.
"""

from collections.abc import Mapping
from typing import Any

from swath.core.blocks import Seen
from swath.core.errors import InputError
from swath.core.graph import Graph, Node
from swath.core.signal import Signal
from swath.documents.json_file import json_safe
from swath.judge.evaluators.edge_detection import EdgeDetection, States
from swath.record.digest import Digest
from swath.runtime.assembly import make_part, outside_of
from swath.runtime.faults import make_fault
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.world import World
from swath.scenario.scenario import Scenario
from swath.signals import MachineState
from swath.tools.function_test.judging.integrity import integrity_of
from swath.tools.function_test.judging.ranking import EDGE_US

SUMMARY = "shadow"


class Shadow:
    """One detector beside the one that steers, in the slot `name`, such as `combine.edge`."""

    def __init__(self, world: World, name: str, scenario: Scenario, judge: EdgeDetection,
                 states: States) -> None:  # fmt: skip
        machine, _, slot = name.partition(".")
        choice = scenario.machines[machine].slots[slot]
        component, wires = make_part(world, name, choice)
        timing = next(node.slot for node in world.graph.nodes if node.slot.name == name)
        node = Node(timing, component, wires, make_fault(choice, component))
        self.name, self.judge, self.digest = name, judge.beside(states), Digest()
        self._node, self._graph = node, Graph([node], scenario.seed, outside=outside_of([node]))
        self._sources = {source for source, _ in wires.values()}
        self.slots = {*self._sources, name}  # of the run, whose samples it takes
        self._graph.observers += [self.digest, self.judge.see]
        self._graph.reset()

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Observer of the run: take in what the wires bring, and step when the detector at the wheel has."""
        if slot in self._sources:
            for output, sample in outputs.items():
                self._graph.put(slot, output, sample)
        if slot == self.name and t > 0:
            self._graph.run(t)

    def result(self) -> dict[str, Any]:
        """The metrics of the shadow's edge, and the digest of what it said."""
        integrity = integrity_of(self.judge.series(), self.judge.setup.settling_m)
        took = 1e6 * self._node.cost_s / max(self._node.step_count, 1)
        metrics = json_safe(self.judge.metrics())
        return {"metrics": metrics, "digest": self.digest.hex, "integrity": integrity, EDGE_US: took}


class ShadowHook(RunHook):
    """Lets detectors go along with a run. scenarios: by name, of which the slots of kind `edge` count."""

    READS_TRACKS = False

    def __init__(self, scenarios: Mapping[str, Scenario]) -> None:
        self.scenarios = scenarios
        self._shadows: dict[str, Shadow] = {}
        self._by_slot: dict[str, list[Shadow]] = {}

    def begin(self, run: ActiveRun) -> None:
        """Put the shadows beside the run."""
        machine = run.world.leader
        slots = machine.slots_of("edge")
        judge = run.evaluation.find(machine.name, EdgeDetection)
        if len(slots) != 1 or judge is None:
            raise InputError(f"{machine.name}.edge", len(slots), "expected one edge detector to shadow")
        name = f"{machine.name}.{slots[0]}"
        self._motion, self._states = f"{machine.name}.motion", States()
        for candidate, scenario in self.scenarios.items():
            _check(candidate, scenario, run.world.scenario, name)
            self._shadows[candidate] = Shadow(run.world, name, scenario, judge, self._states)
        for shadow in self._shadows.values():
            for slot in shadow.slots:
                self._by_slot.setdefault(slot, []).append(shadow)
        run.observers.append(self._see)

    def _see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        if slot == self._motion and (states := Seen.of_one(slot, t, outputs).of(MachineState)) is not None:
            self._states.take(states)
        for shadow in self._by_slot.get(slot, ()):
            shadow(slot, t, outputs)
        if slot == self._motion:
            for shadow in self._shadows.values():
                shadow.judge.look()

    def summarize(self, t: int) -> dict[str, Any]:
        """`shadow`: what each came to."""
        return {SUMMARY: {name: shadow.result() for name, shadow in self._shadows.items()}}


def _check(candidate: str, scenario: Scenario, steered: Scenario, name: str) -> None:
    """Raise InputError for a candidate that changes more than the detector."""

    def rest(of: Scenario) -> Any:
        plain = of.plain()
        machine, _, slot = name.partition(".")
        return {**plain, "summary": "", "machines": {**plain["machines"],
                machine: {k: v for k, v in plain["machines"][machine].items() if k != slot}}}  # fmt: skip

    if rest(scenario) != rest(steered):
        expected = f"expected changes of {name} alone: in shadow nothing else can differ"
        raise InputError("candidate", candidate, expected)
