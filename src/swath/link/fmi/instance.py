"""A running FMU: started, stepped, saved, closed. What FMI 2 and 3 have in common.

Numbers go in and come out as flat lists, in the order of the variables given, arrays element by element.
"""

import ctypes
import math
import shutil
import tempfile
import weakref
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from swath.link.fmi.calls import Group, Library, fill, make_groups
from swath.link.fmi.description import Description, Variable
from swath.link.fmi.errors import FmuError

Numbers = Sequence[float]
Steps = Sequence[tuple[float, float, Numbers]]  # t, length [s], inputs


def unpack(file: Path) -> Path:
    """The archive in a new folder of its own, which the caller removes."""
    folder = Path(tempfile.mkdtemp(prefix="swath-fmu-"))
    try:
        with zipfile.ZipFile(file) as archive:
            archive.extractall(folder)
        (folder / "resources").mkdir(exist_ok=True)
    except (OSError, zipfile.BadZipFile) as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise FmuError(f"{file.name} cannot be unpacked: {error}") from error
    return folder


class Instance(ABC):
    """One FMU in this process."""

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
        self.folder = folder or unpack(description.file)
        self._clean = weakref.finalize(self, shutil.rmtree, self.folder, True) if folder is None else None
        self.library = Library(description, self.folder, name)
        self._is_open = True
        self.handle: Any = None
        self.is_running = False
        self._kept: list[Any] = []

    # the verbs

    def start(self, starts: Mapping[str, Any]) -> list[float]:
        """A fresh instance, start values set by name, initialised; outputs at t = 0."""
        if self.library.is_dead:
            raise FmuError("it said fatal before, nothing more can be done with it")
        if self.handle is not None:
            self._again()
        self.handle = ctypes.c_void_p(self._instantiate())
        if not self.handle.value:
            self.handle = None
            said = f"; it says: {self.library.said}" if self.library.messages else ""
            raise FmuError(f"it could not be instantiated{said}")
        self._initialise(starts)
        self.is_running = True
        return self.outputs()

    def step(self, t: float, h: float, inputs: Numbers) -> list[float]:
        """Set the inputs, go from t to t + h [s], get the outputs."""
        return self.run([(t, h, inputs)])

    def run(self, steps: Steps) -> list[float]:
        """One step after the other; the outputs after the last."""
        try:
            for t, h, inputs in steps:
                self._advance(t, h, inputs)
        except FmuError:
            self.is_running = False
            raise
        return self.outputs()

    def save(self) -> Any:
        """The state: bytes where the FMU can serialise it, otherwise a mark of this instance."""
        if not self.description.saves_state:
            raise FmuError("it cannot save its state (canGetAndSetFMUState is false)")
        state = ctypes.c_void_p()
        self.library.call(self._state_name("Get"), self.handle, ctypes.byref(state))
        extra = self._extra()
        if not self.description.serializes:
            self._kept.append(state)
            return {"kept": len(self._kept) - 1, "extra": extra}
        size = ctypes.c_size_t()
        self.library.call(f"Serialized{self._state()}Size", self.handle, state, ctypes.byref(size))
        buffer = ctypes.create_string_buffer(size.value)
        self.library.call(f"Serialize{self._state()}", self.handle, state, buffer, size)
        self.library.call(self._state_name("Free"), self.handle, ctypes.byref(state))
        return {"bytes": buffer.raw, "extra": extra}

    def load(self, state: Any) -> None:
        """Back to a saved state."""
        if "kept" in state:
            if state["kept"] >= len(self._kept):
                raise FmuError("its state was saved by another instance (canSerializeFMUState is false)")
            self.library.call(self._state_name("Set"), self.handle, self._kept[state["kept"]])
        else:
            made, data = ctypes.c_void_p(), state["bytes"]
            buffer = ctypes.create_string_buffer(data, len(data))
            name = "DeSerializeFMUstate" if self.description.major == 2 else "DeserializeFMUState"
            self.library.call(name, self.handle, buffer, ctypes.c_size_t(len(data)), ctypes.byref(made))
            self.library.call(self._state_name("Set"), self.handle, made)
            self.library.call(self._state_name("Free"), self.handle, ctypes.byref(made))
        self._set_extra(state["extra"])

    def close(self) -> None:
        """Terminate, free, unload, remove the unpacked files. Calling it again does nothing."""
        if not self._is_open:
            return
        self._is_open = False
        if self.handle is not None and not self.library.is_dead:
            self._free_states()
            if self.is_running:
                self.library.function("Terminate")(self.handle)
            self.library.function("FreeInstance")(self.handle)
            self.library.unload()
        self.handle = None
        if self._clean is not None:
            self._clean()

    # for the versions

    @abstractmethod
    def _instantiate(self) -> int | None: ...
    @abstractmethod
    def _initialise(self, starts: Mapping[str, Any]) -> None: ...
    @abstractmethod
    def _advance(self, t: float, h: float, inputs: Numbers) -> None: ...

    def _extra(self) -> Any:
        """What the importer itself must remember of a moment."""
        return None

    def _set_extra(self, extra: Any) -> None:
        """Back to it."""
        assert extra is None

    def outputs(self) -> list[float]:
        """All outputs now."""
        found: list[float] = []
        for group in self._outputs:
            self.get(group)
            found += group.values[:]
        return found

    def set(self, group: Group) -> None:
        """Hand the group's array to the FMU."""
        self.library.call("Set" + group.name, self.handle, group.refs, group.ref_count, *self._array(group))

    def get(self, group: Group) -> None:
        """Fill the group's array from the FMU."""
        self.library.call("Get" + group.name, self.handle, group.refs, group.ref_count, *self._array(group))

    def _array(self, group: Group) -> tuple[Any, ...]:
        return (group.values,) if self.description.major == 2 else (group.values, group.value_count)

    def set_starts(self, starts: Mapping[str, Any], *causalities: str) -> None:
        """Set start values by name; only variables of these causalities, of all when none is given."""
        for name, value in starts.items():
            variable = self.description.variables[name]
            if causalities and variable.causality not in causalities:
                continue
            if variable.kind == "string":
                self._set_string(variable, str(value))
                continue
            (group,) = make_groups([variable], self.description.major)
            numbers = [float(x) for x in value] if isinstance(value, list) else [float(value)]
            if len(numbers) == 1:
                numbers *= variable.size
            fill(group, numbers)
            self.set(group)

    def _set_string(self, variable: Variable, text: str) -> None:
        values = (ctypes.c_char_p * 1)(text.encode("utf-8"))
        one = ctypes.c_size_t(1)
        count = () if self.description.major == 2 else (one,)
        refs = (ctypes.c_uint * 1)(variable.refs[0])
        self.library.call("SetString", self.handle, refs, one, values, *count)

    def _again(self) -> None:
        """Let go of the instance for another start: a fresh one is surer than a reset by the exporter."""
        self._free_states()
        if self.is_running:
            self.library.function("Terminate")(self.handle)
        self.library.function("FreeInstance")(self.handle)
        self.handle, self.is_running = None, False

    def _free_states(self) -> None:
        for state in self._kept:
            self.library.function(self._state_name("Free"))(self.handle, ctypes.byref(state))
        self._kept.clear()

    def _state(self) -> str:
        return "FMUstate" if self.description.major == 2 else "FMUState"

    def _state_name(self, verb: str) -> str:
        return verb + self._state()


def is_close(a: float, b: float) -> bool:
    """True when two times [s] are the same but for rounding."""
    return math.isclose(a, b, rel_tol=1e-12, abs_tol=1e-9)
