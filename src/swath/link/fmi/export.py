"""Export: some slots of a scenario become an FMU that any importer of FMI 3 or FMI 2 can step.

The archive holds the model description, the scenario with the files it names, a small Python module, and the
binaries of pythonfmu3 (FMI 3) or pythonfmu (FMI 2), which run that module in a Python that has swath. The
same scenario gives the same bytes.
"""

import hashlib
import importlib.metadata
import importlib.util
import json
import os
import shlex
import sys
import sysconfig
import uuid
import zipfile
from collections.abc import Sequence
from dataclasses import asdict
from fractions import Fraction
from itertools import product
from math import gcd, lcm
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import swath
from swath import __version__
from swath.core.errors import InputError, MissingExtra
from swath.core.files.whole_file import new_file
from swath.core.schedule import NS, from_hz
from swath.documents.yaml_document import dump
from swath.link.fmi.export_slave import FILE, Fmi3Slave, references
from swath.link.fmi.export_variables import Variable, list_variables
from swath.link.fmi.units import BASE, parse_unit
from swath.scenario.scenario import Scenario, find_slots

NAMES = ("libpython3.so", "libpython3.dylib")
SHORTEST = 100_000  # ns, of a step that is suggested; estimated


def importer_environment() -> dict[str, str]:
    """Environment of an importer on this machine, by name, for this Python; empty where it has no library.

    The binaries in the FMU are bound to Python's stable interface and start none themselves.
    """
    base = Path(sys.base_prefix)
    packages = [
        str(Path(swath.__file__).parents[1]),
        *(sysconfig.get_path(k) for k in ("purelib", "platlib")),
    ]
    found = {"PYTHONHOME": str(base), "PYTHONPATH": os.pathsep.join(dict.fromkeys(packages))}
    if sys.platform == "win32":
        return {"PATH": str(base), **found}
    folders = dict.fromkeys((sysconfig.get_config_var("LIBDIR"), base / "lib"))
    libraries = (Path(folder) / name for folder in folders if folder for name in NAMES)
    library = next((path for path in libraries if os.path.isfile(path)), None)
    return {} if library is None else {"LD_PRELOAD": str(library), **found}


def importer_line() -> str:
    """What to type before a program on this machine, one line."""
    found = importer_environment()
    if not found:
        return "this Python has no shared library (libpython3.so): only Python programs here can run the FMU"
    if sys.platform == "win32":
        return " & ".join(f"set {k}={v}" + (";%PATH%" if k == "PATH" else "") for k, v in found.items())
    return " ".join(f"{key}={shlex.quote(value)}" for key, value in found.items()) + " PROGRAM"


def elsewhere_line() -> str:
    """What such a program needs on a machine of the other system that the FMU has binaries for, one line."""
    if sys.platform == "win32":
        return (
            "on Linux: libpython3.so as LD_PRELOAD, its folder as PYTHONHOME, swath's packages in PYTHONPATH"
        )
    where = "the folder of python3.dll in PATH and as PYTHONHOME"
    return f"on Windows (not tried): {where}, swath's packages in PYTHONPATH"


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

    identifier: of the binary, a C name; step: suggested [s]; stop [s]: of the scenario
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


PACKAGES = {3: "pythonfmu3", 2: "pythonfmu"}
DATE = (1980, 1, 1, 0, 0, 0)  # of every file in the archive, so that its bytes do not depend on the clock
BINARIES = (".so", ".dll", ".dylib")

MODULE = '''\
"""Runs a part of swath for the binary beside it, made by swath {version}."""

import sys

try:
    from swath.link.fmi import export_slave as base
except Exception as error:  # the binary cannot tell why a module does not load: an instance can
    PROBLEM = (
        f"this FMU needs swath {version} in the Python of the importer ({{sys.executable or sys.prefix}}): "
        f"{{type(error).__name__}}: {{error}}"
    )

    class base:
        class Fmi{fmi}Slave:
            def __init__(self, **given):
                raise RuntimeError(PROBLEM)


{start}
    pass
'''
# The class is on one line, as the binary for FMI 3 searches for it. That for FMI 2 runs the module at every
# start and then gives back a reference to its dictionary that it never took (pythonfmu 0.7).
STARTS = {
    3: "class Swath(base.Fmi3Slave):",
    2: """\
import ctypes

ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))


class Swath(base.Fmi2Slave):""",
}


def export_fmu(
    scenario: Scenario,
    slots: Sequence[str],
    out: Path,
    *,
    version: int = 3,
    parameters: Sequence[str] = (),
) -> list[Variable]:
    """Write `out`, an FMU of the slots (`combine.process`, or `process` where there is one machine).

    version: 3 or 2; parameters: keys of the scenario that become parameters beside those of the slots' levels
    and the seed. Returns its variables. InputError for slots or keys that are not there; MissingExtra.
    """
    if version not in PACKAGES:
        raise InputError("--fmi", version, "expected 2 or 3")
    package, binaries = PACKAGES[version], find_binaries(version)
    names = find_slots(scenario, slots, key="--slot")
    variables, given = list_variables(scenario, names, parameters)
    if version == 2:
        variables = [v for v in variables if not _is_wide(v)]
    files: dict[str, bytes] = {}
    files["scenario.yaml"] = dump(_packed(scenario.plain(), files)).encode()
    files[FILE] = _manifest(names, variables, given, f"{version}")
    token = hashlib.sha256(b"".join(k.encode() + v for k, v in sorted(files.items()))).hexdigest()[:32]
    module = f"swath_{token[:16]}"  # of its own: the binaries import it by name, once in a process
    files[FILE] = _manifest(names, variables, given, token)
    files[f"{module}.py"] = MODULE.format(version=__version__, fmi=version, start=STARTS[version]).encode()
    files["slavemodule.txt"] = module.encode()
    identifier = "_".join(n.replace(".", "_").replace("-", "_") for n in names)[:60]
    description = describe_model(
        variables,
        version,
        identifier=identifier,
        token=f"{{{uuid.UUID(token)}}}",
        step=_step([from_hz(_rate(scenario, n)) for n in names]) / NS,
        stop=float(scenario.run.max_duration_s),
        modelName=" ".join(names),
        description=f"{', '.join(names)} of the swath scenario {scenario.name}",
        generationTool=f"swath {__version__} with {package} {importlib.metadata.version(package)}",
        variableNamingConvention="structured",
    )
    entries = {"modelDescription.xml": description}
    entries |= {f"resources/{name}": data for name, data in sorted(files.items())}
    for name, binary in binaries.items():
        entries[f"binaries/{name}/{identifier}{binary.suffix}"] = binary.read_bytes()
    for file in importlib.metadata.files(package) or []:
        if file.name.upper().startswith("LICENSE"):
            entries[f"documentation/licenses/{package}.txt"] = Path(str(file.locate())).read_bytes()
    _write(out, entries)
    return variables


def find_binaries(version: int) -> dict[str, Path]:
    """Folder of a platform -> the binary that runs Python modules there."""
    package = PACKAGES[version]
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        raise MissingExtra("fmi", f"an FMU of FMI {version}")
    root = Path(spec.origin).parent / "resources" / "binaries"
    found = {f.parent.name: f for f in sorted(root.rglob("*")) if f.suffix in BINARIES}
    if not found:
        raise InputError(package, str(root), "expected binaries there")
    return found


def _is_wide(v: Variable) -> bool:
    """A seed beyond what FMI 2 can count to; the scenario's own is used."""
    return v.causality == "parameter" and v.kind == "int" and not -(2**31) <= int(v.start) < 2**31


def _step(periods: Sequence[int | Fraction]) -> float:
    """The longest step of which all periods are multiples, and if that is tiny the shortest period [ns]."""
    bottom = lcm(*(period.denominator for period in periods))
    step = gcd(*(int(period * bottom) for period in periods)) / bottom
    return step if step >= SHORTEST else float(min(periods))


def _rate(scenario: Scenario, name: str) -> float:
    machine, _, slot = name.partition(".")
    return float(scenario.machines[machine].slots[slot].common.rate_hz)


def _manifest(
    names: Sequence[str], variables: Sequence[Variable], given: Sequence[tuple[str, str]], token: str
) -> bytes:
    """swath.json: slots and variables, for the module."""
    manifest = {
        "swath": __version__,
        "token": token,
        "slots": list(names),
        "given": list(given),
        "variables": [asdict(v) for v in variables],
    }
    return json.dumps(manifest, indent=1).encode()


def _packed(data: Any, files: dict[str, bytes]) -> Any:
    """The data with paths to files of the user replaced by those of copies, which are added to `files`."""
    if isinstance(data, dict):
        return {k: _packed(v, files) for k, v in data.items()}
    if isinstance(data, list):
        return [_packed(v, files) for v in data]
    if not isinstance(data, str):
        return data
    text, colon, name = data.rpartition(":") if ".py:" in data else (data, "", "")
    source = Path(text)
    if not source.is_absolute() or not os.path.exists(source):
        return data
    target = f"files/{hashlib.sha256(text.encode()).hexdigest()[:8]}-{source.name}"
    members = (
        [f for f in sorted(source.rglob("*")) if os.path.isfile(f)] if os.path.isdir(source) else [source]
    )
    for file in members:
        place = f"{target}/{file.relative_to(source).as_posix()}" if os.path.isdir(source) else target
        files[place] = file.read_bytes()
    return f"{target}{colon}{name}"


def _write(out: Path, entries: dict[str, bytes]) -> None:
    with new_file(out) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in entries.items():
            info = zipfile.ZipInfo(name, DATE)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, data)
