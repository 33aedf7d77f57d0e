"""System Structure and Parameterization (SSP 1.0): FMUs and their connections, read from .ssp or .ssd.

Systems within systems are flattened: a component is named by its path, `Drive.Engine`. Units are converted
from the start of a connection to its end, then its linear transformation is applied (SSP 1.0, 4.5.5.6).
"""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from swath.core.errors import InputError, reason_of
from swath.core.files.temporary import TemporaryFolder
from swath.link.fmi.description import BROKEN, Description, read_fmu, unpack_archive
from swath.link.fmi.units import BASE, Scale, Unit, parse_unit, scale

_SSP = "{http://ssp-standard.org/SSP1/SystemStructure"
SSD, SSC, SSV = f"{_SSP}Description}}", f"{_SSP}Common}}", f"{_SSP}ParameterValues}}"
SUFFIXES = (".ssp", ".ssd")
Node = tuple[str, str]  # path of an element, "" for the whole system; name of its connector
Edge = tuple[Node, Scale, bool]  # where it starts, its transformation, whether units are left alone
NUMBERS = ("Real", "Float64", "Float32", "Integer", "Boolean", "Enumeration")


@dataclass
class System:
    """What a System Structure file says.

    components: FMUs by path, in declared order
    kinds, units: of connectors
    edges: end -> where it starts
    starts: (path, variable) -> value in the unit of the variable
    notes: what was left out
    unpacked: the files, where they came in an archive
    """

    file: Path
    components: dict[str, Description] = field(default_factory=dict)
    kinds: dict[Node, str] = field(default_factory=dict)
    units: dict[Node, Unit] = field(default_factory=dict)
    edges: dict[Node, Edge] = field(default_factory=dict)
    starts: dict[Node, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    unpacked: TemporaryFolder | None = None

    def unit_of(self, node: Node) -> Unit | None:
        """Unit of a connector: of the FMU's variable, else as declared."""
        component = self.components.get(node[0])
        variable = None if component is None else component.variables.get(node[1])
        own = None if variable is None else variable.unit
        return own or self.units.get(node)

    def source_of(self, node: Node) -> tuple[Node, Scale] | None:
        """Where the number of a connector comes from, an output of a component or an input of the whole,
        and how it changes on the way. None for one that is not connected.
        """
        chain: list[tuple[Node, Edge]] = []
        at = node
        while at in self.edges:
            edge = self.edges[at]
            chain.append((at, edge))
            if len(chain) > len(self.edges):
                raise InputError("file", str(self.file), f"the connections of {node[1]} go in a circle")
            at = edge[0]
            if at[0] in self.components:
                break
        if not chain or not (at[0] == "" or at[0] in self.components):
            return None
        return at, self._along(at, chain)

    def _along(self, start: Node, chain: list[tuple[Node, Edge]]) -> Scale:
        """The scale from the start of a chain of edges, the last one first, to its end."""
        factor, offset, unit = 1.0, 0.0, self.unit_of(start)
        for end, (_, transformation, is_plain) in reversed(chain):
            wanted = self.unit_of(end)
            if wanted is not None and unit is not None and not is_plain:
                step = scale(unit, wanted)
                if step is None:
                    text = f"{'.'.join(start)} is in {unit.name}, {'.'.join(end)} in {wanted.name}"
                    raise InputError("file", str(self.file), f"expected ends of one quantity, but {text}")
                factor, offset = factor * step.factor, offset * step.factor + step.offset
            unit = wanted or unit
            factor = transformation.factor * factor
            offset = transformation.factor * offset + transformation.offset
        return Scale(factor, offset)


def read_system(file: Path) -> System:
    """A system from .ssp or .ssd. InputError where it cannot be used."""
    folder, name = file.parent, file.name
    system = System(file)
    if file.suffix.lower() == ".ssp":
        try:
            system.unpacked = unpack_archive(file, "ssp")
        except ValueError as error:
            raise InputError(
                "file", str(file), f"expected a System Structure Package: {reason_of(error)}"
            ) from error
        folder, name = system.unpacked.path, "SystemStructure.ssd"
    try:
        root = ElementTree.parse(folder / name).getroot()
        top = root.find(SSD + "System")
        if top is None:
            raise ValueError("it has no System")
        reader = _Reader(system, folder, _units(root))
        reader.element("", top)
        reader.bindings("", top)
    except BROKEN as error:
        text = f"expected a System Structure Description, it cannot be read: {reason_of(error)}"
        raise InputError("file", str(file), text) from error
    if not system.components:
        raise InputError("file", str(file), "expected components with FMUs")
    for end in system.edges:
        system.source_of(end)  # refuses what does not fit
    return system


class _Reader:
    def __init__(self, system: System, folder: Path, units: dict[str, Unit]) -> None:
        self.system, self.folder, self.units = system, folder, units

    def element(self, path: str, node: Any) -> None:
        """A system: its connectors, elements and connections."""
        self.connectors(path, node)
        for child in node.iterfind(f"{SSD}Elements/*"):
            inner = f"{path}.{child.get('name')}".lstrip(".")
            if child.tag == SSD + "System":
                self.element(inner, child)
            elif child.tag == SSD + "Component":
                self.component(inner, child)
            else:
                self.system.notes.append(f"{inner} is left out: {child.tag.rpartition('}')[2]}")
                continue
            self.bindings(inner, child)
        for connection in node.iterfind(f"{SSD}Connections/{SSD}Connection"):
            self.connection(path, connection)

    def component(self, path: str, node: Any) -> None:
        """A component: an FMU beside the description or in the package."""
        source, kind = node.get("source", ""), node.get("type", "application/x-fmu-sharedlibrary")
        if kind != "application/x-fmu-sharedlibrary" or not os.path.isfile(self.folder / source):
            text = f"expected an FMU for component {path}, its source is {source or 'missing'} of type {kind}"
            raise InputError("file", str(self.system.file), text)
        self.system.components[path] = read_fmu(self.folder / source)
        self.connectors(path, node)

    def connectors(self, path: str, node: Any) -> None:
        """Kinds and units of connectors."""
        for connector in node.iterfind(f"{SSD}Connectors/{SSD}Connector"):
            at = (path, connector.get("name", ""))
            self.system.kinds[at] = connector.get("kind", "")
            for child in connector:
                if (name := child.get("unit")) is not None:
                    self.system.units[at] = self.units.get(name) or parse_unit(name)

    def connection(self, path: str, node: Any) -> None:
        """A connection within the system at `path`."""
        start, end = (
            (f"{path}.{node.get(f'{side}Element', '')}".strip("."), node.get(f"{side}Connector", ""))
            for side in ("start", "end")
        )
        change = Scale()
        for child in node:
            if child.tag == SSC + "LinearTransformation":
                change = Scale(float(child.get("factor", 1.0)), float(child.get("offset", 0.0)))
            elif child.tag.endswith("Transformation"):
                text = f"expected linear transformations only, {'.'.join(start)} has another"
                raise InputError("file", str(self.system.file), text)
        for at in (start, end):
            self._check_end(at)
        is_plain = node.get("suppressUnitConversion") in ("true", "1")
        if end in self.system.edges:
            raise InputError("file", str(self.system.file), f"two connections end at {'.'.join(end)}")
        self.system.edges[end] = (start, change, is_plain)

    def _check_end(self, at: Node) -> None:
        component = self.system.components.get(at[0])
        if at not in self.system.kinds if component is None else at[1] not in component.variables:
            text = f"expected connections between what is there, there is no {'.'.join(at).lstrip('.')}"
            raise InputError("file", str(self.system.file), text)

    def bindings(self, path: str, node: Any) -> None:
        """Parameter values of an element; those without a variable are ignored, as the standard has it."""
        for binding in node.iterfind(f"{SSD}ParameterBindings/{SSD}ParameterBinding"):
            if binding.find(SSD + "ParameterMapping") is not None:
                text = f"expected parameters of {path or 'the system'} by their names, without a mapping"
                raise InputError("file", str(self.system.file), text)
            source = binding.get("source")
            values = binding if source is None else ElementTree.parse(self.folder / source).getroot()
            for parameter in values.iter(SSV + "Parameter"):
                name = binding.get("prefix", "") + parameter.get("name", "")
                self._set(path, name, parameter[0])

    def _set(self, path: str, name: str, value: Any) -> None:
        inner, _, variable = f"{path}.{name}".lstrip(".").rpartition(".")
        at = (inner, variable)
        text, kind = value.get("value", ""), value.tag.rpartition("}")[2]
        if inner not in self.system.components and (path, name) in self.system.kinds:
            at = (path, name)
        elif inner not in self.system.components or variable not in self.system.components[inner].variables:
            return
        made: Any = text
        if kind == "Boolean":
            made = text in ("true", "1")
        elif kind in NUMBERS:
            made = float(text)
            unit, ours = value.get("unit"), self.system.unit_of(at)
            if unit is not None and ours is not None:
                change = scale(self.units.get(unit) or parse_unit(unit), ours)
                made = made if change is None else change.ours(made)
        self.system.starts[at] = made


def _units(root: Any) -> dict[str, Unit]:
    found = {}
    for node in root.iterfind(f"{SSD}Units/{SSC}Unit"):
        base = node.find(SSC + "BaseUnit")
        if base is not None:
            name = node.get("name", "")
            powers = tuple(int(base.get(b, 0)) for b in BASE)
            found[name] = Unit(name, powers, float(base.get("factor", 1)), float(base.get("offset", 0)))
    return found
