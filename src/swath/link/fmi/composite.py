"""Several FMUs as one: what a System Structure file connects, stepped one after the other in declared order.

Each component sees what those before it gave in this step and what those after it gave in the last one
(Gauss-Seidel), as the slots of a machine do.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from swath.link.fmi.description import Description, Variable, read_fmu
from swath.link.fmi.instance import Numbers, Steps
from swath.link.fmi.runner import Runner
from swath.link.fmi.ssp import SUFFIXES, Node, System, read_system
from swath.link.fmi.units import Scale

ALL = ("structuralParameter", "parameter", "input", "output", "calculatedParameter", "local")


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
    whole = replace(
        fmus[0],
        file=system.file,
        name=system.file.stem,
        variables=numbered,
        faults=faults,
        variable_step=all(f.variable_step for f in fmus),
        saves_state=all(f.saves_state for f in fmus),
        serializes=all(f.serializes for f in fmus),
        needs_tool=any(f.needs_tool for f in fmus),
        has_events=any(f.has_events for f in fmus),
        returns_early=any(f.returns_early for f in fmus),
        one_per_process=any(f.one_per_process for f in fmus),
        fixed_step=None,
    )
    return whole, nodes


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
    """A component as it runs.

    inputs: name -> its place in `numbers`; outputs: name -> its place in `given`
    links: place in `numbers`, list that feeds it (None = from outside), place there, change
    """

    path: str
    runner: Runner
    inputs: dict[str, slice]
    outputs: dict[str, slice]
    numbers: list[float]
    given: list[float]
    links: list[tuple[slice, "list[float] | None", slice, Scale]]


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
        self._top = _slices(inputs)
        read = [self._read(nodes[v.name]) for v in outputs]
        wanted = {node for node, _ in read} | {node for node, _ in self._sources.values()}
        fed = {nodes[v.name] for v in inputs} | set(self._sources)
        self._outside: list[float] = [0.0] * sum(v.size for v in inputs)
        self._parts = [self._part(path, name, fed, wanted, own, timeout_s) for path in system.components]
        by_path = {p.path: p for p in self._parts}
        self._link(nodes, inputs, by_path)
        self._read_plan = [
            (by_path[path], by_path[path].outputs[variable], change) for (path, variable), change in read
        ]

    @property
    def notes(self) -> list[str]:
        """Of the file and of all components."""
        own = [f"{p.path}: {note}" for p in self._parts for note in p.runner.notes]
        return [*self._system.notes, *own]

    def start(self, starts: Mapping[str, Any]) -> list[float]:
        """Every component in order, with what those before it give at t = 0."""
        done: list[list[float]] = []
        for part in self._parts:
            known = self._system.components[part.path].variables
            own = {n: v for n, v in self._starts(part, starts).items() if n in known}
            for name, at in part.inputs.items():
                for into, given, place, change in part.links:
                    if into == at and any(given is g for g in done) and given is not None:
                        values = [change.ours(x) for x in given[place]]
                        own[name] = values if known[name].is_array else values[0]
                value = own.get(name, known[name].start or 0.0)
                numbers = [float(x) for x in (value if isinstance(value, list) else [value])]
                part.numbers[at] = numbers * (1 if len(numbers) > 1 else at.stop - at.start)
            part.given[:] = part.runner.start(own)
            done.append(part.given)
        return self._outputs()

    def _starts(self, part: _Part, starts: Mapping[str, Any]) -> dict[str, Any]:
        """Start values of a component: its own in the file, those of the whole, those of the scenario."""
        own = {v: x for (path, v), x in self._system.starts.items() if path == part.path}
        own |= self._from_top(part, self._system.starts)
        own |= self._from_top(part, {("", n): v for n, v in starts.items()})
        prefix = part.path + "."
        return own | {n.removeprefix(prefix): v for n, v in starts.items() if n.startswith(prefix)}

    def run(self, steps: Steps) -> list[float]:
        """Every component in order, for one step after the other; the outputs after the last."""
        for t, h, inputs in steps:
            self._step(t, h, inputs)
        return self._outputs()

    def _step(self, t: float, h: float, inputs: Numbers) -> None:
        self._outside[:] = inputs
        for part in self._parts:
            for into, given, place, change in part.links:
                part.numbers[into] = [
                    change.ours(x) for x in (self._outside if given is None else given)[place]
                ]
            part.given[:] = part.runner.run([(t, h, part.numbers)])

    def save(self) -> Any:
        """State of every component."""
        return [(p.runner.save(), list(p.given), list(p.numbers)) for p in self._parts]

    def load(self, state: Any) -> None:
        """Back to it."""
        for part, (inner, given, numbers) in zip(self._parts, state, strict=True):
            part.runner.load(inner)
            part.given[:], part.numbers[:] = given, numbers

    def close(self) -> None:
        """Close every component."""
        for part in self._parts:
            part.runner.close()

    def _read(self, node: Node) -> tuple[Node, Scale]:
        """Where an output of the whole, or of a component, is read."""
        if node[0] in self._system.components:
            return node, Scale()
        found = self._system.source_of(node)
        assert found is not None  # describe_system lists no others
        return found

    def _part(
        self, path: str, name: str, fed: set[Node], wanted: set[Node], own: bool, timeout_s: float
    ) -> _Part:
        fmu = self._system.components[path]
        starts = {v: x for (p, v), x in self._system.starts.items() if p == path}
        fmu = self._system.components[path] = fmu.sized(starts)
        inputs = [v for v in fmu.variables.values() if (path, v.name) in fed]
        outputs = [v for v in fmu.variables.values() if (path, v.name) in wanted]
        runner = Runner(fmu, f"{name}.{path}", inputs, outputs, own=own, timeout_s=timeout_s)
        numbers = [0.0] * sum(v.size for v in inputs)
        given = [0.0] * sum(v.size for v in outputs)
        return _Part(path, runner, _slices(inputs), _slices(outputs), numbers, given, [])

    def _link(
        self, nodes: Mapping[str, Node], inputs: Sequence[Variable], by_path: Mapping[str, _Part]
    ) -> None:
        outside = {nodes[v.name]: self._top[v.name] for v in inputs}
        for (path, name), (source, change) in self._sources.items():
            if path not in by_path:
                continue
            into = by_path[path].inputs[name]
            if source[0] in by_path:
                giver = by_path[source[0]]
                by_path[path].links.append((into, giver.given, giver.outputs[source[1]], change))
            elif source in outside:
                by_path[path].links.append((into, None, outside[source], change))
        for (path, name), place in outside.items():
            if path in by_path:
                by_path[path].links.append((by_path[path].inputs[name], None, place, Scale()))

    def _from_top(self, part: _Part, values: Mapping[Node, Any]) -> dict[str, Any]:
        """Values of connectors of the whole, as the inputs of a component that they feed."""
        found = {}
        for (path, name), (source, change) in self._sources.items():
            if path == part.path and source[0] == "" and source in values:
                found[name] = change.ours(float(values[source]))
        return found

    def _outputs(self) -> list[float]:
        found: list[float] = []
        for part, place, change in self._read_plan:
            found += [change.ours(x) for x in part.given[place]]
        return found


def _slices(variables: Sequence[Variable]) -> dict[str, slice]:
    made, at = {}, 0
    for v in variables:
        made[v.name] = slice(at, at + v.size)
        at += v.size
    return made
