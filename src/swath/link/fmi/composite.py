"""Several FMUs as one: what a System Structure file connects, stepped one after the other in declared order.

Each component sees what those before it gave in this step and what those after it gave in the last one
(Gauss-Seidel), as the slots of a machine do.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

from swath.link.fmi.description import Description, Variable, read_fmu
from swath.link.fmi.instance import Numbers, Steps
from swath.link.fmi.ssp import SUFFIXES, Node, System, read_system
from swath.link.fmi.unit import Unit, make_unit
from swath.link.fmi.units import Scale

ALL = ("structuralParameter", "parameter", "input", "output", "calculatedParameter", "local")
# What the whole can when all of its components can, and what it is when one of them is.
OF_ALL = ("variable_step", "saves_state", "serializes")
OF_ANY = ("needs_tool", "has_events", "returns_early", "one_per_process")
SAME = Scale()


def describe_system(system: System) -> tuple[Description, dict[str, Node]]:
    """The system as if it were one FMU, and which connector each of its variables is.

    Its variables are the connectors of the whole by their names, and those of the components as
    `Component.variable`; inputs that a connection feeds are not among them.
    """
    fmus = list(system.components.values())
    nodes: dict[str, Node] = {}
    variables: dict[str, Variable] = {}
    for (path, name), kind in system.kinds.items():
        inner = None if path else _behind(system, name, kind)
        if inner is None:
            continue
        nodes[name] = ("", name)
        own = system.units.get(("", name)) or inner.unit
        if kind != "output" and own is not None:
            system.units["", name] = own  # so that all that it feeds is converted from one unit
        unit_name = None if own is None else own.name
        causality = kind if kind in ALL else "local"
        variables[name] = replace(inner, name=name, causality=causality, unit=own, unit_name=unit_name)
    for path, fmu in system.components.items():
        for variable in fmu.of(*ALL):
            if (path, variable.name) not in system.edges:
                full = f"{path}.{variable.name}"
                nodes[full] = (path, variable.name)
                variables[full] = replace(variable, name=full)
    numbered = {n: replace(v, refs=(k,), dimensions=()) for k, (n, v) in enumerate(variables.items())}
    faults = tuple(f"{path}: {f}" for path, fmu in system.components.items() for f in fmu.faults)
    flags: dict[str, Any] = {name: all(vars(f)[name] for f in fmus) for name in OF_ALL}
    flags |= {name: any(vars(f)[name] for f in fmus) for name in OF_ANY}
    about: dict[str, Any] = {"file": system.file, "name": system.file.stem, "fixed_step": None}
    return replace(fmus[0], variables=numbered, faults=faults, **about, **flags), nodes


def describe_file(file: Path) -> Description:
    """An FMU, or a system as if it were one. InputError where it is neither."""
    if file.suffix.lower() in SUFFIXES:
        return describe_system(read_system(file))[0]
    return read_fmu(file)


def _behind(system: System, name: str, kind: str) -> Variable | None:
    """The FMU variable that a connector of the whole stands for."""
    if kind == "output":
        found = system.source_of(("", name))
        if found is None or found[0][0] not in system.components:
            return None
        path, inner = found[0]
        return system.components[path].variables[inner]
    for end in system.edges:
        if end[0] in system.components:
            found = system.source_of(end)
            if found is not None and found[0] == ("", name):
                return system.components[end[0]].variables[end[1]]
    return None


@dataclass
class _Part:
    """A component as it runs, with those of its inputs that something feeds and its outputs that are read."""

    path: str
    unit: Unit
    inputs: list[Variable]
    outputs: list[Variable]


class Composite:
    """The unit of a system. own, timeout_s: of every component, as of a single FMU."""

    def __init__(
        self,
        system: System,
        name: str,
        inputs: Sequence[Variable],
        outputs: Sequence[Variable],
        *,
        own: bool = False,
        timeout_s: float = 10.0,
    ) -> None:
        self._system = system
        _, nodes = describe_system(system)
        self._sources = {n: found for n in system.edges if (found := system.source_of(n)) is not None}
        self._inputs = [(nodes[v.name], v.size) for v in inputs]
        self._reads = [self._read(nodes[v.name]) for v in outputs]
        self._values: dict[Node, list[float]] = {}  # of inputs of the whole and outputs of components, now
        self._held: dict[Node, list[float]] = {}  # of inputs of components that nothing fed yet
        wanted = {node for node, _ in (*self._reads, *self._sources.values())}
        fed = {node for node, _ in self._inputs} | set(self._sources)
        self._parts: list[_Part] = []
        for path, fmu in system.components.items():
            fmu = system.components[path] = fmu.sized(self._own_starts(path))
            into = [v for v in fmu.variables.values() if (path, v.name) in fed]
            out = [v for v in fmu.variables.values() if (path, v.name) in wanted]
            unit = make_unit(fmu, f"{name}.{path}", into, out, own=own, timeout_s=timeout_s)
            self._parts.append(_Part(path, unit, into, out))

    @property
    def notes(self) -> list[str]:
        """Notes of the file and of all components."""
        own = [f"{p.path}: {note}" for p in self._parts for note in p.unit.notes]
        return [*self._system.notes, *own]

    def start(self, starts: Mapping[str, Any]) -> list[float]:
        """Every component in order, with what those before it give at t = 0."""
        self._values.clear()
        for part in self._parts:
            own = self._starts(part.path, starts)
            for variable in part.inputs:
                node = (part.path, variable.name)
                if (values := self._fed(node)) is not None:
                    own[variable.name] = values if variable.is_array else values[0]
                self._held[node] = variable.numbers(own.get(variable.name))
            self._store(part, part.unit.start(own))
        return self._outputs()

    def run(self, steps: Steps) -> list[float]:
        """Every component in order, for one step after the other; the outputs after the last."""
        for t, h, inputs in steps:
            left = iter(inputs)
            for node, size in self._inputs:
                self._values[node] = list(islice(left, size))
            for part in self._parts:
                numbers: list[float] = []
                for variable in part.inputs:
                    node = (part.path, variable.name)
                    values = self._fed(node)
                    numbers += self._held[node] if values is None else values
                self._store(part, part.unit.run([(t, h, numbers)]))
        return self._outputs()

    def save(self) -> Any:
        """State of every component."""
        return [p.unit.save() for p in self._parts], dict(self._values), dict(self._held)

    def load(self, state: Any) -> None:
        """Take on a state that `save` gave."""
        units, values, held = state
        for part, inner in zip(self._parts, units, strict=True):
            part.unit.load(inner)
        self._values, self._held = dict(values), dict(held)

    def close(self) -> None:
        """Close every component."""
        for part in self._parts:
            part.unit.close()

    def _read(self, node: Node) -> tuple[Node, Scale]:
        """Where an output of the whole, or of a component, is read."""
        if node[0] in self._system.components:
            return node, Scale()
        return self._sources[node]  # describe_system lists no others

    def _own_starts(self, path: str) -> dict[str, Any]:
        """Start values of a component as the file has them."""
        return {v: x for (p, v), x in self._system.starts.items() if p == path}

    def _starts(self, path: str, starts: Mapping[str, Any]) -> dict[str, Any]:
        """Start values of a component: its own in the file, those of the whole, those of the scenario."""
        top = {**self._system.starts, **{("", n): v for n, v in starts.items()}}
        own = self._own_starts(path)
        for (end, name), (source, change) in self._sources.items():
            if end == path and source[0] == "" and source in top:
                own[name] = change.ours(float(top[source]))
        lead = path + "."
        own |= {n.removeprefix(lead): v for n, v in starts.items() if n.startswith(lead)}
        return {n: v for n, v in own.items() if n in self._system.components[path].variables}

    def _fed(self, node: Node) -> list[float] | None:
        """What feeds an input of a component now, None while nothing does."""
        source, change = self._sources.get(node, (node, SAME))
        values = self._values.get(source)
        return None if values is None else [change.ours(x) for x in values]

    def _store(self, part: _Part, numbers: Numbers) -> None:
        left = iter(numbers)
        for variable in part.outputs:
            self._values[part.path, variable.name] = list(islice(left, variable.size))

    def _outputs(self) -> list[float]:
        return [change.ours(x) for node, change in self._reads for x in self._values[node]]
