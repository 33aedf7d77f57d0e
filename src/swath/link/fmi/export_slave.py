"""What runs inside an exported FMU: the verbs that pythonfmu3 (FMI 3) and pythonfmu (FMI 2) call.

Their binaries look for a class whose base is called `Fmi3Slave` or `Fmi2Slave` and call its methods by name;
nothing else of these packages is needed where the FMU is loaded, but swath is.
"""

import json
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar
from urllib.parse import urlsplit
from urllib.request import url2pathname

import numpy as np

from swath import __version__
from swath.core.errors import InputError, SwathError
from swath.core.foreign_code import allow_code
from swath.core.packed_state import UnpackableState, pack, unpack
from swath.link.fmi.export_part import Held, Part, Source
from swath.link.fmi.export_variables import Variable

FILE = "swath.json"
OK, WARNING, ERROR = 0, 1, 3  # as FMI numbers them


class Session:
    """One instance of an FMU: its variables by value reference, and the part they belong to.

    The part is made when its first value is asked for, or when the initialisation ends: parameters count
    until then. Each `get` and `set` is one variable: a number, a text, or an array as a flat sequence, rows
    first.
    """

    def __init__(self, resources: Path) -> None:
        manifest = json.loads((resources / FILE).read_text(encoding="utf-8"))
        self._resources, self.token = resources, str(manifest["token"])
        self.slots, self.version = list(manifest["slots"]), str(manifest["swath"])
        self.variables = [Variable.of(entry) for entry in manifest["variables"]]
        self._set_values: dict[str, Any] = {}
        self._inputs: dict[Source, Held] = {}
        given = {tuple(s) for s in manifest["given"]}
        for v in self.variables:
            if v.causality == "input":
                slot, output, name = v.key
                held = self._inputs.setdefault((slot, output), Held({}, (slot, output) in given))
                held.values[name] = _shaped(v, v.start)
        self._part: Part | None = None
        self.is_running = False

    @property
    def part(self) -> Part:
        """The running part. InputError where a parameter or the scenario cannot be used."""
        if self._part is None:
            from swath.runtime.assembly import assemble
            from swath.scenario.scenario import load_scenario

            sets = [f"{key}={json.dumps(value)}" for key, value in self._set_values.items()]
            with allow_code(None):  # whoever exported it had to let it run, and whoever loads this runs it
                scenario = load_scenario(self._resources / "scenario.yaml", sets=sets)
            self._part = Part(assemble(scenario, only=self.slots), self._inputs)
            self._part.reset()
        return self._part

    def start(self) -> None:
        """The end of the initialisation: to t = 0 with the parameters and inputs set so far."""
        self.part.reset()
        self.is_running = True

    def step(self, t: float, h: float) -> None:
        """One communication step [s]."""
        if not self.is_running:
            self.start()
        self.part.step(t, h)

    def get(self, index: int) -> Any:
        """A variable's value now."""
        v = self.variables[index]
        if v.causality == "parameter":
            return self._set_values.get(v.key[0], v.start)
        if v.causality == "independent":
            return 0.0 if self._part is None else self._part.t
        slot, output, name = v.key
        if v.causality == "input":
            value = self._inputs[slot, output].values[name]
        else:
            value = self.part.read(slot, output, name)
            value = _shaped(v, v.start) if value is None else value
        if not v.shape:
            return value
        if np.shape(value) != v.shape:
            raise InputError(v.name, str(np.shape(value)), f"expected an array of {v.shape}")
        return np.asarray(value, dtype=float).ravel()

    def set(self, index: int, value: Any) -> None:
        """A variable's value. InputError for what cannot be set, or not any more."""
        v = self.variables[index]
        if v.causality == "input":
            slot, output, name = v.key
            self._inputs[slot, output].set(name, _shaped(v, value))
            return
        if v.causality != "parameter":
            raise InputError(v.name, value, f"expected an input or a parameter, this is an {v.causality}")
        if self.is_running:
            raise InputError(v.name, value, "expected to be set before the initialisation ends")
        self._set_values[v.key[0]] = value
        self.close()

    def save(self) -> dict[str, Any]:
        """Everything that changes."""
        part = None if self._part is None else self._part.save()
        return {"token": self.token, "sets": dict(self._set_values), "running": self.is_running, "part": part}

    def load(self, state: dict[str, Any]) -> None:
        """Back to a saved moment of an instance of the same FMU."""
        if state.get("token") != self.token:
            raise InputError("FMU state", None, "expected one of this FMU")
        if state["part"] is None or state["sets"] != self._set_values:
            self.close()
        self._set_values, self.is_running = dict(state["sets"]), state["running"]
        if state["part"] is not None:
            self.part.load(state["part"])

    def close(self) -> None:
        """Let go of the part; the next value makes it anew."""
        part, self._part = self._part, None
        if part is not None:
            part.world.close()


class _Slave:
    """Verbs that both versions share. is_split: arrays are one variable per element."""

    log_categories: ClassVar[dict[str, str]] = {
        "logStatusWarning": "warnings",
        "logStatusDiscard": "steps that were refused",
        "logStatusError": "errors",
        "logStatusFatal": "errors that end the instance",
        "logAll": "everything",
    }
    is_split: ClassVar[bool] = False

    def __init__(self, **given: Any) -> None:
        self.instance_name = str(given["instance_name"])
        self._messages: list[Any] = []
        resources = str(given["resources"])
        sys.path[:] = [p for p in sys.path if p != resources]  # the binary puts it first
        if resources.startswith("file:"):
            resources = url2pathname(urlsplit(resources).path)
        self.session = Session(Path(resources))
        self._refs = list(references(self.session.variables, split=self.is_split))
        if self.session.version != __version__:
            text = f"made by swath {self.session.version}, running in swath {__version__}: results may differ"
            self._say("Warning", text)

    def setup_experiment(self, *times: Any) -> None:
        """Times are taken from the first communication step."""

    def enter_initialization_mode(self) -> None:
        """Nothing yet: parameters and inputs may still come."""

    def exit_initialization_mode(self) -> None:
        """Now everything that was set counts."""
        self.session.start()

    def terminate(self) -> None:
        """Nothing: values can still be read. What the part holds is let go with the instance."""

    def __del__(self) -> None:
        with suppress(Exception):  # also where the constructor failed, or Python is ending
            self.session.close()

    def _step(self, t: float, h: float) -> bool:
        """One communication step; what goes wrong is a line in the log and False."""
        try:
            self.session.step(t, h)
        except Exception as error:
            self._say("Error", _text(error))
            return False
        return True

    def _get(self, refs: Sequence[int]) -> list[Any]:
        found: list[Any] = []
        for ref in refs:
            index, element = self._refs[ref]
            value = self.session.get(index)
            if element is not None:
                found.append(float(value[element]))
            elif isinstance(value, np.ndarray):
                found += value.tolist()
            else:
                found.append(value)
        return found

    def _set(self, refs: Sequence[int], values: Sequence[Any]) -> None:
        at = 0
        for ref in refs:
            index, element = self._refs[ref]
            variable = self.session.variables[index]
            size = variable.size if element is None else 1
            value = values[at : at + size] if variable.shape else values[at]
            if element is not None:
                whole = np.array(self.session.get(index), dtype=float)
                whole[element] = values[at]
                value = whole
            self.session.set(index, value)
            at += size

    def _get_fmu_state(self) -> dict[str, Any]:
        return self.session.save()

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        self.session.load(state)

    @staticmethod
    def _fmu_state_to_bytes(state: dict[str, Any]) -> bytes:
        return pack(state)

    @staticmethod
    def _fmu_state_from_bytes(data: bytes) -> dict[str, Any]:
        try:
            state = unpack(data)
        except UnpackableState:  # would crash an importer of FMI 2; loading {} is refused
            return {}
        return state if isinstance(state, dict) else {}

    def _get_log_queue(self) -> list[Any]:
        return self._messages

    def _say(self, word: str, text: str) -> None:
        """A line for the importer's log, with the names that the binaries read. word: Warning or Error."""
        status = WARNING if word == "Warning" else ERROR
        line = " ".join(text.split())
        self._messages.append(
            SimpleNamespace(status=status, category=f"logStatus{word}", msg=line, debug=False)
        )


class Fmi3Slave(_Slave):
    """FMI 3 as pythonfmu3 calls it."""

    def do_step(self, t: float, h: float) -> Any:
        """One communication step; the result has the names of pythonfmu3."""
        return SimpleNamespace(status=OK if self._step(t, h) else ERROR, terminateSimulation=False)

    get_float64 = get_int32 = get_int64 = get_boolean = get_string = _Slave._get
    set_float64 = set_int32 = set_int64 = set_boolean = set_string = _Slave._set


class Fmi2Slave(_Slave):
    """FMI 2 as pythonfmu calls it: arrays are one variable per element.

    An exception would end in its binary as a crash of the importer. So what goes wrong is a line in the log,
    and from then on every step is refused with that line.
    """

    is_split = True

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self._failure = ""

    def exit_initialization_mode(self) -> None:
        """Now everything that was set counts."""
        self._try(super().exit_initialization_mode)

    def do_step(self, t: float, h: float) -> bool:
        """One communication step; False (discard) when it failed."""
        if self._failure:
            self._say("Error", self._failure)
            return False
        return self._step(t, h)

    def _get(self, refs: Sequence[int]) -> list[Any]:
        found = self._try(lambda: _Slave._get(self, refs))
        return [self._start(ref) for ref in refs] if found is None else found

    def _set(self, refs: Sequence[int], values: Sequence[Any]) -> None:
        self._try(lambda: _Slave._set(self, refs, values))

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        self._try(lambda: self.session.load(state))

    def _try(self, work: Callable[[], Any]) -> Any:
        if self._failure:
            return None
        try:
            return work()
        except Exception as error:
            self._failure = _text(error)
            self._say("Error", self._failure)
            return None

    def _start(self, ref: int) -> Any:
        index, element = self._refs[ref]
        start = self.session.variables[index].start
        return start if element is None else start[element]

    get_real = get_integer = get_boolean = get_string = _get
    set_real = set_integer = set_boolean = set_string = _set


def references(variables: Sequence[Variable], *, split: bool) -> list[tuple[int, int | None]]:
    """(variable, element) of every value reference. split: one for each element of an array."""
    found: list[tuple[int, int | None]] = []
    for index, v in enumerate(variables):
        found += [(index, k) for k in range(v.size)] if split and v.shape else [(index, None)]
    return found


def _text(error: Exception) -> str:
    return str(error) if isinstance(error, SwathError) else f"{type(error).__name__}: {error}"


def _shaped(v: Variable, value: Any) -> Any:
    return np.array(value, dtype=float).reshape(v.shape) if v.shape else value
