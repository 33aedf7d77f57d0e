"""A running FMU: started, stepped, saved, closed. What the versions of FMI have in common.

Numbers go in and come out as flat lists, in the order of the variables given, arrays element by element.
"""

import ctypes
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from swath.core.errors import reason_of
from swath.core.files.temporary import TemporaryFolder
from swath.core.process.stopping import unstopped
from swath.link.fmi.calls import FmuError, Group, Library, log_categories, make_groups
from swath.link.fmi.description import Description, Variable, unpack_archive

Numbers = Sequence[float]
Steps = Sequence[tuple[float, float, Numbers]]  # t, length [s], inputs


def unpack(file: Path) -> TemporaryFolder:
    """The archive in a new folder of its own."""
    try:
        made = unpack_archive(file, "fmu")
        (made.path / "resources").mkdir(exist_ok=True)
    except (OSError, ValueError) as error:
        raise FmuError(f"{file.name} cannot be unpacked: {reason_of(error)}") from error
    return made


class Instance(ABC):
    """One FMU in this process, loaded when it is first started. Ctrl-C waits until a call has come back.

    folder: where the caller unpacked it and removes it; None = the instance does both
    remembered: attributes that belong to the state beside the FMU's own
    END, FREE: functions that end and free an instance
    """

    notes: Sequence[str] = ()
    remembered: ClassVar[tuple[str, ...]] = ()
    END: ClassVar[str] = "Terminate"
    FREE: ClassVar[str] = "FreeInstance"

    def __init__(
        self,
        description: Description,
        name: str,
        inputs: Sequence[Variable],
        outputs: Sequence[Variable],
        folder: Path | None = None,
    ) -> None:
        self.description, self.name = description, name
        self._inputs = make_groups(inputs, description.major)
        self._outputs = make_groups(outputs, description.major)
        self._given_folder = folder
        self._unpacked: TemporaryFolder | None = None
        self._library: Library | None = None
        self.is_closed = False
        self.handle: Any = None
        self.is_running = False
        self._kept: list[Any] = []

    @property
    def library(self) -> Library:
        """The loaded binary. FmuError before the start and after the end."""
        if self._library is None:
            raise FmuError("it was not started")
        return self._library

    # the verbs

    @unstopped()
    def start(self, starts: Mapping[str, Any]) -> list[float]:
        """A fresh instance, start values set by name, initialised; outputs at t = 0.

        FmuError where the binary cannot be loaded.
        """
        if self._library is None:
            self._load()
        if self.library.is_dead:
            raise FmuError("it said fatal before, nothing more can be done with it")
        self._free()  # a fresh instance is surer than a reset by the exporter
        self.handle = ctypes.c_void_p(self._instantiate())
        if not self.handle.value:
            self.handle = None
            raise FmuError(f"it could not be instantiated{self.library.said}")
        if categories := log_categories(self.description):
            on = 1 if self.description.major == 2 else ctypes.c_bool(True)
            self.library.function("SetDebugLogging")(self.handle, on, *categories)
        self._initialise(starts)
        self.is_running = True
        return self.outputs()

    def step(self, t: float, h: float, inputs: Numbers) -> list[float]:
        """Set the inputs, go from t to t + h [s], get the outputs."""
        return self.run([(t, h, inputs)])

    @unstopped()
    def run(self, steps: Steps) -> list[float]:
        """One step after the other; the outputs after the last."""
        try:
            for t, h, inputs in steps:
                self._advance(t, h, inputs)
        except FmuError:
            self.is_running = False
            raise
        return self.outputs()

    @unstopped()
    def save(self) -> Any:
        """The state: bytes where the FMU can serialise it, otherwise a mark of this instance."""
        if not self.description.saves_state:
            raise FmuError("it cannot save its state (canGetAndSetFMUState is false)")
        state = ctypes.c_void_p()
        self._state_call("Get{}", ctypes.byref(state))
        extra = {name: vars(self)[name] for name in self.remembered}
        if not self.description.serializes:
            self._kept.append(state)
            return {"kept": len(self._kept) - 1, "extra": extra}
        size = ctypes.c_size_t()
        self._state_call("Serialized{}Size", state, ctypes.byref(size))
        buffer = ctypes.create_string_buffer(size.value)
        self._state_call("Serialize{}", state, buffer, size)
        self._state_call("Free{}", ctypes.byref(state))
        return {"bytes": buffer.raw, "extra": extra}

    @unstopped()
    def load(self, state: Any) -> None:
        """Take on a saved state."""
        if "kept" in state:
            if state["kept"] >= len(self._kept):
                raise FmuError("its state was saved by another instance (canSerializeFMUState is false)")
            self._state_call("Set{}", self._kept[state["kept"]])
        else:
            made, data = ctypes.c_void_p(), state["bytes"]
            buffer = ctypes.create_string_buffer(data, len(data))
            verb = "DeSerialize{}" if self.description.major == 2 else "Deserialize{}"
            self._state_call(verb, buffer, ctypes.c_size_t(len(data)), ctypes.byref(made))
            self._state_call("Set{}", made)
            self._state_call("Free{}", ctypes.byref(made))
        vars(self).update(state["extra"])

    @unstopped()
    def close(self) -> None:
        """Terminate, free, unload, remove the unpacked files; a later start loads it anew."""
        if self._library is not None and not self._library.is_dead:
            self._free()
            self._library.unload()
        self._library = self.handle = None
        self.is_closed = True
        if self._unpacked is not None:
            self._unpacked.remove()

    # for the versions

    @abstractmethod
    def _instantiate(self) -> int | None: ...
    @abstractmethod
    def _initialise(self, starts: Mapping[str, Any]) -> None: ...
    @abstractmethod
    def _advance(self, t: float, h: float, inputs: Numbers) -> None: ...

    def all_notes(self) -> list[str]:
        """The notes."""
        return [*self.notes]

    def outputs(self) -> list[float]:
        """Values of all outputs now."""
        found: list[float] = []
        for group in self._outputs:
            self.library.call("Get" + group.name, self.handle, *group.args)
            found += group.values[:]
        return found

    def set(self, groups: Sequence[Group], numbers: Numbers) -> None:
        """Hand the numbers of these groups, out of the flat list, to the FMU."""
        for group in groups:
            group.fill(numbers)
            self.library.call("Set" + group.name, self.handle, *group.args)

    def set_starts(self, starts: Mapping[str, Any]) -> None:
        """Set start values by name."""
        for name, value in starts.items():
            variable = self.description.variables[name]
            if variable.kind != "string":
                self.set(make_groups([variable], self.description.major), variable.numbers(value))
                continue
            one, values = ctypes.c_size_t(1), (ctypes.c_char_p * 1)(str(value).encode("utf-8"))
            args = ((ctypes.c_uint * 1)(variable.refs[0]), one, values)
            self.library.call(
                "SetString", self.handle, *args, *((one,) if self.description.major == 3 else ())
            )

    def _load(self) -> None:
        self.is_closed = False
        folder = self._given_folder
        if folder is None:
            self._unpacked = unpack(self.description.file)
            folder = self._unpacked.path
        self.folder = folder
        self._library = Library(self.description, folder, self.name)

    def _free(self) -> None:
        """Let go of the instance and of the states kept in it."""
        if self.handle is None:
            return
        for state in self._kept:
            self.library.function(self._state_name("Free{}"))(self.handle, ctypes.byref(state))
        self._kept.clear()
        if self.is_running:
            self.library.function(self.END)(self.handle)
        self.library.function(self.FREE)(self.handle)
        self.handle, self.is_running = None, False

    def _state_call(self, name: str, *args: Any) -> None:
        self.library.call(self._state_name(name), self.handle, *args)

    def _state_name(self, name: str) -> str:
        """FMI 2 writes FMUstate, FMI 3 FMUState."""
        return name.format("FMUstate" if self.description.major == 2 else "FMUState")


def is_close(a: float, b: float) -> bool:
    """True when two times [s] are the same but for rounding."""
    return math.isclose(a, b, rel_tol=1e-12, abs_tol=1e-9)
