"""An instance of an FMU by the version of its standard."""

from collections.abc import Sequence
from pathlib import Path

from swath.link.fmi.description import Description, Variable, need_library
from swath.link.fmi.instance import Instance
from swath.link.fmi.version1 import Instance1
from swath.link.fmi.version2 import Instance2
from swath.link.fmi.version3 import Instance3

VERSIONS: dict[int, type[Instance]] = {1: Instance1, 2: Instance2, 3: Instance3}


def make_instance(
    fmu: Description,
    name: str,
    inputs: Sequence[Variable],
    outputs: Sequence[Variable],
    folder: Path | None = None,
) -> Instance:
    """An instance in this process. InputError without a binary for this system."""
    need_library(fmu)
    return VERSIONS[fmu.major](fmu, name, inputs, outputs, folder)
