"""Where a run is written: never over something that is not an earlier run of the same scenario and changes.

While a run writes, its folder holds `run.lock`, which says what is run and keeps other runs out. A run that
was killed leaves that file behind; the lock itself goes with the process.
"""

import atexit
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from swath import __version__
from swath.core.errors import InputError
from swath.core.whole_file import PART, open_to_keep
from swath.documents.json_file import read_object
from swath.scenario.scenario import changes_in

RUNS = "runs"  # where the folders lie whose place nobody chose
RUN_FILES = (
    "summary.json",
    "report.html",
    "replay.html",
    "tracks.parquet",
    "metadata.yaml",
    "run.mcap",
    "scenario.yaml",
)
LOCK = "run.lock"
SAVES, SAVED, PAGES = "saves", ".save", "field.bin"  # a folder, names in it


def check_run_folder(folder: Path, *names: str) -> None:
    """InputError where a folder is no run folder with these files."""
    if not folder.is_dir():
        what = "this is a file" if folder.exists() else "there is none of this name"
        raise InputError("RUN", str(folder), f"expected a run folder, {what}")
    for name in names:
        if not (folder / name).is_file():
            raise InputError("RUN", str(folder), f"expected a run folder, it has no {name}")


def choose_run_folder(
    name: str,
    seed: int,
    out: Path | None = None,
    *,
    what: str = "",
    summary: str | None = None,
    replace: bool = False,
) -> Path:
    """The folder for a run. summary: its head line; replace: it may take the place of any other run

    Without `out` a fresh one, `runs/<name>-<seed>[-<what>]`, with -2, -3 ... when that exists; it is made at
    once, so that two runs of the same moment get two. A given `out` must be new, empty, or an earlier run of
    the scenario `name`, which may have been killed, with the changes that `summary` tells, so that a command
    may be repeated, also with an edited file; InputError otherwise, and while another run writes into it.
    """
    if out is None:
        return _fresh(f"{name}-{seed}-{what}" if what else f"{name}-{seed}")
    if not _is_free(out):
        was, asked = run_name(out), None if summary is None else changes_in(name, summary)
        changed = asked
        if was == name and asked is not None and (told := _changes_of(out)) is not None:
            changed = told
        if was is None or (not replace and (was != name or changed != asked)):
            of = f"{name} with {asked}" if asked else f"{name} as it is" if changed else name
            expected = f"expected a new or empty folder, or an earlier run of {of}"
            raise InputError("--out", str(out), expected + ("; --replace writes over it" if was else ""))
    if (out / LOCK).is_file():
        os.close(_lock(out))
    return out


def choose_scan_folder(name: str, seed: int, out: Path | None = None) -> Path:
    """The folder for a scan: as for a run, a given `out` may hold an earlier scan (files `scan.*`)."""
    if out is None:
        return _fresh(f"{name}-{seed}-scan")
    if not _is_free(out) and not (out.is_dir() and all(f.name.startswith("scan.") for f in out.iterdir())):
        raise InputError("--out", str(out), "expected a new or empty folder, or an earlier scan")
    return out


def run_name(folder: Path) -> str | None:
    """Name of the scenario that was run into a folder, None when it is no run folder."""
    from swath.documents.yaml_document import read_document

    file = folder / "scenario.yaml"
    if not file.is_file() or not any((folder / f).is_file() for f in ("summary.json", "run.mcap", LOCK)):
        return None
    try:
        name = read_object(folder / "summary.json", "run", "a summary.json")["name"]
    except (InputError, KeyError):
        try:
            data = read_document(file).data
        except InputError:
            return None
        name = data.get("name") if isinstance(data, dict) else None
    return name if isinstance(name, str) else None


def _changes_of(folder: Path) -> str | None:
    """What was changed of the scenario of a run; None where its version of swath did not tell."""
    from swath.documents.yaml_document import read_document

    with suppress(InputError, KeyError):
        if read_object(folder / "summary.json", "run", "a summary.json")["swath"] != __version__:
            return None
        data = read_document(folder / "scenario.yaml").data
        return changes_in(data["name"], data["summary"])
    return None


@contextmanager
def occupied(folder: Path, name: str) -> Iterator[None]:
    """Inside the block a run of the scenario `name` has the folder, empty but for an old scenario.yaml.

    The folder is made where it is missing. A run that ends without a summary leaves run.lock behind, as one
    that is killed does: it marks the folder as a run's. InputError when another run has the folder.
    """
    file = _lock(folder)
    try:
        os.ftruncate(file, 0)
        os.write(file, json.dumps({"scenario": name, "pid": os.getpid()}).encode())
        clear_run_folder(folder)
        yield
    finally:
        if (folder / "summary.json").is_file():
            (folder / LOCK).unlink(missing_ok=True)
        os.close(file)


def clear_run_folder(folder: Path) -> None:
    """Remove what an earlier run wrote, and only that; its summary first, so that nothing seems whole.

    Its scenario.yaml stays until the new one takes its place: a folder without one would be nobody's.
    """
    for name in (*RUN_FILES[:-1], *(f"{n}{PART}" for n in RUN_FILES)):
        (folder / name).unlink(missing_ok=True)
    saves = folder / SAVES
    if saves.is_symlink():
        saves.unlink()
    for file in (*saves.glob(f"*{SAVED}"), saves / PAGES):
        file.unlink(missing_ok=True)
    with suppress(OSError):
        saves.rmdir()


def _lock(folder: Path) -> int:
    """A locked file descriptor of run.lock, which is made where it is missing. InputError where it is taken.

    The lock goes with the process, however that ends. Where the file system has no locks, there is none.
    """
    path = folder / LOCK
    while True:
        folder.mkdir(parents=True, exist_ok=True)
        file = open_to_keep(path, os.O_RDWR)
        try:
            _take(file, folder)
            if path.exists() and os.path.samestat(os.fstat(file), path.stat()):
                return file  # else the run before removed it between the two lines above
        except BaseException:
            os.close(file)
            raise
        os.close(file)


def _take(file: int, folder: Path) -> None:
    try:
        import fcntl
    except ImportError:  # no POSIX system
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(
            "--out", str(folder), f"expected a folder that {_who(file)} does not write to"
        ) from None
    except OSError:
        return


def _who(file: int) -> str:
    """The run that holds a lock, in words."""
    with suppress(OSError, ValueError, TypeError, KeyError):
        os.lseek(file, 0, os.SEEK_SET)
        held = json.loads(os.read(file, 1000))
        return f"another run (process {int(held['pid'])}, {held['scenario']})"
    return "another run"


def _fresh(name: str) -> Path:
    """A new empty folder, which no other run can take; it goes again where nothing is written into it."""
    first = Path(RUNS) / name
    path, count = first, 1
    while True:
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            count += 1
            path = first.with_name(f"{first.name}-{count}")
        else:
            atexit.register(remove_empty, path.resolve())
            return path


def remove_empty(folder: Path) -> None:
    """Remove a folder into which nothing was written, and `runs` around it where that is empty then."""
    with suppress(OSError):
        folder.rmdir()
        if folder.parent.name == RUNS:
            folder.parent.rmdir()


def _is_free(path: Path) -> bool:
    """Whether there is nothing, or only what a run left that was killed before it began."""
    leftover = {LOCK, f"scenario.yaml{PART}"}
    return not path.exists() or (path.is_dir() and {f.name for f in path.iterdir()} <= leftover)
