"""An instance of an FMU by the version of its standard.

FMI 1.0 has other names and no initialization mode (FMI for Co-Simulation 1.0, chapter 3), no states that
could be saved, and a discarded step does not say that the simulation ended. FMI 2: calls in the order of the
standard's state machine (FMI 2.0.4, section 4.2.4). FMI 3: co-simulation with event mode, early return and
periodic clocks (FMI 3.0, sections 4.2, 2.3.5).
"""

import ctypes
import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from swath.link.fmi.calls import DISCARD, PENDING, WARNING, FmuError, callbacks, logger3
from swath.link.fmi.description import Description, Variable, need_library
from swath.link.fmi.instance import Instance, Numbers, is_close

MOST_EVENTS = 10_000


class Instance3(Instance):
    """An FMU of FMI 3 in this process."""

    remembered = ("_next_event", "_ticks", "_discrete")
    _discrete: tuple[float, ...] | None

    def _instantiate(self) -> int | None:
        self._has_events = self.description.has_events
        made = self._try_to_instantiate()
        if made is None and self._has_events:
            self._has_events = False
            made = self._try_to_instantiate()
            self.notes = ("it says that it has an event mode but starts only without it",)
        return made

    def _try_to_instantiate(self) -> int | None:
        make = self.library.function("InstantiateCoSimulation")
        make.restype = ctypes.c_void_p
        self._logger = logger3(self.library)
        made: int | None = make(
            self.name.encode(),
            self.description.token.encode(),
            f"{self.folder / 'resources'}/".encode(),
            ctypes.c_bool(False),
            ctypes.c_bool(False),
            ctypes.c_bool(self._has_events),
            ctypes.c_bool(self.description.returns_early),
            None,
            ctypes.c_size_t(0),
            None,
            self._logger,
            None,
        )
        return made

    def _initialise(self, starts: Mapping[str, Any]) -> None:
        variables = self.description.variables
        structural = {n: v for n, v in starts.items() if variables[n].causality == "structuralParameter"}
        if structural:
            self.library.call("EnterConfigurationMode", self.handle)
            self.set_starts(structural)
            self.library.call("ExitConfigurationMode", self.handle)
        self.set_starts({n: v for n, v in starts.items() if n not in structural})
        no, zero = ctypes.c_bool(False), ctypes.c_double(0.0)
        self.library.call("EnterInitializationMode", self.handle, no, zero, zero, no, zero)
        self.library.call("ExitInitializationMode", self.handle)
        self._next_event = math.inf
        self._ticks = (0,) * len(self.description.clocks)
        self._discrete = None
        if self._has_events:
            self._update(0.0)

    def _advance(self, t: float, h: float, inputs: Numbers) -> None:
        self._set_inputs(t, inputs)
        at, end = t, t + h
        for _ in range(MOST_EVENTS):
            stop = min(end, self._next_event, self._next_tick())
            needs_event = is_close(stop, at) and stop < end
            if not needs_event:
                stop = end if is_close(stop, end) else stop
                at, needs_event = self._do_step(at, h if at == t and stop == end else stop - at)
            is_due = _is_past(min(self._next_event, self._next_tick()), at)
            if needs_event or (self._has_events and is_due):
                self.library.call("EnterEventMode", self.handle)
                self._update(at)
            if is_close(at, end):
                return
        raise FmuError(f"more than {MOST_EVENTS} events within one step")

    def _do_step(self, at: float, h: float) -> tuple[float, bool]:
        """Where the step came to [s], and whether the FMU asks for an event there."""
        event, ends, early = ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool()
        reached = ctypes.c_double(at + h)
        no_going_back = ctypes.c_bool(not self.description.saves_state)
        found = [ctypes.byref(x) for x in (event, ends, early, reached)]
        self.library.call(
            "DoStep", self.handle, ctypes.c_double(at), ctypes.c_double(h), no_going_back, *found
        )
        to = reached.value if early.value else at + h
        if ends.value:
            raise FmuError(f"it ended the simulation at {to:g} s of its own accord")
        asks = event.value and self._has_events
        if early.value and not to > at and not asks:
            raise FmuError(f"fmi3DoStep returned at once at {at:g} s and asked for no event")
        return to, asks

    def _set_inputs(self, t: float, inputs: Numbers) -> None:
        """Continuous inputs as they are; discrete ones at an event when they changed, if there are events."""
        has_events = self._has_events
        self.set([g for g in self._inputs if not (has_events and g.is_discrete)], inputs)
        discrete = [g for g in self._inputs if has_events and g.is_discrete]
        values = tuple(x for g in discrete for x in inputs[g.start : g.stop])
        if discrete and values != self._discrete:
            self.library.call("EnterEventMode", self.handle)
            self.set(discrete, inputs)
            self._discrete = values
            self._update(t)

    def _update(self, at: float) -> None:
        """In event mode at a time [s]: tick the clocks that are due, settle, back to step mode."""
        due = [k for k in range(len(self._ticks)) if _is_past(self._time_of(k), at)]
        if due:
            refs = (ctypes.c_uint * len(due))(*(self.description.clocks[k].ref for k in due))
            active = (ctypes.c_bool * len(due))(*(True for _ in due))
            self.library.call("SetClock", self.handle, refs, ctypes.c_size_t(len(due)), active)
            self._ticks = tuple(n + (k in due) for k, n in enumerate(self._ticks))
        for _ in range(MOST_EVENTS):
            again, ends, has_next = ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool()
            nominals, values, then = ctypes.c_bool(), ctypes.c_bool(), ctypes.c_double()
            args = (again, ends, nominals, values, has_next, then)
            self.library.call("UpdateDiscreteStates", self.handle, *(ctypes.byref(a) for a in args))
            if ends.value:
                raise FmuError(f"it ended the simulation at {at:g} s of its own accord")
            if not again.value:
                break
        else:
            raise FmuError(f"its discrete states do not settle at {at:g} s")
        self._next_event = then.value if has_next.value else math.inf
        self.library.call("EnterStepMode", self.handle)

    def _next_tick(self) -> float:
        return min((self._time_of(k) for k in range(len(self._ticks))), default=math.inf)

    def _time_of(self, k: int) -> float:
        clock = self.description.clocks[k]
        return clock.shift + self._ticks[k] * clock.interval


def _is_past(when: float, now: float) -> bool:
    return when <= now or is_close(when, now)


CO_SIMULATION = 1
DO_STEP_STATUS, LAST_SUCCESSFUL_TIME, TERMINATED = 0, 2, 3
MOST_RETRIES = 1000


class Instance2(Instance):
    """An FMU of FMI 2 in this process.

    IS_NEW_STEP: last argument of DoStep; SAYS_ENDED: a discarded step can say that the simulation ended
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
