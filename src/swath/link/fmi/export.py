"""Export: some slots of a scenario become an FMU that any importer of FMI 3 or FMI 2 can step.

The archive holds the model description, the scenario with the files it names, a small Python module, and the
binaries of pythonfmu3 (FMI 3) or pythonfmu (FMI 2), which run that module in a Python that has swath. The
same scenario gives the same bytes.
"""

import hashlib
import importlib.metadata
import importlib.util
import json
import uuid
import zipfile
from collections.abc import Sequence
from dataclasses import asdict
from math import gcd
from pathlib import Path
from typing import Any

from swath import __version__
from swath.core.errors import InputError, MissingExtra
from swath.core.schedule import NS, from_hz
from swath.core.whole_file import new_file
from swath.documents.yaml_document import dump
from swath.link.fmi.export_slave import FILE
from swath.link.fmi.export_variables import Variable, list_variables
from swath.link.fmi.export_xml import describe_model
from swath.scenario.scenario import Scenario
from swath.scenario.slot_names import find_slots

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
    periods = [from_hz(_rate(scenario, n)) for n in names]
    description = describe_model(
        variables,
        version,
        identifier=identifier,
        token=f"{{{uuid.UUID(token)}}}",
        step=gcd(*periods) / NS,
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
    if not source.is_absolute() or not source.exists():
        return data
    target = f"files/{hashlib.sha256(text.encode()).hexdigest()[:8]}-{source.name}"
    members = [f for f in sorted(source.rglob("*")) if f.is_file()] if source.is_dir() else [source]
    for file in members:
        place = f"{target}/{file.relative_to(source).as_posix()}" if source.is_dir() else target
        files[place] = file.read_bytes()
    return f"{target}{colon}{name}"


def _write(out: Path, entries: dict[str, bytes]) -> None:
    out.parent.mkdir(parents=True, exist_ok=True)
    with new_file(out) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in entries.items():
            info = zipfile.ZipInfo(name, DATE)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, data)
