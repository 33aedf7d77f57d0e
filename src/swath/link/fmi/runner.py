"""Where an FMU runs: in this process, or in one of its own; it is made when it is first started."""

from collections.abc import Mapping, Sequence
from typing import Any

from swath.link.fmi.child_process import ChildProcess
from swath.link.fmi.description import Description, Variable, need_library
from swath.link.fmi.errors import FmuError
from swath.link.fmi.instance import Instance, Steps
from swath.link.fmi.open_unit import make_instance

_LIVE: dict[str, int] = {}  # instances in this process of FMUs that allow only one, by their token


class Runner:
    """One FMU. own: in a process of its own, whose answers may take timeout_s.

    Scenarios are read and checked without running foreign code; InputError where it has no binary for this
    system. An FMU that allows one instance per process gets its own process when there is one already.
    """

    def __init__(
        self,
        fmu: Description,
        name: str,
        inputs: Sequence[Variable],
        outputs: Sequence[Variable],
        *,
        own: bool = False,
        timeout_s: float = 10.0,
    ) -> None:
        need_library(fmu)
        self.notes: list[str] = []
        self._fmu, self._name = fmu, name
        self._variables = (tuple(inputs), tuple(outputs))
        self._own, self._timeout_s = own, timeout_s
        self._unit: Instance | ChildProcess | None = None
        self._counts = False

    def start(self, starts: Mapping[str, Any]) -> list[float]:
        """Outputs at t = 0."""
        if self._unit is None:
            self._unit = self._make()
        return self._unit.start(starts)

    def run(self, steps: Steps) -> list[float]:
        """One step after the other; the outputs after the last."""
        return self._started().run(steps)

    def save(self) -> Any:
        """The state."""
        return self._started().save()

    def load(self, state: Any) -> None:
        """Back to it."""
        self._started().load(state)

    def close(self) -> None:
        """Let go of it; a later start makes it anew."""
        unit, self._unit = self._unit, None
        if unit is not None:
            unit.close()
        if self._counts:
            self._counts = False
            _LIVE[self._fmu.token] -= 1

    def _make(self) -> Instance | ChildProcess:
        fmu, own = self._fmu, self._own
        if fmu.one_per_process and not own:
            own = _LIVE.get(fmu.token, 0) > 0
            if own:
                self.notes.append("it allows one instance per process; this one runs in its own process")
            else:
                self._counts = True
                _LIVE[fmu.token] = _LIVE.get(fmu.token, 0) + 1
        if own:
            return ChildProcess(fmu, self._name, *self._variables, self._timeout_s)
        return make_instance(fmu, self._name, *self._variables)

    def _started(self) -> Instance | ChildProcess:
        if self._unit is None:
            raise FmuError("it was not started")
        return self._unit
