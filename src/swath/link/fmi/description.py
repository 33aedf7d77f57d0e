"""What an FMU says about itself: variables, units, capabilities, and the faults of its exporter.

Wrong entries that FMPy cannot read and that are not needed to run the FMU are removed.

FMUs and System Structure Packages are zip archives, unpacked here or refused in one line.
"""

import re
import shutil
import struct
import zipfile
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from zipfile import ZipFile

from swath.core.apart.call import apart
from swath.core.errors import DAMAGED, Extra, InputError, reason_of
from swath.core.files.temporary import TemporaryFolder
from swath.documents.packed import open_archive
from swath.link.fmi.units import BASE, Unit, known_unit

# What an archive or a description that is broken, encrypted or packed in an unknown way may raise.
BROKEN = (
    ArithmeticError,
    AttributeError,
    EOFError,
    LookupError,
    OSError,
    RuntimeError,  # encrypted; NotImplementedError: an unknown way of packing
    TypeError,
    ValueError,
    ElementTree.ParseError,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
)


def unpack_archive(file: Path, what: str) -> TemporaryFolder:
    """The archive in a new temporary folder. ValueError with the reason."""
    made = TemporaryFolder(what)
    try:
        with open_archive(file, "file", what="an FMU, a zip archive") as archive:
            size, room = sum(i.file_size for i in archive.infolist()), shutil.disk_usage(made.path).free
            if size > room:
                raise ValueError(f"it would take {size / 1e6:.0f} MB, there is room for {room / 1e6:.0f}")
            archive.extractall(made.path)
    except BaseException as error:
        made.remove()
        if isinstance(error, InputError):
            raise ValueError(error.expected) from error
        if isinstance(error, BROKEN):
            raise ValueError(reason(error)) from error
        raise
    return made


def reason(error: BaseException) -> str:
    """As `reason_of`, but what FMPy says of a description is kept, in one line."""
    if (said := reason_of(error)) != DAMAGED:
        return said
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 200 else text[:197] + "..."


_FIXED = ("fixed", "tunable")
_ALLOWED = {
    "parameter": _FIXED,
    "calculatedParameter": _FIXED,
    "structuralParameter": _FIXED,
    "input": ("discrete", "continuous"),
    "output": ("constant", "discrete", "continuous"),
    "independent": ("continuous",),
}
DEFAULT = "continuous"  # variability of what says none (FMI 2.0.3, 2.2.7); FMPy reads it so for every type
_VALUES = ("Real", "Integer", "Boolean", "String", "Enumeration")


def repaired(file: Path) -> tuple[BytesIO, list[str]]:
    """An FMU with a description that can be read, and nothing else; what was left out of it, one line each.

    Left out: the model structure, derivatives, types that are not defined, variabilities that do not go with
    the causality.
    """
    with open_archive(file, "file", what=DESCRIBED) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    repairs: list[str] = []
    types = {node.get("name") for node in root.iterfind("TypeDefinitions/*")}
    for node in root.iterfind("ModelVariables/*"):
        repairs += _repair_variable(node, types)
    for node in root.iterfind("ModelStructure"):
        if len(node):
            repairs.append("its model structure is left out")
        for child in list(node):
            node.remove(child)
    made = BytesIO()
    with ZipFile(made, "w") as archive:
        archive.writestr("modelDescription.xml", ElementTree.tostring(root, encoding="utf-8"))
    return made, repairs


def _repair_variable(node: Any, types: set[str | None]) -> list[str]:
    repairs, name = [], node.get("name")
    for value in (node, *(child for child in node if child.tag in _VALUES)):
        value.attrib.pop("derivative", None)
        declared = value.get("declaredType")
        if declared is not None and declared not in types:
            del value.attrib["declaredType"]
            repairs.append(f"variable {name} is of type {declared}, which is not defined")
    variability, causality = node.get("variability"), node.get("causality", "local")
    allowed = _ALLOWED.get(causality)
    if allowed is not None and (variability or DEFAULT) not in allowed:
        said = variability or f"{DEFAULT} (the default)"
        repairs.append(f"variable {name} is {causality} and {said}, which do not go together")
        node.set("variability", allowed[-1] if allowed is not _FIXED else "fixed")
    return repairs


MOST_VARIABLES = 100_000  # of an FMU; FMPy reads some 10,000 a second
KINDS = {"Real": "real", "Boolean": "bool", "String": "string", "Integer": "int", "Enumeration": "int"}
DESCRIBED = "an FMU of FMI 1, 2 or 3, its description cannot be read"
_INDEXED = re.compile(r"^(?P<base>.+)\[(?P<index>\d+(?:,\s*\d+)*)\]$")


@dataclass(frozen=True)
class Variable:
    """One variable, or an array.

    kind: real, int, bool, string or other
    type: as FMI names it, e.g. Float64
    unit: None where the FMU names none
    unit_name: as written
    start: value in the FMU's unit, None where it has none
    refs: value references, one for a scalar or an array of FMI 3, one per element for `name[i]` of FMI 2
    size: count of numbers
    is_array: also true for an array of one
    dimensions: (reference of the structural parameter that says it, -1 for none; length as the file has it)
    """

    name: str
    kind: str
    type: str
    causality: str
    variability: str
    unit_name: str | None
    unit: Unit | None
    start: Any
    refs: tuple[int, ...]
    size: int = 1
    is_array: bool = False
    dimensions: tuple[tuple[int, int], ...] = ()
    description: str = ""

    @property
    def is_number(self) -> bool:
        """True for a number or a boolean, or arrays of them."""
        return self.kind in ("real", "int", "bool")

    def numbers(self, value: Any = None) -> list[float]:
        """A value (None = the start value, else 0) as one number per element."""
        value = self.start if value is None else value
        numbers = [float(x) for x in value] if isinstance(value, list) else [float(value or 0.0)]
        return numbers if len(numbers) == self.size else numbers[:1] * self.size


@dataclass(frozen=True)
class Description:
    """One FMU. library: its binary for this system inside the archive, None where there is none.

    fixed_step, default_step [s]; faults: where it breaks the standard without harm, one line each
    package: what the file was unpacked from and must be kept for as long as the file is needed
    """

    file: Path
    version: str
    name: str
    tool: str
    token: str
    platforms: tuple[str, ...]
    library: str | None
    one_per_process: bool
    needs_tool: bool
    saves_state: bool
    serializes: bool
    variable_step: bool
    has_events: bool
    returns_early: bool
    fixed_step: float | None
    default_step: float | None
    log_categories: tuple[str, ...]
    variables: dict[str, Variable] = field(repr=False)
    clocks: tuple["Clock", ...]
    faults: tuple[str, ...]
    package: object = field(default=None, repr=False, compare=False)

    @property
    def major(self) -> int:
        """1, 2 or 3."""
        return int(self.version.partition(".")[0])

    def of(self, *causalities: str) -> list[Variable]:
        """Variables of these causalities, in the order of the file; elements of arrays are not repeated."""
        inside = {r for v in self.variables.values() if v.is_array and len(v.refs) > 1 for r in v.refs}
        return [
            v
            for v in self.variables.values()
            if v.causality in causalities and (v.is_array or not (len(v.refs) == 1 and v.refs[0] in inside))
        ]

    def sized(self, starts: Mapping[str, Any]) -> "Description":
        """The same FMU with its arrays as long as these values of structural parameters make them."""
        lengths = {
            v.refs[0]: int(starts.get(v.name, v.start or 0))
            for v in self.of("structuralParameter")
            if v.kind == "int"
        }
        if not any(name in self.variables for name in starts) or not lengths:
            return self
        sized = {
            n: replace(v, size=prod(lengths.get(ref, length) for ref, length in v.dimensions))
            for n, v in self.variables.items()
            if v.dimensions
        }
        return replace(self, variables=self.variables | sized)


@dataclass(frozen=True)
class Clock:
    """A periodic input clock: it ticks at shift + k * interval [s]."""

    name: str
    ref: int
    interval: float
    shift: float


@apart("file", "an FMU", libraries=("fmpy", "lxml.etree"), records=(Description, Variable, Clock, Unit))
def read_fmu(file: Path, key: str = "file") -> Description:
    """Read an FMU without unpacking it. InputError names what makes it unusable, `faults` what does not."""
    with Extra("fmi", "an FMU"):
        import fmpy
    with open_archive(file, key, what="an FMU, a zip archive") as archive:
        names = archive.namelist()
    if "modelDescription.xml" not in names:
        raise InputError(key, str(file), "expected an FMU, it has no modelDescription.xml")
    try:
        return _described(file, key, names, fmpy)
    except BROKEN as error:
        raise InputError(key, str(file), f"expected {DESCRIBED}: {reason(error)}") from error


def _described(file: Path, key: str, names: list[str], fmpy: Any) -> Description:
    root = _root(file)
    if (count := len(root.findall("ModelVariables/*"))) > MOST_VARIABLES:
        raise InputError(key, str(file), f"expected at most {MOST_VARIABLES} variables, it has {count}")
    model, faults = _model(file, key)
    major = int(model.fmiVersion.split(".")[0])
    side = model.coSimulation
    if side is not None and major == 1:
        _read_capabilities(root, side)
    if side is None:
        has = "model exchange" if model.modelExchange is not None else "scheduled execution"
        raise InputError(key, str(file), f"expected an FMU for co-simulation, this one is for {has} only")
    library, misplaced = _library(names, side.modelIdentifier, major, fmpy)
    variables = _variables(model, major, {u.name: _unit(u) for u in model.unitDefinitions}, faults)
    return Description(
        file=file,
        version=model.fmiVersion,
        name=model.modelName or file.stem,
        tool=model.generationTool or "",
        token=model.guid or "",
        platforms=_platforms(names),
        library=library,
        one_per_process=side.canBeInstantiatedOnlyOncePerProcess,
        needs_tool=side.needsExecutionTool,
        saves_state=side.canGetAndSetFMUstate,
        serializes=side.canSerializeFMUstate,
        variable_step=side.canHandleVariableCommunicationStepSize,
        has_events=side.hasEventMode,
        returns_early=_says(root.find("CoSimulation"), "mightReturnEarlyFromDoStep"),
        fixed_step=_number(side.fixedInternalStepSize),
        default_step=_number(getattr(model.defaultExperiment, "stepSize", None)),
        log_categories=tuple(n for c in root.iterfind("LogCategories/Category") if (n := c.get("name"))),
        variables=variables,
        clocks=_clocks(root) if major == 3 else (),
        faults=tuple(faults + misplaced),
    )


def _model(file: Path, key: str) -> tuple[Any, list[str]]:
    """The description, read strictly, or leniently with what the strict reading found."""
    from fmpy import read_model_description
    from fmpy.model_description import ValidationError

    faults: list[str] = []
    try:
        return read_model_description(str(file), validate_model_structure=True), faults
    except ValidationError as error:
        faults = [" ".join(str(p).split()) for p in error.problems]
    except Exception as error:
        faults = [" ".join(str(error).split())]
    with suppress(Exception):
        return read_model_description(str(file), validate=False), faults
    try:
        copy, repairs = repaired(file)
        return read_model_description(copy, validate=False), repairs or faults
    except Exception as error:
        raise InputError(key, str(file), f"expected {DESCRIBED}: {reason(error)}") from error


def _variables(
    model: Any, major: int, units: dict[str | None, Unit | None], faults: list[str]
) -> dict[str, Variable]:
    found: dict[str, Variable] = {}
    for v in model.modelVariables:
        if v.name in found:
            faults.append(f"two variables have the name {v.name}; the first one counts")
            continue
        found[v.name] = _variable(v, units)
        if v.start is not None and found[v.name].start is None:
            faults.append(f"the start value of {v.name}, {v.start!r}, is no number")
    return found if major == 3 else found | _arrays(found)


def _variable(v: Any, units: dict[str | None, Unit | None]) -> Variable:
    kind = KINDS.get(v.type) or (
        "real" if v.type.startswith("Float") else "int" if v.type.startswith(("Int", "UInt")) else "other"
    )
    name = v.unit or (v.declaredType.unit if v.declaredType is not None else None)
    return Variable(
        name=v.name,
        kind=kind,
        type=v.type,
        causality=v.causality or "local",
        variability=v.variability or "",
        unit_name=name,
        unit=None if name is None else units.get(name) or known_unit(name),
        start=_start(v.start, kind, bool(v.dimensions)),
        refs=(v.valueReference,),
        size=prod(v.shape or ()),
        is_array=bool(v.dimensions),
        dimensions=tuple(
            (-1 if d.valueReference is None else d.valueReference, length)
            for d, length in zip(v.dimensions, v.shape or (), strict=True)
        ),
        description=v.description or "",
    )


def _start(text: str | None, kind: str, is_array: bool) -> Any:
    if text is None or kind in ("string", "other"):
        return text
    try:
        values = [_truth(w) if kind == "bool" else float(w) for w in str(text).split()]
    except ValueError:
        return None
    return values if is_array else values[0] if values else None


def _truth(word: str) -> float:
    return 1.0 if word in ("true", "1", "1.0") else 0.0


def _arrays(scalars: dict[str, Variable]) -> dict[str, Variable]:
    """Arrays of FMI 1 and 2: all of `name[i]` or `name[i,j]`, rows first, as one variable `name`."""
    groups: dict[str, list[tuple[tuple[int, ...], Variable]]] = {}
    for variable in scalars.values():
        if (match := _INDEXED.match(variable.name)) and variable.is_number:
            index = tuple(int(i) for i in match["index"].split(","))
            groups.setdefault(match["base"], []).append((index, variable))
    made = {}
    for base, members in groups.items():
        members.sort(key=lambda m: m[0])
        first = members[0][1]
        if base in scalars or any(m.type != first.type or m.causality != first.causality for _, m in members):
            continue
        starts = [m.start for _, m in members]
        made[base] = replace(
            first,
            name=base,
            start=None if None in starts else starts,
            refs=tuple(m.refs[0] for _, m in members),
            size=len(members),
            is_array=True,
        )
    return made


def _unit(u: Any) -> Unit | None:
    """A unit as the FMU defines it; one without definition by its name, None where that says nothing."""
    base = u.baseUnit
    if base is None:
        return known_unit(u.name)
    return Unit(u.name, tuple(int(getattr(base, b)) for b in BASE), float(base.factor), float(base.offset))


def _root(file: Path) -> Element:
    """The description as it is written, for what fmpy does not read or not in every version."""
    with open_archive(file, "file", what=DESCRIBED) as archive:
        return ElementTree.fromstring(archive.read("modelDescription.xml"))


def _says(node: Element | None, name: str) -> bool:
    return node is not None and node.get(name) in ("true", "1")


def _clocks(root: Element) -> tuple[Clock, ...]:
    """Periodic input clocks of FMI 3."""
    found = []
    for node in root.iterfind("ModelVariables/Clock"):
        interval = _number(node.get("intervalDecimal"))
        is_fixed = node.get("intervalVariability") in ("constant", "fixed", "tunable")
        if node.get("causality") == "input" and is_fixed and interval:
            shift = _number(node.get("shiftDecimal")) or 0.0
            found.append(Clock(node.get("name", ""), int(node.get("valueReference", "0")), interval, shift))
    return tuple(found)


def _read_capabilities(root: Element, side: Any) -> None:
    """What FMI 1 says of co-simulation."""
    side.needsExecutionTool = root.find("Implementation/CoSimulation_Tool") is not None
    for node in root.iterfind("Implementation/*/Capabilities"):
        for name in ("canHandleVariableCommunicationStepSize", "canBeInstantiatedOnlyOncePerProcess"):
            setattr(side, name, _says(node, name))


def _number(value: Any) -> float | None:
    try:
        return None if value is None else float(value)
    except ValueError:
        return None


def _platforms(names: list[str]) -> tuple[str, ...]:
    parts = [n.split("/") for n in names if n.startswith("binaries/") and not n.endswith("/")]
    return tuple(dict.fromkeys(p[1] for p in parts if len(p) > 2))


def _library(names: list[str], identifier: str, major: int, fmpy: Any) -> tuple[str | None, list[str]]:
    """The binary for this system, and what is odd about where it lies."""
    right, other = fmpy.platform, fmpy.platform_tuple
    if major == 3:
        right, other = other, right
    for folder in (right, other):
        name = f"binaries/{folder}/{identifier}{fmpy.sharedLibraryExtension}"
        if name in names:
            odd = f"the binary lies in binaries/{folder}, not in binaries/{right}"
            return name, [] if folder == right else [odd]
    return None, []


def need_library(description: Description, key: str = "file") -> str:
    """The binary's name. InputError where the FMU has none for this system."""
    if description.library is not None:
        return description.library
    import fmpy

    has = ", ".join(description.platforms) or "none"
    wanted = fmpy.platform_tuple if description.major == 3 else fmpy.platform
    text = (
        f"expected an FMU with a binary for {wanted}, this one has {has}: export it for this system, or run "
        "it where it can and connect it over ROS 2 or CAN (docs/how-to/ros2.md, docs/how-to/hil.md)"
    )
    raise InputError(key, str(description.file), text)
