"""Which numbers of data sheets the metrics of crop and engine depend on, and which of these matter most.

A level names the sections of its machine's data sheet that it reads. A metric depends on those of all slots
that it depends on, and on the crop's data sheet. Sensitivities are finite differences of the steady state of
a
level where the run ended: percent of the metric per percent of the number. A tag does not say how far a
number may be off.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from swath.core.errors import SwathError
from swath.documents.data_sheets import TAGS, Sheet, read_sheet
from swath.machine.machine_sheet import open_machine, read_machine
from swath.runtime.credibility import rests_on
from swath.runtime.world import Machine, World
from swath.signals import MachineLoad, MachineState

SUMMARY = "inputs"
GROUP = "Crop and engine"  # of the metrics that are looked at
YIELD = "grain_cut_kg"  # metric of the crop's own numbers
STEP = 0.01  # relative change of a number
MOST = 3  # numbers that are named


def inputs_of(world: World, evaluation: Any) -> dict[str, Any]:
    """By machine and metric: `numbers`, a count by tag of each source, and those that `matter_most`."""
    found = {}
    for machine in world.machines.values():
        entry = dict(_of_machine(world, evaluation, machine))
        if entry:
            found[machine.name] = entry
    return found


def _of_machine(world: World, evaluation: Any, machine: Machine) -> Iterator[tuple[str, Any]]:
    known = evaluation.catalogue.metrics
    of_group = [name for name, metric in known.items() if metric.group == GROUP or name == YIELD]
    found = evaluation.metrics(machine.name, of_group)
    names = [name for name in found if name in of_group]
    if not names:
        return
    sheet = open_machine(str(machine.section.sheet))
    tagged = sheet.numbers()
    slots = {
        f"{machine.name}.{slot}": choice
        for slot, choice in machine.section.slots.items()
        if choice.found.numbers
    }
    crop = _crop(world)
    worth = _worth(world, machine, sheet, slots)
    for name in names:
        rests = rests_on(world, evaluation.catalogue, machine.name, name)
        sources = {
            f"{slot}: {choice.level}": _tags(
                {k: e for k, e in tagged.items() if k.partition(".")[0] in choice.found.numbers}
            )
            for slot, choice in slots.items()
            if slot in rests
        } | crop
        most = sorted(worth.get(name, {}).items(), key=lambda item: -abs(item[1]))[:MOST]
        yield name, {
            "numbers": sources,
            "matter_most": [
                {"key": key, "value": sheet.value(key), "tag": str(tagged[key].get("tag", "U")),
                 "percent_per_percent": float(f"{share:.3g}")}
                for key, share in most
            ],
        }  # fmt: skip


def _tags(numbers: Mapping[str, Mapping[str, Any]]) -> dict[str, int]:
    counts = Counter(str(entry.get("tag", "U"))[0] for entry in numbers.values())
    return {tag: counts[tag] for tag in TAGS}


def _crop(world: World) -> dict[str, dict[str, int]]:
    crop = world.field.stand.crop
    try:
        sheet = read_sheet("crops", crop, world.scenario.field.folder)
    except SwathError:  # the user's file has changed since the run began
        return {}
    return {f"crop {Path(crop).stem}": _tags(sheet.numbers())}


def _worth(
    world: World, machine: Machine, sheet: Sheet, slots: Mapping[str, Any]
) -> dict[str, dict[str, float]]:
    """What a number is worth, by metric and number: percent per percent."""
    state = world.graph.latest(f"{machine.name}.motion", "state")
    load = world.graph.latest(f"{machine.name}.process", "load")
    found: dict[str, dict[str, float]] = {}
    if not (isinstance(state, MachineState) and isinstance(load, MachineLoad)):
        return found
    for level in (choice.found for choice in slots.values()):
        if level.steady is None:
            continue
        base = level.steady(machine.sheet, state, load)
        for key in sheet.numbers():
            if key.partition(".")[0] not in level.numbers or not sheet.number(key):
                continue
            ends = []
            for sign in (-1.0, 1.0):
                try:
                    other = read_machine(sheet.changed({key: sheet.number(key) * (1.0 + sign * STEP)}))
                except SwathError:  # it would contradict another
                    break
                ends.append(level.steady(other, state, load))
            for name, value in base.items() if len(ends) == 2 else ():
                if value:
                    share = (ends[1][name] - ends[0][name]) / (2.0 * STEP * value)
                    found.setdefault(name, {})[key] = share
    return found
