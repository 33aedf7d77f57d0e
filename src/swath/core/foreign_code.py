"""The one gate for what files of others may do: run code, and reach beyond this machine or to its devices.

Nothing of somebody else's code is loaded but through here, and only what may run.

Code is a Python file (a level, an evaluator, a law, a habit of a crop), an FMU, a system of FMUs, or a
network (ONNX), which a library in C++ carries out: it has the rights of the user, and a Python file runs
already when it is read. None may run but what was allowed: all
by `--allow-code` (`code=True` in Python), or single files by being named on the command line itself. Packages
that are installed are loaded where a scenario names their level.

Addresses of this machine alone and virtual buses are free. Any other address, bus or terminal is opened only
where the user has named it, in the same words: on the command line, or in Python as `addresses`.
"""

import builtins
import os
import sys
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from shlex import quote
from types import ModuleType
from typing import Any, Protocol, runtime_checkable

from swath.core.ability import ByMembers
from swath.core.errors import MIGRATED_BY, InputError, SwathError, reason_of

SUFFIXES = (".py", ".fmu", ".ssp", ".ssd", ".onnx")
USER_MODULE = "swath_user_"  # how the names of modules begin that were read from a user's file


@dataclass(frozen=True)
class Gate:
    """files: that may run, None = any; leaves: others are left unread where a scenario is only looked at.

    is_narrow: only a part of what may run from outside does, as while a run is changed
    addresses: that may be opened
    copies: of Python files as they were, that are read in their place
    """

    files: frozenset[Path] | None = frozenset()
    addresses: frozenset[str] = frozenset()
    leaves: bool = False
    is_narrow: bool = False
    copies: Mapping[Path, Path] = field(default_factory=dict, hash=False)


_gate: ContextVar[Gate] = ContextVar("gate", default=Gate())  # noqa: B039 - it is frozen


@runtime_checkable
class NamesCode(Protocol, metaclass=ByMembers):
    """Parameters that name code. foreign_code: files or `file.py:Class`, from the scenario's folder."""

    @property
    def foreign_code(self) -> Sequence[str]:
        """Files, or `file.py:Class`."""


def present_gate() -> Gate:
    """The gate as it stands: for another process, or for later."""
    return _gate.get()


@contextmanager
def through(gate: Gate) -> Iterator[None]:
    """Inside the block this gate stands."""
    token = _gate.set(gate)
    try:
        yield
    finally:
        _gate.reset(token)


def allow_code(references: Iterable[str | Path] | None, addresses: Iterable[str] = ()) -> Any:
    """A block in which these files, or `file.py:Class`, may run beside what may outside it; None: any.

    addresses: that may be opened, too
    """
    outer = _gate.get()
    files = None if references is None or outer.files is None else outer.files.union(map(file_of, references))
    return through(replace(outer, files=files, addresses=outer.addresses.union(addresses)))


def only_code(references: Iterable[str | Path]) -> Any:
    """A block in which only these files, or `file.py:Class`, may run, and only if they may outside it."""
    files, outer = frozenset(map(file_of, references)), _gate.get()
    files = files if outer.files is None else files & outer.files
    return through(replace(outer, files=files, leaves=False, is_narrow=True))


def code_unread() -> Any:
    """A block in which scenarios are read to be looked at: code that may not run is left out, not refused."""
    return through(replace(_gate.get(), leaves=True))


def source_of(file: Path) -> Path:
    """The copy that is read in the place of a Python file, or the file itself."""
    copies = _gate.get().copies
    return copies.get(file.resolve(), file) if copies else file


def is_allowed(reference: str | Path, base: Path | None = None) -> bool:
    """Whether a file, or `file.py:Class`, relative to `base`, may run."""
    allowed = _gate.get().files
    return allowed is None or file_of(reference, base) in allowed


def is_left(reference: str | Path, base: Path | None = None) -> bool:
    """Whether it is to be left unread."""
    return _gate.get().leaves and not is_allowed(reference, base)


def need_allowed(key: str, reference: str | Path, base: Path | None = None) -> None:
    """InputError, with the key, where a file, or `file.py:Class`, may not run."""
    if not is_allowed(reference, base):
        raise InputError(key, str(reference), refusal())


def refusal() -> str:
    """What was expected where code is refused."""
    if _gate.get().is_narrow:
        return "names code, which runs with your rights: here only what the scenario or --allow names may"
    return "names code, which runs with your rights: allow it with --allow-code (in Python code=True)"


class NotNamed(InputError):
    """An address, a bus or a terminal that the user has not named."""


def need_named(key: str, text: str, *others: str) -> None:
    """NotNamed, with the key, where an address is not named. others: texts that together stand for it."""
    addresses = _gate.get().addresses
    if text not in addresses and not (others and addresses.issuperset(others)):
        how = f"--allow-address {quote(text)} (in Python addresses=[...])"
        raise NotNamed(key, None, f"leads out of this program, allow it with {how}")


def texts_in(data: Any) -> Iterator[str]:
    """The texts in plain data."""
    if isinstance(data, str):
        yield data
    elif isinstance(data, dict | list | tuple):
        for value in data.values() if isinstance(data, dict) else data:
            yield from texts_in(value)


def code_in(data: Any) -> Iterator[str]:
    """The texts in plain data that name code."""
    return (text for text in texts_in(data) if ".py:" in text or text.lower().endswith(SUFFIXES))


def file_of(reference: str | Path, base: Path | None = None) -> Path:
    """The file that a reference names, absolute. InputError where it can name none."""
    text = str(reference)
    file = text.rpartition(":")[0] if ".py:" in text else text
    try:
        return ((base or Path.cwd()) / file).resolve()
    except (OSError, ValueError, RuntimeError) as error:
        raise InputError("code", text, f"expected a file or file.py:Class: {reason_of(error)}") from error


def of_exit(error: SystemExit) -> RuntimeError:
    """What is raised where code of others calls `sys.exit`: the end of a run is not its own to decide."""
    return RuntimeError(f"called sys.exit({error})").with_traceback(error.__traceback__)


class _Space:
    """What a user's files of a folder import from there.

    These are modules under a name of their own: those of another folder, or of copies, are others.
    name: of the package that they lie in
    """

    def __init__(self, folder: Path, copies: Mapping[Path, Path]) -> None:
        self.folder = folder
        self.copies = {file: copy for file, copy in copies.items() if file.is_relative_to(folder)}
        about = f"{folder} {sorted(map(str, self.copies.values()))}"
        self.name = f"{USER_MODULE}{zlib.crc32(about.encode()):08x}"
        self._read: dict[Path, object] = {}

    def source(self, file: Path) -> str:
        """What is read for a file: itself as it is now, or its copy."""
        self._read[file] = self._version(file)
        return str(self.copies.get(file, file))

    def renew(self) -> None:
        """Forget what was imported where a file of it was edited."""
        if any(self._version(file) != version for file, version in self._read.items()):
            self._read = {}
            for name in [name for name in sys.modules if name.startswith(f"{self.name}.")]:
                del sys.modules[name]

    def _version(self, file: Path) -> object:
        with suppress(OSError):
            about = os.stat(self.copies.get(file, file))
            return about.st_mtime_ns, about.st_size
        return None

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """A module of it; None for any other."""
        space, _, inner = name.partition(".")
        if space != self.name:
            return None
        at = self.folder.joinpath(*inner.split(".")) if inner else self.folder
        for file in (at / "__init__.py", at.with_name(f"{at.name}.py")) if inner else ():
            if file in self.copies if self.copies else os.path.isfile(file):
                return spec_from_file_location(name, file, loader=_Source(name, file, self))
        if not (any(file.is_relative_to(at) for file in self.copies) if self.copies else os.path.isdir(at)):
            return None
        spec = ModuleSpec(name, None, is_package=True)
        spec.submodule_search_locations = [str(at)]
        return spec

    def import_(self, name: str, of: Any = None, local: Any = None, names: Any = (), level: int = 0) -> Any:
        """What `import` does in these files."""
        top = name.partition(".")[0]
        if level or top in sys.stdlib_module_names or self.find_spec(f"{self.name}.{top}") is None:
            return builtins.__import__(name, of, local, names, level)
        found = builtins.__import__(f"{self.name}.{name}", of, local, names or (), 0)
        return found if names else sys.modules[f"{self.name}.{top}"]


_spaces: dict[str, _Space] = {}


class _Source(SourceFileLoader):
    """Runs what stands in the file, not compiled code that lies beside it."""

    def __init__(self, name: str, file: Path, space: _Space) -> None:
        super().__init__(name, str(file))
        self._space = space

    def get_code(self, fullname: str) -> Any:
        return self.source_to_code(self.get_data(self._space.source(Path(self.path))), self.path)

    def exec_module(self, module: ModuleType) -> None:
        vars(module)["__builtins__"] = {**vars(builtins), "__import__": self._space.import_}
        super().exec_module(module)


def load_python(key: str, reference: str | Path, base: Path | None = None) -> ModuleType:
    """Run a Python file. InputError where it may not, or is not there; SwathError where it fails."""
    need_allowed(key, reference, base)
    file = file_of(reference, base)
    if not os.path.isfile(source_of(file)):
        raise InputError(key, str(reference), f"expected a Python file, but there is no file {file}")
    name = f"{USER_MODULE}{file.stem}_{zlib.crc32(str(file).encode()):08x}"
    space = _Space(file.parent, _gate.get().copies)
    if space.name not in _spaces:
        _spaces[space.name] = space
        sys.meta_path.insert(0, space)
    space = _spaces[space.name]
    space.renew()
    spec = spec_from_file_location(name, file, loader=_Source(name, file, space))
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[name] = module_from_spec(spec)  # dataclasses look it up there
    if str(file.parent) not in sys.path:
        sys.path.append(str(file.parent))  # it may import what lies beside it by a name made while it runs
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        text = f"{file}: could not be loaded: {type(error).__name__}: {error}"
        if isinstance(error, ImportError) and str(error.name).startswith("swath."):
            text += f"; if the file is older: {MIGRATED_BY}"
        raise SwathError(text) from error
    return module
