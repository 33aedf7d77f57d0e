"""FMI 1.0 for co-simulation: other names and no initialization mode (FMI for Co-Simulation 1.0, chapter 3).

It has no states that could be saved, and a discarded step does not say that the simulation ended.
"""

import ctypes
from collections.abc import Mapping
from typing import Any

from swath.link.fmi.calls import callbacks
from swath.link.fmi.version2 import Instance2

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
