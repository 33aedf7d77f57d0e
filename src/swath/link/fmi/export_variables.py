"""What an exported FMU shows: inputs, outputs and parameters of some slots as flat variables.

Of one slot they are called `port.number`, as `level: fmu` expects them: `flow.grain` goes into a process,
`load.tank_grain` comes out. Of several slots they are called `slot.output.number`, inputs after the slot that
feeds them in the machine: `header.flow.grain`. With several machines the machine comes first. Parameters are
named as their key in the scenario: `process.loss_percent`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swath.core.component import Port
from swath.core.errors import InputError
from swath.core.units import split_unit
from swath.link.fmi.units import known_unit
from swath.runtime.assembly import assemble, outside_of
from swath.runtime.world import World
from swath.scenario.scenario import Scenario, short_names
from swath.signals.flat import amounts, flat_fields, read

Key = tuple[str, ...]


@dataclass(frozen=True)
class Variable:
    """One variable of an FMU.

    causality: independent, parameter, input or output
    kind: real, int, bool or text
    unit: as swath writes it
    shape: () for a plain number, rows first
    start: what it is before it is set
    key: (slot, output, number) of a sample, (scenario key,) of a parameter, () of the time
    """

    name: str
    causality: str
    kind: str
    unit: str = ""
    description: str = ""
    shape: tuple[int, ...] = ()
    start: Any = None
    key: Key = ()

    @property
    def size(self) -> int:
        """How many numbers it is."""
        return int(np.prod(self.shape, dtype=int))

    @classmethod
    def of(cls, entry: dict[str, Any]) -> "Variable":
        """The variable of the plain data of `asdict`."""
        return cls(**{**entry, "shape": tuple(entry["shape"]), "key": tuple(entry["key"])})


def list_variables(
    scenario: Scenario, slots: Sequence[str], parameters: Sequence[str] = ()
) -> tuple[list[Variable], list[tuple[str, str]]]:
    """Variables of the slots (full names), and the inputs (slot, output) that have a sample at t = 0.

    parameters: further keys of the scenario. Builds the whole world: starts and lengths of arrays are those
    of its samples at t = 0.
    """
    whole = assemble(scenario)
    try:
        whole.graph.reset()
        nodes = [n for n in whole.graph.nodes if n.slot.name in slots]
        outside = outside_of(nodes)
        found = [Variable("time", "independent", "real", "s", "simulated time")]
        found += _parameters(scenario, slots, parameters)
        names = _short_names(scenario)
        # what feeds the only slot -> its port
        own = {w: p for p, w in reversed(nodes[0].wires.items())} if len(slots) == 1 else {}
        for slot, ports in outside.items():
            for output, port in ports.items():
                name = own.get((slot, output)) or f"{names[slot]}.{output}"
                found += _sample(name, slot, output, port, whole, "input")
        for node in nodes:
            slot = node.slot.name
            for port in node.component.outputs:
                if port.signal.about.samples != "full":
                    name = port.name if len(slots) == 1 else f"{names[slot]}.{port.name}"
                    found += _sample(name, slot, port.name, port, whole, "output")
    finally:
        whole.close()
    names_seen: set[str] = set()
    for variable in found:
        if variable.name in names_seen:
            raise InputError("--parameter", variable.name, "there is another variable of this name")
        names_seen.add(variable.name)
    sources = [(s, o) for s, ports in outside.items() for o in ports]
    return found, [source for source in sources if whole.graph.latest(*source) is not None]


def _short_names(scenario: Scenario) -> dict[str, str]:
    return {name: short.replace("-", "_") for name, short in short_names(scenario).items()}


def _sample(name: str, slot: str, output: str, port: Port, world: World, causality: str) -> list[Variable]:
    """The numbers of one input or output; what there is at t = 0 gives starts and lengths of arrays."""
    sample = world.graph.latest(slot, output)
    signal = type(sample) if sample is not None else port.signal
    has_amounts = bool(amounts(signal))
    made = []
    for field in flat_fields(signal).values():
        start = (field.default or 0) if sample is None else read(sample, field.name)
        shape: tuple[int, ...] = ()
        if field.kind == "array":
            shape, start = np.shape(start), np.ravel(start).astype(float).tolist()
            if sample is None or 0 in shape:
                continue
        else:
            start = _PLAIN[field.kind](start)
        text = f"{field.name.partition('.')[0].replace('_', ' ')}: {field.quantity.meaning}"
        if has_amounts and field.name == "dt":
            start = 0.0 if causality == "input" else start
            text = "time that the amounts belong to"
            text += ", 0 = the communication step" if causality == "input" else ": the communication step"
        elif field.quantity.is_amount:
            text = f"{text}, within dt"
        kind = "real" if field.kind == "array" else field.kind
        key = (slot, output, field.name)
        made.append(Variable(f"{name}.{field.name}", causality, kind, field.unit, text, shape, start, key))
    if not has_amounts:
        text = "when the sample was valid" + (", < 0 = now" if causality == "input" else "")
        start = -1.0 if causality == "input" else 0.0
        key = (slot, output, "t")
        made.append(Variable(f"{name}.t", causality, "real", "s", text, (), start, key))
    return made


_PLAIN = {"real": float, "int": int, "bool": bool}


def _parameters(scenario: Scenario, slots: Sequence[str], more: Sequence[str]) -> list[Variable]:
    from swath.scenario.reference import parameter_rows

    names = _short_names(scenario)
    made = [Variable("seed", "parameter", "int", "", "of every random stream", (), scenario.seed, ("seed",))]
    for slot in slots:
        machine, _, short = slot.partition(".")
        choice = scenario.machines[machine].slots[short]
        if choice.params is None:
            continue
        meaning = {row[0]: row[3] for row in parameter_rows(choice.found.params)}
        common = set(choice.common.model_dump()) | {"level"}
        for key, value in _leaves(choice.plain()):
            if key.partition(".")[0] not in common and not _is_path(value):
                made.append(_parameter(f"{names[slot]}.{key}", f"{slot}.{key}", value, meaning.get(key, "")))
    plain = dict(_leaves(scenario.plain()))
    known = {v.key for v in made}
    for key in more:
        value = plain.get(key)
        if value is None:
            lead = key.rpartition(".")[0]
            near = ", ".join(k for k in plain if k.startswith(lead)) or "a key of the scenario"
            raise InputError("--parameter", key, f"expected a key with a value, such as {near}")
        if (key,) not in known:
            made.append(_parameter(key, key, value, ""))
    return made


def _parameter(name: str, key: str, value: Any, text: str) -> Variable:
    kinds = {bool: "bool", int: "int", float: "real", str: "text"}
    kind, unit = kinds[type(value)], split_unit(key.rpartition(".")[2])[1]
    unit = unit if kind == "real" and known_unit(unit) is not None else ""
    return Variable(name, "parameter", kind, unit, text, (), value, (key,))


def _leaves(data: Any, prefix: str = "") -> list[tuple[str, Any]]:
    """Dotted keys of the plain numbers, truths and texts in nested mappings."""
    found: list[tuple[str, Any]] = []
    for key, value in data.items():
        if isinstance(value, dict):
            found += _leaves(value, f"{prefix}{key}.")
        elif isinstance(value, bool | int | float | str):
            found.append((prefix + key, value))
    return found


def _is_path(value: Any) -> bool:
    return isinstance(value, str) and ("/" in value or "\\" in value)
