"""Where something is made, moved or removed, found in one way: no link below a folder of the user's leads it.

The user's own are the folders that a command line or a call names: they, and what leads to them, may be
links. Each part below one is opened from a descriptor of the part before and has to be a folder there and
then, whatever takes its place meanwhile; where the system has no such descriptors (Windows), each part is
looked at before.
"""

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from swath.core.errors import InputError

HAS_DESCRIPTORS = hasattr(os, "O_NOFOLLOW") and (
    {os.open, os.mkdir, os.rename, os.rmdir, os.stat, os.unlink} <= os.supports_dir_fd
)
FOLDER = getattr(os, "O_DIRECTORY", 0) | getattr(os, "O_PATH", os.O_RDONLY)
_roots: list[Path] = []  # the user's own, of all threads


@contextmanager
def within(*named: Path) -> Iterator[None]:
    """Inside the block these folders are the user's own."""
    added = [root for path in named for root in {path.absolute(), Path(os.path.realpath(path))}]
    _roots.extend(added)
    try:
        yield
    finally:
        for root in added:
            _roots.remove(root)


def present_roots() -> tuple[Path, ...]:
    """The user's own folders as they stand: for another process."""
    return tuple(_roots)


def is_within(path: Path) -> bool:
    """Whether a folder is one of the user's own, or lies below one."""
    return any(path.absolute().is_relative_to(root) for root in _roots)


@contextmanager
def place(path: Path, *, make: bool = False) -> Iterator[tuple[str, int | None]]:
    """Name of what has a path, and the descriptor of the folder around it, as `os.open` and its like take
    both; None with the whole path where the system has none.

    make: the folders around it are made where they are missing. InputError where one of them is a link below
    a folder of the user's, or no folder. OSErrors name the path. What nobody named lies in a folder of the
    user's.
    """
    root, names = _split(path.absolute(), [root for root in _roots if root != path.absolute()])
    *around, name = names or [""]
    folder = _opened(root, around, make)
    try:
        yield (str(path), None) if folder is None else (name, folder)
    except OSError as error:
        if error.filename == name:
            error.filename = str(path)
        raise
    finally:
        if folder is not None:
            os.close(folder)


def own_folder(path: Path) -> Path:
    """A folder to write into, made where it is missing, with those around it. Raises as `place`."""
    if (folder := _opened(*_split(path.absolute(), _roots), make=True)) is not None:
        os.close(folder)
    return path


def remove(path: Path) -> None:
    """Remove a file, or a link, where there is one. Raises as `place`."""
    with suppress(FileNotFoundError), place(path) as (name, folder):
        os.unlink(name, dir_fd=folder)


def remove_folder(path: Path) -> None:
    """Remove an empty folder. Raises as `place`."""
    with place(path) as (name, folder):
        os.rmdir(name, dir_fd=folder)


def remove_tree(path: Path) -> None:
    """Remove a folder with all that is in it, where there is one, and no folder that a link leads to."""
    with suppress(FileNotFoundError), place(path) as (name, folder):
        shutil.rmtree(name, ignore_errors=True, dir_fd=folder)


def move(path: Path, target: Path) -> None:
    """Give a file, or a link, another name, in the place of what has it. Raises as `place`."""
    with place(path) as (name, folder), place(target, make=True) as (new, into):
        os.replace(name, new, src_dir_fd=folder, dst_dir_fd=into)


def _split(path: Path, roots: list[Path]) -> tuple[Path, list[str]]:
    """The user's own folder that a path lies in, the innermost, and the names from there on."""
    found = [root for root in roots if path.is_relative_to(root)]
    root = max(found, key=lambda root: len(root.parts), default=path.parent)
    names = list(path.relative_to(root).parts)
    if ".." in names:
        raise InputError("folder", str(path), "expected a name without ..")
    return root, names


def _opened(root: Path, names: list[str], make: bool) -> int | None:
    """Descriptor of the folder that names lead to, None where the system has none. Raises as `place`."""
    if make:
        root.mkdir(parents=True, exist_ok=True)
    folder, path = os.open(root, FOLDER) if HAS_DESCRIPTORS else None, root
    try:
        for name in names:
            before, path = path, path / name
            here = str(path) if folder is None else name
            if make:
                with suppress(FileExistsError):
                    os.mkdir(here, dir_fd=folder)
            if folder is None:
                if os.path.realpath(path) != os.path.join(os.path.realpath(before), name):
                    raise OSError(errno.ELOOP, "", here)
            else:
                inner = os.open(name, FOLDER | os.O_NOFOLLOW, dir_fd=folder)
                os.close(folder)
                folder = inner
    except OSError as error:
        if folder is not None:
            os.close(folder)
        if error.errno in (errno.ENOTDIR, errno.ELOOP):
            what = "not a link to another one" if os.path.islink(path) else "this is none"
            raise InputError("folder", str(path), f"expected a folder, {what}") from None
        raise OSError(error.errno, error.strerror, str(path)) from error
    return folder
