"""An instance of an FMU by the version of its standard.

FMI 1.0 has other names and no initialization mode (FMI for Co-Simulation 1.0, chapter 3),
no states that could be saved, and a discarded step does not say that the simulation ended.
"""

import ctypes
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from swath.link.fmi.calls import callbacks
from swath.link.fmi.description import Description, Variable, need_library
from swath.link.fmi.instance import Instance
from swath.link.fmi.version2 import Instance2
from swath.link.fmi.version3 import Instance3

MIME = b"application/x-fmu-sharedlibrary"


class Instance1(Instance2):
    """An FMU of FMI 1.0 in this process."""

    END, FREE = "TerminateSlave", "FreeSlaveInstance"
    IS_NEW_STEP, SAYS_ENDED = 1, False

    def _instantiate(self) -> int | None:
        make = self.library.function("InstantiateSlave")
        make.restype = ctypes.c_void_p
        no = ctypes.c_char(0)
        made: int | None = make(
            self.name.encode(),
            self.description.token.encode(),
            self.folder.as_uri().encode(),
            MIME,
            ctypes.c_double(0.0),
            no,
            no,
            callbacks(1),
            no,
        )
        return made

    def _initialise(self, starts: Mapping[str, Any]) -> None:
        zero, no = ctypes.c_double(0.0), ctypes.c_char(0)
        self.set_starts(starts)
        self.library.call("InitializeSlave", self.handle, zero, no, zero)


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
