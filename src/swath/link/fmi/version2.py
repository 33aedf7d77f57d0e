"""FMI 2: calls in the order of the standard's state machine (FMI 2.0.4, section 4.2.4)."""

import ctypes
import time
from collections.abc import Mapping
from typing import Any

from swath.link.fmi.calls import DISCARD, PENDING, WARNING, callbacks2, fill, log_categories
from swath.link.fmi.errors import FmuError
from swath.link.fmi.instance import Instance, Numbers, is_close

CO_SIMULATION = 1
DO_STEP_STATUS, LAST_SUCCESSFUL_TIME, TERMINATED = 0, 2, 3
MOST_RETRIES = 1000


class Instance2(Instance):
    """An FMU of FMI 2 in this process."""

    def _instantiate(self) -> int | None:
        make = self.library.function("Instantiate")
        make.restype = ctypes.c_void_p
        self._callbacks = callbacks2()
        made: int | None = make(
            self.name.encode(),
            CO_SIMULATION,
            self.description.token.encode(),
            (self.folder / "resources").as_uri().encode(),
            ctypes.byref(self._callbacks[0]),
            0,
            0,
        )
        return made

    def _initialise(self, starts: Mapping[str, Any]) -> None:
        if categories := log_categories(self.description):
            names = (ctypes.c_char_p * len(categories))(*(c.encode() for c in categories))
            self.library.function("SetDebugLogging")(self.handle, 1, ctypes.c_size_t(len(categories)), names)
        zero = ctypes.c_double(0.0)
        self.library.call("SetupExperiment", self.handle, 0, zero, zero, 0, zero)
        self.set_starts(starts)
        self.library.call("EnterInitializationMode", self.handle)
        self.library.call("ExitInitializationMode", self.handle)

    def _advance(self, t: float, h: float, inputs: Numbers) -> None:
        for group in self._inputs:
            fill(group, inputs)
            self.set(group)
        at, end, left = t, t + h, h
        for _ in range(MOST_RETRIES):
            status = self._do_step(at, left)
            if status <= WARNING:
                return
            if status != DISCARD:
                raise self.library.failed("DoStep", status)
            self._check_terminated(at)
            reached = self._last_time()
            if reached is None or not at < reached:
                raise self.library.failed("DoStep", status)
            if is_close(reached, end):
                return
            at, left = reached, end - reached
        raise FmuError(f"fmi2DoStep returned early {MOST_RETRIES} times within one step")

    def _do_step(self, t: float, h: float) -> int:
        function = self.library.function("DoStep")
        status: int = function(self.handle, ctypes.c_double(t), ctypes.c_double(h), 0)
        while status == PENDING:
            time.sleep(0.0)
            found = ctypes.c_int(PENDING)
            self.library.call("GetStatus", self.handle, DO_STEP_STATUS, ctypes.byref(found))
            status = found.value
        return status

    def _check_terminated(self, t: float) -> None:
        ended = ctypes.c_int(0)
        try:
            self.library.call("GetBooleanStatus", self.handle, TERMINATED, ctypes.byref(ended))
        except FmuError:
            return
        if ended.value:
            raise FmuError(f"it ended the simulation at {t:g} s of its own accord")

    def _last_time(self) -> float | None:
        """How far a discarded step came [s], None where the FMU does not say."""
        reached = ctypes.c_double()
        try:
            self.library.call("GetRealStatus", self.handle, LAST_SUCCESSFUL_TIME, ctypes.byref(reached))
        except FmuError:
            return None
        return reached.value
