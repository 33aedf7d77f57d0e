"""modelDescription.xml of an exported FMU, for FMI 3.0 and FMI 2.0 (co-simulation)."""

from collections.abc import Sequence
from itertools import product
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from swath.link.fmi.export_slave import Fmi3Slave, references
from swath.link.fmi.export_variables import Variable
from swath.link.fmi.units import BASE, parse_unit

TYPES = {
    3: {"real": "Float64", "int": "Int64", "bool": "Boolean", "text": "String"},
    2: {"real": "Real", "int": "Integer", "bool": "Boolean", "text": "String"},
}
# Whoever loads the FMU needs a Python with swath: an execution tool in the words of the standard.
ABILITIES = {
    "needsExecutionTool": "true",
    "canHandleVariableCommunicationStepSize": "true",
    "canBeInstantiatedOnlyOncePerProcess": "false",
}


def describe_model(
    variables: Sequence[Variable],
    version: int,
    *,
    identifier: str,
    token: str,
    step: float,
    stop: float,
    **about: str,
) -> bytes:
    """The file, for FMI `version` 2 or 3.

    identifier: of the binary, a C name; step: the shortest period [s]; stop [s]: of the scenario
    about: further attributes of the root, e.g. modelName
    """
    token_name, state = ("instantiationToken", "State") if version == 3 else ("guid", "state")
    root = Element("fmiModelDescription", fmiVersion=f"{version}.0", attrib={**about, token_name: token})
    side = {"modelIdentifier": identifier, **ABILITIES}
    side |= {f"canGetAndSetFMU{state}": "true", f"canSerializeFMU{state}": "true"}
    if version == 2:
        side["canNotUseMemoryManagementFunctions"] = "true"
    SubElement(root, "CoSimulation", side)
    _units(root, variables)
    log = SubElement(root, "LogCategories")
    for name, text in Fmi3Slave.log_categories.items():
        SubElement(log, "Category", name=name, description=text)
    times = {"startTime": "0", "stopTime": repr(stop), "stepSize": repr(step)}
    SubElement(root, "DefaultExperiment", times)
    listed = SubElement(root, "ModelVariables")
    refs = list(references(variables, split=version == 2))
    for ref, (index, element) in enumerate(refs):
        make = _variable3 if version == 3 else _variable2
        listed.append(make(variables[index], ref, element))
    _structure(root, [ref for ref, (i, _) in enumerate(refs) if variables[i].causality == "output"], version)
    indent(root, " ")
    return bytes(tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"


def _units(root: Element, variables: Sequence[Variable]) -> None:
    names = sorted({v.unit for v in variables if v.unit})
    if not names:
        return
    listed = SubElement(root, "UnitDefinitions")
    for name in names:
        unit = parse_unit(name)
        given = {b: str(e) for b, e in zip(BASE, unit.exponents, strict=True) if e}
        if unit.factor != 1.0:
            given["factor"] = repr(unit.factor)
        SubElement(SubElement(listed, "Unit", name=name), "BaseUnit", given)


def _common(v: Variable, ref: int, name: str) -> dict[str, str]:
    changes = {"parameter": "fixed", "independent": "continuous"}.get(v.causality, "discrete")
    given = {"name": name, "valueReference": str(ref), "causality": v.causality, "variability": changes}
    if v.causality == "output":
        given["initial"] = "calculated"
    if v.description:
        given["description"] = v.description
    return given


def _variable3(v: Variable, ref: int, element: int | None) -> Element:
    made = Element(TYPES[3][v.kind], _common(v, ref, v.name))
    if v.unit:
        made.set("unit", v.unit)
    if v.causality in ("input", "parameter"):
        if v.kind == "text":
            SubElement(made, "Start", value=str(v.start))
        else:
            made.set("start", " ".join(_number(x) for x in (v.start if v.shape else [v.start])))
    for length in v.shape:
        SubElement(made, "Dimension", start=str(length))
    return made


def _variable2(v: Variable, ref: int, element: int | None) -> Element:
    name, start = v.name, v.start
    if element is not None:
        places = list(product(*(range(1, n + 1) for n in v.shape)))[element]
        name, start = f"{name}[{','.join(map(str, places))}]", v.start[element]
    made = Element("ScalarVariable", _common(v, ref, name))
    value = SubElement(made, TYPES[2][v.kind])
    if v.unit:
        value.set("unit", v.unit)
    if v.causality in ("input", "parameter"):
        value.set("start", start if v.kind == "text" else _number(start))
    return made


def _structure(root: Element, outputs: list[int], version: int) -> None:
    structure = SubElement(root, "ModelStructure")
    if version == 3:
        for tag in ("Output", "InitialUnknown"):
            for ref in outputs:
                SubElement(structure, tag, valueReference=str(ref))
        return
    for tag in ("Outputs", "InitialUnknowns"):
        if outputs:
            listed = SubElement(structure, tag)
            for ref in outputs:
                SubElement(listed, "Unknown", index=str(ref + 1))


def _number(value: Any) -> str:
    """As xs:double and xs:boolean have it."""
    if isinstance(value, bool | int):
        return str(value).lower()
    return {"nan": "NaN", "inf": "INF", "-inf": "-INF"}.get(repr(float(value)), repr(float(value)))
