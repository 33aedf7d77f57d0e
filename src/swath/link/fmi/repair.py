"""Repairs descriptions that FMPy cannot read: removes wrong entries that are not needed to run the FMU."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from swath.documents.packed import open_archive

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


@contextmanager
def repaired(file: Path) -> Iterator[tuple[Path, list[str]]]:
    """A copy of an FMU's description for reading, and what was left out of it, one line each.

    Left out: the model structure, derivatives, types that are not defined, variabilities that do not go with
    the causality.
    """
    with open_archive(file, "file") as archive:
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
    with tempfile.TemporaryDirectory(prefix="swath-fmu-") as folder:
        copy = Path(folder) / "modelDescription.xml"
        ElementTree.ElementTree(root).write(copy, encoding="utf-8")
        yield copy, repairs


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
