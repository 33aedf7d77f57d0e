"""A part of control on what a run recorded, without a world: no field, no machine, no sensors."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.graph import Graph, Node
from swath.core.schedule import Slot, from_hz
from swath.core.signal import Signal
from swath.machine.machine_sheet import load_machine
from swath.record.formats import ABOUT, read_about
from swath.record.read.feed import Feed, exact_samples, exact_topic, own_outputs
from swath.record.read.files import Log, open_log
from swath.record.read.frames import own_mounting
from swath.runtime.assembly import outside_of
from swath.runtime.faults import make_fault
from swath.scenario.resolved import MachineSection, SlotChoice
from swath.scenario.scenario import slot_names
from swath.signals.setup import ControlSetup
from swath.tools.rerun.rerun import recorded_scenario


def detect_stored(source: Path, sets: Sequence[str], slot: str) -> list[Signal]:
    """The samples that a slot of control sends on a recording. InputError where it cannot be had."""
    log = open_log(source)
    scenario = recorded_scenario(log, source, sets)
    section = next(iter(scenario.machines.values()))
    choice = section.slots.get(slot)
    if choice is None or not choice.kind.is_control or choice.found.sees_truth or choice.found.is_link:
        raise InputError(f"{section.name}.{slot}", None, "expected a part of control that sees no truth")
    node = _node(log, section, slot, choice)
    graph = Graph([node], scenario.seed, outside=outside_of([node]))
    sent: list[Signal] = []
    graph.observers.append(lambda name, t, outputs: sent.extend(outputs.values()))
    graph.reset()
    sources = set(node.wires.values())
    feeds = {wire: Feed(exact_samples(log.messages((exact_topic(*wire),)))) for wire in sources}
    order = slot_names(scenario)
    late = order[order.index(node.slot.name) :]  # within a tick these come out after the slot has looked
    for t, _ in graph.plan.walk(0, log.end()):
        for (name, output), feed in feeds.items():
            for _, sample in feed.until(t - 1 if name in late or node.slot.latch else t):
                graph.put(name, output, sample)
        graph.run(t)
    return sent


def _node(log: Log, section: MachineSection, slot: str, choice: SlotChoice) -> Node:
    """The part, wired to what the recording holds of its sources."""
    period = from_hz(choice.common.rate_hz)
    sheet = load_machine(section.sheet.as_posix(), header_width_m=section.common.header_width_m)
    known = read_about(log.attachment(ABOUT)).get("crop", {})
    setup = ControlSetup(
        sheet,
        _mountings(log, choice),
        section.common.edge_side,
        period * 1e-9,
        float(known.get("height", 0.0)),
        row_spacing=float(known.get("row_spacing", 0.0)),
    )
    component = choice.make(setup)
    sent = {source: own_outputs(log, source) for source, _ in choice.wires.values()}
    wires = {
        port.name: choice.wires[port.name]
        for port in component.inputs
        if port.name in choice.wires and sent[(wire := choice.wires[port.name])[0]].get(wire[1])
    }
    for port in component.inputs:
        if not port.optional and port.name not in wires:
            wanted = ".".join(choice.wires.get(port.name, (port.name,)))
            expected = f"expected a recording with every sample of {wanted} (run.record: exact)"
            raise InputError("recording", log.path.name, expected, file=log.path)
    timing = Slot(f"{section.name}.{slot}", period, round(choice.common.offset_ms * 1e6), choice.common.latch)
    return Node(timing, component, wires, make_fault(choice, component))


def _mountings(log: Log, choice: SlotChoice) -> Mapping[str, Any]:
    found = {port: own_mounting(log, source) for port, (source, _) in choice.wires.items()}
    return {port: pose for port, pose in found.items() if pose is not None}
