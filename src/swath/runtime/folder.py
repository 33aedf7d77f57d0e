"""Where a run is written: over nothing but an earlier run of the same scenario with the same changes."""

import atexit
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from swath import __version__
from swath.core.errors import InputError, absence_of
from swath.core.files.output_folder import LOCK, check_folder, check_free, held
from swath.core.files.place import remove, remove_folder
from swath.core.files.whole_file import PART
from swath.core.number_text import num
from swath.documents.json_file import read_object
from swath.documents.packed import readable
from swath.documents.text_file import read_text
from swath.scenario.scenario import Scenario, changes_in

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
SCAN_FILES, SCAN_OF = ("scan.*",), "scan.of.txt"
SAVES, SAVED, PAGES = "saves", ".save", "field.bin"  # a folder, names in it


def check_run_folder(folder: Path, *names: str) -> None:
    """InputError where a folder is no run folder with these files."""
    if not os.path.isdir(folder):
        none = absence_of(folder, "there is none of this name")
        what = "this is a file" if os.path.exists(folder) else none
        raise InputError("RUN", str(folder), f"expected a run folder, {what}")
    for name in names:
        if not os.path.isfile(folder / name):
            what = absence_of(folder / name, f"it has no {name}")
            raise InputError("RUN", str(folder), f"expected a run folder, {what}")


def choose_run_folder(
    name: str,
    seed: int,
    out: Path | None = None,
    *,
    what: str = "",
    summary: str | None = None,
    events: Sequence[Mapping[str, Any]] = (),
    replace: bool = False,
) -> Path:
    """The folder for a run.

    summary: its head line
    events: changes on its way
    replace: it may take the place of any other run

    Without `out` a fresh one, `runs/<name>-<seed>[-<what>]`, with -2, -3 ... when that exists; it is made at
    once, so that two runs of the same moment get two. A given `out` must be new, empty, or an earlier run of
    the scenario `name`, which may have been killed, with the changes that `summary` has, so that a command
    may be repeated, also with an edited file; InputError otherwise, and while another run writes into it.
    """
    if out is None:
        return _fresh(f"{name}-{seed}-{what}" if what else f"{name}-{seed}")
    was, asked = run_name(out), None if summary is None else _changes(name, summary, events)
    lies = _changes_of(out) if was == name and asked is not None else asked
    if was is not None and not replace and (was != name or lies not in (asked, None)):
        of = f"{name} with {asked}" if asked else f"{name} as it is" if lies else name
        expected = f"expected a new or empty folder, or an earlier run of {of}; --replace writes over it"
        raise InputError("--out", str(out), expected)
    check_folder(out, (f"scenario.yaml{PART}",) if was is None else ("*",), f"run of {name}")
    check_free(out)
    return out


def folder_for(scenario: Any, out: Path | None, **more: Any) -> Path:
    """The same for a run of a scenario."""
    return choose_run_folder(scenario.name, scenario.seed, out, summary=scenario.summary, **more)


def choose_scan_folder(
    name: str, seed: int, out: Path | None = None, *, of: str = "", replace: bool = False
) -> Path:
    """The folder for a scan: as for a run, a given `out` may hold an earlier scan (files `scan.*`) `of` the
    same.
    """
    if out is None:
        return _fresh(f"{name}-{seed}-scan")
    check_folder(out, SCAN_FILES, "scan")
    if not replace and scan_in(out) not in (of, None):
        expected = f"expected a new or empty folder, or an earlier scan of {of}; --replace writes over it"
        raise InputError("--out", str(out), expected)
    return out


def scan_of(scenario: Scenario, at_s: float) -> str:
    """What a scan is of, in words."""
    return f"{scenario.summary or scenario.name}, seed {scenario.seed}, at {num(at_s)} s"


def scan_in(folder: Path) -> str | None:
    """What the scan in a folder is of; None where there is none, or its version of swath did not say."""
    file = folder / SCAN_OF
    return read_text(file, "--out", "a scan").strip() if os.path.isfile(file) else None


def run_name(folder: Path) -> str | None:
    """Name of the scenario that was run into a folder, None when it is no run folder."""
    from swath.documents.yaml_document import read_document

    file = folder / "scenario.yaml"
    if not os.path.isfile(file) or not any(
        os.path.isfile(folder / f) for f in ("summary.json", "run.mcap", LOCK)
    ):
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
    """What was changed of the scenario of a run; None where its version of swath did not say."""
    from swath.documents.yaml_document import read_document

    with suppress(InputError), readable("run", "a run", folder):
        summary = read_object(folder / "summary.json", "run", "a summary.json")
        if summary["swath"] != __version__:
            return None
        data = read_document(folder / "scenario.yaml").data
        return _changes(data["name"], data["summary"], summary.get("events", ()))
    return None


def _changes(name: str, summary: str, events: Iterable[Mapping[str, Any]]) -> str:
    """What was changed of a scenario, before a run and on its way."""
    on_way = (f"{event['set']}={event['value']} at {num(event['t_s'])} s" for event in events)
    return "; ".join(filter(None, (changes_in(name, summary), *on_way)))


@contextmanager
def occupied(folder: Path, name: str) -> Iterator[None]:
    """Inside the block a run of the scenario `name` has the folder, empty but for an old scenario.yaml.

    The folder is made where it is missing. A run that ends without a summary leaves run.lock behind, as one
    that is killed does: it marks the folder as a run's. InputError when another run has the folder.
    """
    with held(folder, RUN_FILES, f"run of {name}", alone=False, until=RUN_FILES[0]):
        clear_run_folder(folder)
        yield


def clear_run_folder(folder: Path) -> None:
    """Remove what an earlier run wrote, and only that; its summary first, so that nothing seems whole.

    Its scenario.yaml stays until the new one takes its place: a folder without one would be nobody's.
    """
    for name in RUN_FILES[:-1]:
        remove(folder / name)
    saves = folder / SAVES
    if os.path.islink(saves):
        remove(saves)
    for file in (*saves.glob(f"*{SAVED}"), saves / PAGES):
        remove(file)
    with suppress(OSError):
        remove_folder(saves)


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
        remove_folder(folder)
        if folder.parent.name == RUNS:
            remove_folder(folder.parent)
