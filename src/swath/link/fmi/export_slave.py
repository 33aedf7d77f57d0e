"""What runs inside an exported FMU: the verbs that pythonfmu3 (FMI 3) and pythonfmu (FMI 2) call.

Their binaries look for a class whose base is called `Fmi3Slave` or `Fmi2Slave` and call its methods by name;
nothing else of these packages is needed where the FMU is loaded, but swath is.
"""

import json
import pickle
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, ClassVar
from urllib.parse import urlsplit
from urllib.request import url2pathname

import numpy as np

from swath import __version__
from swath.core.errors import InputError
from swath.link.fmi.export_part import Held, Part, Source
from swath.link.fmi.export_variables import Variable

FILE = "swath.json"


class Status(IntEnum):
    """As FMI numbers them."""

    OK = 0
    WARNING = 1
    DISCARD = 2
    ERROR = 3


@dataclass(frozen=True)
class Message:
    """One line for the importer's log."""

    status: int
    category: str
    msg: str
    debug: bool = False


@dataclass(frozen=True)
class StepResult:
    """How a communication step ended; the names are pythonfmu3's."""

    status: int = Status.OK
    terminateSimulation: bool = False  # noqa: N815


class Session:
    """One instance of an FMU: its variables by value reference, and the part they belong to.

    The part is made when its first value is asked for, or when the initialisation ends: parameters count
    until then. Each `get` and `set` is one variable: a number, a text, or an array as a flat sequence, rows
    first.
    """

    def __init__(self, resources: Path) -> None:
        manifest = json.loads((resources / FILE).read_text(encoding="utf-8"))
        self._resources, self.token = resources, str(manifest["token"])
        self.slots = [str(s) for s in manifest["slots"]]
        self.version = str(manifest["swath"])
        self.variables = [_variable(v) for v in manifest["variables"]]
        self._set_values: dict[str, Any] = {}
        self._inputs: dict[Source, Held] = {}
        given = {tuple(s) for s in manifest["given"]}
        for v in self.variables:
            if v.causality == "input":
                slot, output, name = v.key
                held = self._inputs.setdefault((slot, output), Held({}, is_given=(slot, output) in given))
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
        if v.causality == "output":
            value = self.part.read(*v.key)
            if value is None:
                value = _shaped(v, v.start)
            return value if not v.shape else self._flat(v, value)
        if v.causality == "input":
            slot, output, name = v.key
            value = self._inputs[slot, output].values[name]
            return value if not v.shape else np.ravel(value)
        if v.causality == "parameter":
            return self._set_values.get(v.key[0], v.start)
        return 0.0 if self._part is None else self._part.t

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
        if self._part is not None:
            self._part.world.close()
            self._part = None

    def save(self) -> dict[str, Any]:
        """Everything that changes."""
        part = None if self._part is None else self._part.save()
        return {"token": self.token, "sets": dict(self._set_values), "running": self.is_running, "part": part}

    def load(self, state: dict[str, Any]) -> None:
        """Back to a saved moment of an instance of the same FMU."""
        if state.get("token") != self.token:
            raise InputError("FMU state", None, "expected one of this FMU")
        if state["sets"] != self._set_values:
            self.close()
            self._set_values = dict(state["sets"])
        self.is_running = state["running"]
        if state["part"] is None:
            self.close()
        else:
            self.part.load(state["part"])

    def close(self) -> None:
        """Let go of the part."""
        if self._part is not None:
            self._part.world.close()
            self._part = None

    def _flat(self, v: Variable, value: Any) -> Any:
        array = np.asarray(value, dtype=float)
        if array.shape != v.shape:
            raise InputError(v.name, str(array.shape), f"expected an array of {v.shape}")
        return array.ravel()


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
        self._messages: list[Message] = []
        sys.path[:] = [p for p in sys.path if p != given["resources"]]  # the binary puts it first
        self.session = Session(_folder(str(given["resources"])))
        self._refs = list(references(self.session.variables, split=self.is_split))
        if self.session.version != __version__:
            text = f"made by swath {self.session.version}, running in swath {__version__}: results may differ"
            self._say(Status.WARNING, text)

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
            size = self.session.variables[index].size
            if element is not None:
                whole = np.array(self.session.get(index), dtype=float)
                whole[element] = values[at]
                self.session.set(index, whole)
                at += 1
            elif self.session.variables[index].shape:
                self.session.set(index, values[at : at + size])
                at += size
            else:
                self.session.set(index, values[at])
                at += 1

    def _get_fmu_state(self) -> dict[str, Any]:
        return self.session.save()

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        self.session.load(state)

    @staticmethod
    def _fmu_state_to_bytes(state: dict[str, Any]) -> bytes:
        return pickle.dumps(state, protocol=5)

    @staticmethod
    def _fmu_state_from_bytes(data: bytes) -> dict[str, Any]:
        state: dict[str, Any] = pickle.loads(data)
        return state

    def _get_log_queue(self) -> list[Message]:
        return self._messages

    def _say(self, status: Status, text: str) -> None:
        category = f"logStatus{status.name.capitalize()}"
        self._messages.append(Message(int(status), category, " ".join(text.split())))


class Fmi3Slave(_Slave):
    """FMI 3 as pythonfmu3 calls it."""

    def do_step(self, t: float, h: float) -> StepResult:
        """One communication step. What goes wrong is a line in the log and the status error."""
        try:
            self.session.step(t, h)
        except Exception as error:
            self._say(Status.ERROR, _text(error))
            return StepResult(Status.ERROR)
        return StepResult()

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
            self._say(Status.ERROR, self._failure)
            return False
        try:
            self.session.step(t, h)
        except Exception as error:
            self._say(Status.ERROR, _text(error))
            return False
        return True

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
            self._say(Status.ERROR, self._failure)
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
        if split and v.shape:
            found += [(index, k) for k in range(v.size)]
        else:
            found.append((index, None))
    return found


def _text(error: Exception) -> str:
    from swath.core.errors import SwathError

    return str(error) if isinstance(error, SwathError) else f"{type(error).__name__}: {error}"


def _folder(resources: str) -> Path:
    if resources.startswith("file:"):
        return Path(url2pathname(urlsplit(resources).path))
    return Path(resources)


def _variable(entry: dict[str, Any]) -> Variable:
    return Variable(**{**entry, "shape": tuple(entry["shape"]), "key": tuple(entry["key"])})


def _shaped(v: Variable, value: Any) -> Any:
    return np.array(value, dtype=float).reshape(v.shape) if v.shape else value
