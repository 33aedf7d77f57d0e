"""The one gate for what files of others may do: run code, and reach beyond this machine or to its devices.

Nothing of somebody else's code is loaded but through here, and only what may run.

Code is a Python file (a level, an evaluator, a law, a habit of a crop), an FMU, or a system of FMUs: it has
the rights of the user, and a Python file runs already when it is read. None may run but what was allowed: all
by `--allow-code` (`code=True` in Python), or single files by being named on the command line itself. Packages
that are installed are loaded where a scenario names their level.

Addresses of this machine alone and virtual buses are free. Any other address, bus or terminal is opened only
where the user has named it, in the same words: on the command line, or in Python as `addresses`.
"""

import importlib.util
import os
import sys
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from importlib.machinery import SourceFileLoader
from pathlib import Path
from shlex import quote
from types import ModuleType
from typing import Any, Protocol, runtime_checkable

from swath.core.ability import ByMembers
from swath.core.errors import MIGRATED_BY, InputError, SwathError, reason_of

SUFFIXES = (".py", ".fmu", ".ssp", ".ssd")
USER_MODULE = "swath_user_"  # how the names of modules begin that were read from a user's file


@dataclass(frozen=True)
class Gate:
    """files: that may run, None = any; leaves: others are left unread where a scenario is only looked at.

    is_narrow: only a part of what may run from outside does, as while a run is changed
    addresses: that may be opened
    """

    files: frozenset[Path] | None = frozenset()
    addresses: frozenset[str] = frozenset()
    leaves: bool = False
    is_narrow: bool = False


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


class _Source(SourceFileLoader):
    """Runs what stands in the file, not compiled code that lies beside it."""

    def get_code(self, fullname: str) -> Any:
        return self.source_to_code(self.get_data(self.path), self.path)


def load_python(key: str, reference: str | Path, base: Path | None = None) -> ModuleType:
    """Run a Python file. InputError where it may not, or is not there; SwathError where it fails."""
    need_allowed(key, reference, base)
    file = file_of(reference, base)
    if not os.path.isfile(file):
        raise InputError(key, str(reference), f"expected a Python file, but there is no file {file}")
    name = f"{USER_MODULE}{file.stem}_{zlib.crc32(str(file).encode()):08x}"
    spec = importlib.util.spec_from_file_location(name, file, loader=_Source(name, str(file)))
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)  # dataclasses look it up there
    if str(file.parent) not in sys.path:
        sys.path.append(str(file.parent))  # it may import what lies beside it
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        text = f"{file}: could not be loaded: {type(error).__name__}: {error}"
        if isinstance(error, ImportError) and str(error.name).startswith("swath."):
            text += f"; if the file is older: {MIGRATED_BY}"
        raise SwathError(text) from error
    return module
