"""FMI 2: calls in the order of the standard's state machine (FMI 2.0.4, section 4.2.4)."""

import ctypes
import time
from collections.abc import Mapping
from typing import Any

from swath.link.fmi.calls import DISCARD, PENDING, WARNING, FmuError, callbacks
from swath.link.fmi.instance import Instance, Numbers, is_close

CO_SIMULATION = 1
DO_STEP_STATUS, LAST_SUCCESSFUL_TIME, TERMINATED = 0, 2, 3
MOST_RETRIES = 1000


class Instance2(Instance):
    """An FMU of FMI 2 in this process.

    IS_NEW_STEP: last argument of DoStep; SAYS_ENDED: a discarded step can tell that the simulation ended
    """

    IS_NEW_STEP, SAYS_ENDED = 0, True

    def _instantiate(self) -> int | None:
        make = self.library.function("Instantiate")
        make.restype = ctypes.c_void_p
        made: int | None = make(
            self.name.encode(),
            CO_SIMULATION,
            self.description.token.encode(),
            (self.folder / "resources").as_uri().encode(),
            ctypes.byref(callbacks(2)),
            0,
            0,
        )
        return made

    def _initialise(self, starts: Mapping[str, Any]) -> None:
        zero = ctypes.c_double(0.0)
        self.library.call("SetupExperiment", self.handle, 0, zero, zero, 0, zero)
        self.set_starts(starts)
        self.library.call("EnterInitializationMode", self.handle)
        self.library.call("ExitInitializationMode", self.handle)

    def _advance(self, t: float, h: float, inputs: Numbers) -> None:
        self.set(self._inputs, inputs)
        at, end, left = t, t + h, h
        for _ in range(MOST_RETRIES):
            status = self._do_step(at, left)
            if status <= WARNING:
                return
            if status != DISCARD:
                raise self.library.failed("DoStep", status)
            if self.SAYS_ENDED and self._status("GetBooleanStatus", TERMINATED, ctypes.c_int()):
                raise FmuError(f"it ended the simulation at {at:g} s of its own accord")
            reached = self._status("GetRealStatus", LAST_SUCCESSFUL_TIME, ctypes.c_double())
            if reached is None or not at < reached:
                raise self.library.failed("DoStep", status)
            if is_close(reached, end):
                return
            at, left = reached, end - reached
        raise FmuError(f"{self.library.prefix}DoStep returned early {MOST_RETRIES} times within one step")

    def _do_step(self, t: float, h: float) -> int:
        function = self.library.function("DoStep")
        status: int = function(self.handle, ctypes.c_double(t), ctypes.c_double(h), self.IS_NEW_STEP)
        while status == PENDING:
            time.sleep(0.0)
            found = ctypes.c_int(PENDING)
            self.library.call("GetStatus", self.handle, DO_STEP_STATUS, ctypes.byref(found))
            status = found.value
        return status

    def _status(self, function: str, kind: int, found: Any) -> Any:
        """What the FMU says about a discarded step, None where it does not."""
        try:
            self.library.call(function, self.handle, kind, ctypes.byref(found))
        except FmuError:
            return None
        return found.value
