"""Code that a scenario brings along: which of it may run.

Python files (levels, evaluators, laws, crop habits), FMUs and systems of them have the rights of the user; a
Python file runs already when it is read. Whoever is about to load one asks `need_allowed` first.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Protocol, runtime_checkable

from swath.core.ability import ByMembers
from swath.core.errors import InputError

_allowed: ContextVar[frozenset[Path] | None] = ContextVar("allowed", default=None)  # None: any


@runtime_checkable
class NamesCode(Protocol, metaclass=ByMembers):
    """Parameters that name code. foreign_code: files or `file.py:Class`, from the scenario's folder."""

    @property
    def foreign_code(self) -> Sequence[str]: ...


@contextmanager
def only_code(references: Iterable[str | Path]) -> Iterator[None]:
    """Inside the block only these files, or `file.py:Class`, may run, and only if they may outside it."""
    files, outer = frozenset(file_of(r) for r in references), _allowed.get()
    token = _allowed.set(files if outer is None else files & outer)
    try:
        yield
    finally:
        _allowed.reset(token)


def is_allowed(reference: str | Path, base: Path | None = None) -> bool:
    """Whether a file, or `file.py:Class`, relative to `base`, may run."""
    allowed = _allowed.get()
    return allowed is None or file_of(reference, base) in allowed


def need_allowed(key: str, reference: str | Path, base: Path | None = None) -> None:
    """InputError, with the key, where a file, or `file.py:Class`, may not run."""
    if not is_allowed(reference, base):
        raise InputError(key, str(reference), refusal())


def refusal() -> str:
    """What was expected where code is refused."""
    allowed = ", ".join(sorted(map(str, _allowed.get() or ()))) or "none"
    return f"expected no code but what may run here ({allowed}): it would have your rights"


def file_of(reference: str | Path, base: Path | None = None) -> Path:
    """The file that a reference names, absolute. InputError where it can name none."""
    text = str(reference)
    file = text.rpartition(":")[0] if ".py:" in text else text
    try:
        return ((base or Path.cwd()) / file).resolve()
    except (OSError, ValueError, RuntimeError) as error:
        raise InputError("code", text, f"expected a file or file.py:Class ({error})") from error
