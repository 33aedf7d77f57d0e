"""A world saved every few seconds, so that another run can go on from there: folder `saves` of a run folder.

A save is what a world, its digest, evaluators and recorder remember. Of the field it holds only places in
`field.bin`, to which a page is added when it was changed since the save before. Tracks and recording are not
saved: who goes on copies the beginning of theirs.

`SavesField` is the run hook of `swath run --save-field`.
"""

import time
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from swath import __version__
from swath.core.errors import InputError, SwathError, reason_of
from swath.core.files.place import remove
from swath.core.files.read_file import open_to_read
from swath.core.files.whole_file import copy_whole, open_to_append, write_whole
from swath.core.number_text import num
from swath.core.packed_state import MAGIC, UnpackableState, pack, unpack
from swath.core.schedule import NS
from swath.field.paging.state_file import CODES_BYTES, STRAW_BYTES, inflatable, write_state
from swath.runtime.field_state import about
from swath.runtime.folder import PAGES, SAVED, SAVES
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.world import World


class SavesField(RunHook):
    """Writes the field's state after a run."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self._world: World | None = None

    def begin(self, run: ActiveRun) -> None:
        """Remember whose field it is."""
        self._world = run.world

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Write it, also of a run that was stopped."""
        if self._world is not None:
            write_state(self.file, self._world.field.save(), about(self._world.scenario))


EVERY_S = 5.0
SHORTEST_S = 0.1
MOST = 32  # saves; beyond, older ones thin out
LEVEL = 1  # of zlib
LARGEST_BYTES = 1 << 29  # of a save, unpacked
PAGED = {"codes": CODES_BYTES, "straw": STRAW_BYTES}  # lists of a field's state, per page; of one, unpacked


class Saves(RunHook):
    """Run hook. every_s: simulated time between two saves [s].

    refused: why the run cannot be saved, empty where it can; times: of the saves that are there [ns]
    """

    def __init__(self, every_s: float = EVERY_S) -> None:
        if not every_s >= SHORTEST_S:
            raise InputError("--save-every-s", every_s, f"expected at least {num(SHORTEST_S)} s")
        self._period = round(every_s * NS)
        self.refused, self.times = "", list[int]()
        self._run: ActiveRun | None = None
        self._due = self._bytes = self._count = 0
        self._cost_s = 0.0
        self._pages: dict[bytes, tuple[int, int]] = {}  # what lies where in the file of pages

    def begin(self, run: ActiveRun) -> None:
        """Save from here on; a run that goes on from a save has those before it, too."""
        self._run, self.times, self._pages = run, [], {}
        self._bytes, self._count, self._cost_s = 0, 0, 0.0
        self._due = (run.world.graph.t // self._period + 1) * self._period
        self.refused = why_not(run)
        if not self.refused and run.out is not None:
            write_whole(run.out / SAVES / PAGES, b"")
            if run.start is not None:
                self.times = copy_saves(run.start.folder, run.out, run.world.graph.t)
            run.world.graph.before_tick.insert(0, self._before_tick)

    def save_now(self) -> float:
        """Save between two ticks; returns the time of the save [s]. SwathError where it cannot."""
        if self.refused:
            raise SwathError(self.refused)
        if self._run is None or self._run.world.graph.t <= 0:
            raise SwathError("expected a run that has begun: at 0 s there is nothing to save")
        at = self._run.world.graph.t
        if at not in self.times:
            self._save(self._run)
        return at / NS

    def summarize(self, t: int) -> dict[str, Any]:
        """How many there are, how large, and what they cost."""
        if self.refused:
            return {"saves": {"refused": self.refused}}
        entry = {"count": self._count, "kept": len(self.times), "bytes": self._bytes, "cpu_s": self._cost_s}
        return {"saves": entry}

    def _before_tick(self, t: int) -> None:
        if t > self._due and not self.refused:
            assert self._run is not None
            self._due = (self._run.world.graph.t // self._period + 1) * self._period
            began = time.thread_time()
            try:
                self._save(self._run)
            except SwathError as error:
                self.refused = str(error)
            self._cost_s += time.thread_time() - began

    def _save(self, run: ActiveRun) -> None:
        assert run.out is not None
        folder, at = run.out / SAVES, run.world.graph.t
        state: dict[str, Any] = {
            "swath": __version__,
            "events": list(run.changes.events),
            "world": _saved(run.world),
            "digest": run.digest.save(),
            "evaluation": run.evaluation.save(),
            "recorder": run.recorder.save(),
        }
        field = dict(state["world"]["field"])
        for name in PAGED:
            field[name] = [self._placed(page, folder / PAGES) for page in field[name]]
        state["world"] = {**state["world"], "field": field}
        try:
            data = zlib.compress(pack(state, run.evaluation.shared), LEVEL)
        except UnpackableState as error:
            raise UnpackableState(f"{_culprit(state)}{error}") from error
        write_whole(folder / f"{at}{SAVED}", data)
        self.times.append(at)
        self._bytes, self._count = self._bytes + len(data), self._count + 1
        if len(self.times) > MOST:
            gone = self.times.pop(superfluous(self.times))
            remove(folder / f"{gone}{SAVED}")

    def _placed(self, page: Any, file: Path) -> Any:
        """Where the bytes of a page lie; what is no bytes stays."""
        if not isinstance(page, bytes):
            return page
        place = self._pages.get(page)
        if place is None:
            with open_to_append(file) as out:
                place = self._pages[page] = out.tell(), len(page)
                out.write(page)
            self._bytes += len(page)
        return place


def _saved(world: World) -> dict[str, Any]:
    """The state of a world. SwathError, with the slot, for a part of a user that cannot give one."""
    try:
        return world.save()
    except SwathError:
        raise
    except Exception as error:
        for node in world.graph.nodes:
            try:
                node.component.save()
            except Exception as own:
                raise SwathError(f"{node.slot.name} cannot be saved ({own})") from own
        raise SwathError(f"the world cannot be saved ({error})") from error


def _culprit(state: Mapping[str, Any]) -> str:
    """The slot whose state cannot be written, as the beginning of a line."""
    for slot, own in state["world"]["graph"]["components"].items():
        try:
            pack(own)
        except UnpackableState:
            return f"{slot}: "
    return ""


def why_not(run: ActiveRun) -> str:
    """Why a run cannot be saved while it runs, empty where it can or a part has still to be asked."""
    if run.out is None or run.recorder.file is None:
        return "a run without a recording cannot be saved while it runs"
    if run.world.scenario.is_paced:
        return "a run at the pace of real time cannot be saved while it runs, it does not repeat"
    return ""


def superfluous(times: list[int]) -> int:
    """Index of the save to do without: gaps may grow with the time that has passed since. Never the ends."""
    newest = times[-1]
    share = [(times[i + 1] - times[i - 1]) / (newest - times[i - 1]) for i in range(1, len(times) - 1)]
    return 1 + share.index(min(share))


def saves_in(folder: Path) -> dict[int, Path]:
    """Saves of a run folder by their time [ns], in order."""
    found = {}
    for file in (folder / SAVES).glob(f"*{SAVED}"):
        with suppress(ValueError):
            found[int(file.name.removesuffix(SAVED))] = file
    return dict(sorted(found.items()))


def is_readable(save: Path) -> bool:
    """Whether a save begins as those of this version of swath do."""
    with suppress(InputError, zlib.error), open_to_read(save, "save", "a save") as file:
        return zlib.decompressobj().decompress(file.read(1024), len(MAGIC)) == MAGIC
    return False


def saved_before(folder: Path, at: int) -> Iterator[bytes]:
    """Saves of a run folder of times before `at` [ns], still packed, newest first."""
    for t, file in reversed(saves_in(folder).items()):
        if t < at:
            with suppress(InputError), open_to_read(file, "save", "a save", LARGEST_BYTES) as save:
                yield save.read(LARGEST_BYTES)


def copy_saves(source: Path, target: Path, until: int) -> list[int]:
    """Copy saves up to a time [ns] from a run folder to another; returns their times."""
    times = [t for t in saves_in(source) if t <= until]
    for name in [*(f"{t}{SAVED}" for t in times), *([PAGES] if times else [])]:
        copy_whole(source / SAVES / name, target / SAVES / name, "save", "a save")
    return times


def read_save(data: bytes, folder: Path, shared: Mapping[str, Any]) -> dict[str, Any]:
    """The state that a save of a run folder holds. shared: as of `Evaluation`. UnpackableState."""
    try:
        state = unpack(zlib.decompressobj().decompress(data, LARGEST_BYTES), shared)
        if state["swath"] != __version__:
            raise UnpackableState(f"expected a save of swath {__version__}, not of {state['swath']}")
        field = state["world"]["field"]
        with open_to_read(folder / SAVES / PAGES, "save", "pages of saves") as file:
            for name, size in PAGED.items():
                field[name] = [_page(file, place, size) for place in field[name]]
    except (InputError, OSError, zlib.error, LookupError, TypeError, ValueError) as error:
        raise UnpackableState(f"expected a whole save ({reason_of(error)})") from error
    return dict(state)


def _page(file: Any, place: Any, size: int) -> Any:
    if not isinstance(place, tuple):
        return place
    at, packed = place
    file.seek(at)
    return inflatable(file.read(packed), size)
