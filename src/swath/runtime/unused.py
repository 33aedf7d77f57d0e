"""Keys that a scenario sets and that change nothing of a run: they tell when they are read, and notes name
those that nobody read, and those of what begins when the run is over.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from swath.core.asked import Asked, made_of, telling
from swath.core.number_text import num
from swath.core.schedule import NS
from swath.runtime.world import World
from swath.scenario.resolved import MachineSection, RealTimeSection, SlotChoice
from swath.scenario.scenario import Scenario
from swath.scenario.schema import described


def watched(scenario: Scenario, asked: Asked) -> Scenario:
    """The scenario whose keys tell when they are read, but for those of its field (`watched_field`)."""
    machines = {name: _watched_machine(section, asked) for name, section in scenario.machines.items()}
    paced = scenario.realtime and _watched_pace(scenario.realtime, asked)
    return replace(scenario, run=asked.watched(scenario.run, "run"), machines=machines, realtime=paced)


def _watched_machine(section: MachineSection, asked: Asked) -> MachineSection:
    name = section.name
    slots = {slot: watched_slot(choice, f"{name}.{slot}", asked) for slot, choice in section.slots.items()}
    common, start = asked.watched(section.common, name), asked.watched(section.start, f"{name}.start")
    made = replace(section, common=common, start=start, slots=slots)
    return made_of(made, common, {"sheet": "machine"})


def watched_slot(choice: SlotChoice, name: str, asked: Asked) -> SlotChoice:
    """The choice for a slot, such as `combine.lidar`, whose keys tell when they are read."""
    common = asked.watched(choice.common, name)
    return replace(choice, params=asked.watched(choice.params, name), common=common)


def _watched_pace(section: RealTimeSection, asked: Asked) -> RealTimeSection:
    made = replace(section, common=asked.watched(section.common, "realtime"))
    cheaper = {"cheaper": asked.key("realtime.degrade", section, "cheaper")} if section.cheaper else {}
    return telling(made, cheaper)


def unused(world: World) -> list[str]:
    """Notes on keys that were set and that nothing uses, with what the docs say of them or why."""
    about = {key: of for asked in world.asked for key, of in asked.about.items()}
    why = {key: described(*about[key][:2]) for key, parts in world.asked_by.items() if not parts}
    over = "s, when the run is over"
    why = {key: f"it begins at {num(at)} {over}" for key, at in _late(about, world.graph.t / NS)} | why
    why |= dict.fromkeys(_needless(world), "nothing that it reads runs before it in a tick")
    notes = [f"no part of this run uses {key}: {said}" for key, said in why.items()]
    due = {n.slot.name: n.slot.due(1) for n in world.graph.nodes if not n.step_count}
    late = {name: at for name, at in due.items() if at >= world.graph.t}  # a branch steps none again
    return [*notes, *(f"{name}: it is first due at {num(at / NS)} {over}" for name, at in late.items())]


def _needless(world: World) -> Iterator[str]:
    """Latches of slots whose samples from this tick and from before it are the same."""
    before = set[str]()
    for node in world.graph.nodes:
        newest = [port.name for port in node.component.inputs if not port.history]
        if node.slot.latch and not before & {node.wires[n][0] for n in newest if n in node.wires}:
            yield f"{node.slot.name}.latch"
        before.add(node.slot.name)


def _late(about: dict[str, tuple[Any, str, Any]], end: float) -> Iterator[tuple[str, float]]:
    """Keys, and items of lists, that begin after the end of a run [s], with when: `from_s` and windows, of
    what is swath's own.
    """
    for key, (kind, name, value) in about.items():
        begins = [value] if name.endswith("from_s") else []
        if name.endswith("_s") and isinstance(value, list):
            begins = [window[0] for window in value if isinstance(window, list | tuple)]
        if begins and kind.__module__.startswith("swath.") and min(begins) > end:
            yield key.removesuffix(".from_s"), min(begins)
