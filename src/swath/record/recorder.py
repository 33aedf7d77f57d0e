"""The recorder: an observer of the graph that writes tracks.parquet and run.mcap."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

from swath import __version__
from swath.core.errors import InputError
from swath.core.schedule import NS
from swath.record.formats import ABOUT, RECORDING
from swath.record.mcap_file import McapFile
from swath.record.messages import RecordedMachine
from swath.record.messenger import Messenger
from swath.record.samples import Blocks, is_recordable
from swath.record.tracks import Column, Tracks, read_tracks, write_tracks
from swath.signals import Signal

SCENE = "scene"  # the obstacles of the field, which are recorded beside the machines
TRACKS_FILE, RECORDING_FILE = "tracks.parquet", "run.mcap"
SCENARIO = "scenario.yaml"  # attachment of run.mcap
LARGE_PERIOD = NS // 5  # between two messages of a large truth or scan, unless everything is wanted


class Recorder:
    """Writes a run into its folder while it goes; call it with (slot, t, outputs).

    folder: exists already. machines: whose slots (`name.slot`) are recorded, and the scene with them; slots
    of other names are not
    extra: per machine name, further columns of tracks.parquet
    rate_hz: of tracks.parquet and of the thinned messages in run.mcap; mcap: write run.mcap
    detail: `none`: no file, the tracks are in memory alone; `standard` messages only, `exact` samples beside
    them, messages of scans then five times a second; `full`: samples of the large truth too, which else is
    seen five times a second. Taps of the file see every scan.
    scenario: as resolved, for whoever has run.mcap alone

    run.mcap is readable up to its last whole chunk at any time; `close` completes it and writes the tracks.
    Used as a context manager, it closes on an exception and on Ctrl-C too.
    """

    def __init__(
        self,
        folder: Path,
        machines: Sequence[RecordedMachine],
        *,
        extra: Mapping[str, Sequence[Column]] | None = None,
        rate_hz: float = 50.0,
        mcap: bool = True,
        detail: str = "exact",
        scenario: str = "",
    ) -> None:
        self.folder = folder
        self._period = round(NS / rate_hz)
        more = extra or {}
        self.tracks = {m.name: Tracks(m, self._period, tuple(more.get(m.name, ()))) for m in machines}
        self.file = McapFile(folder / RECORDING_FILE) if mcap and detail != "none" else None
        sources = [*machines, replace(machines[0], name=SCENE, mounting={}, outputs={})]
        self._messengers = {m.name: Messenger(m, self.file) for m in sources} if self.file else {}
        self._clock_due = 0
        self._due: dict[tuple[str, str], int] = {}
        self._detail = detail
        self._blocks: dict[tuple[str, str], Blocks | None] = {}
        self._is_closed = False
        self._sinks: dict[tuple[str, str], tuple[str, str, Tracks | None, Messenger | None]] = {}
        if self.file is not None:
            self.file.attach(ABOUT, "application/json", _about(machines, detail).encode())
            if scenario:
                self.file.attach(SCENARIO, "application/yaml", scenario.encode())

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Record what `slot` published at t [ns]."""
        if self.file is not None and t >= self._clock_due:
            self._tell_time(self.file, t)
        for output, signal in outputs.items():
            key = slot, output
            sink = self._sinks.get(key)
            if sink is None:
                sink = self._sinks[key] = self._sink(slot, output)
            part, source, tracks, messenger = sink
            if tracks is not None:
                tracks.take(t, source, signal)
            if messenger is None:
                continue
            if self._is_due(key, t, signal):
                messenger.write(part, output, t, signal)
            if self._detail != "standard":
                self._add_exact(key, t, signal)

    def save(self) -> dict[str, Any]:
        """What is not in the files so far, and how much of them there is."""
        waiting = {key: None if b is None else b.save() for key, b in self._blocks.items()}
        return {
            "tracks": {name: tracks.save() for name, tracks in self.tracks.items()},
            "messages": 0 if self.file is None else self.file.count,
            "makers": {name: messenger.save() for name, messenger in self._messengers.items()},
            "blocks": waiting,
            "due": dict(self._due),
            "clock_due": self._clock_due,
        }

    def load(self, state: Mapping[str, Any], folder: Path) -> None:
        """Go on from a saved state. folder: of a run that has begun in the same way; its files are copied.

        InputError where they do not reach so far.
        """
        if self._detail == "none":
            raise InputError("run.record", "none", "expected a run with a recording")
        table = read_tracks(folder / TRACKS_FILE)
        for name, tracks in self.tracks.items():
            tracks.load(state["tracks"][name], table)
        if self.file is not None:
            self.file.begin_as(folder / RECORDING_FILE, state["messages"])
        for name, messenger in self._messengers.items():
            messenger.load(state["makers"][name])
        for key, kept in state["blocks"].items():
            blocks = self._blocks[key] = None if kept is None else self._new_blocks(*key)
            if blocks is not None:
                blocks.load(kept)
        self._due, self._clock_due = dict(state["due"]), state["clock_due"]

    def close(self) -> None:
        """Complete both files. Calling it again does nothing."""
        if self._is_closed:
            return
        self._is_closed = True
        try:
            if self._detail != "none":
                write_tracks(self.folder / TRACKS_FILE, list(self.tracks.values()))
        finally:
            if self.file is not None:
                try:
                    for blocks in self._blocks.values():
                        if blocks is not None:
                            blocks.flush()
                finally:
                    self.file.close()

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _tell_time(self, file: McapFile, t: int) -> None:
        """`/clock`, as often as the thinned messages."""
        self._clock_due = (t // self._period + 1) * self._period
        stamp = file.make.header(t, "").stamp
        file.write("/clock", t, file.make("rosgraph_msgs/msg/Clock", clock=stamp))

    def _sink(self, slot: str, output: str) -> tuple[str, str, Tracks | None, Messenger | None]:
        """Slot and output without the machine's name, and what takes their samples."""
        name, _, part = slot.partition(".")
        return part, f"{part}.{output}", self.tracks.get(name), self._messengers.get(name)

    def _add_exact(self, key: tuple[str, str], t: int, signal: Signal) -> None:
        """Add the sample as it is to its block."""
        if key not in self._blocks:
            is_wanted = signal.about.samples in ("exact", self._detail) and is_recordable(signal)
            self._blocks[key] = self._new_blocks(*key) if is_wanted else None
        if (blocks := self._blocks[key]) is not None:
            blocks.add(t, signal)

    def _new_blocks(self, slot: str, output: str) -> Blocks:
        return Blocks(self.file, f"/{slot.replace('.', '/')}/{output}")

    def _is_due(self, key: tuple[str, str], t: int, signal: Signal) -> bool:
        about, detail = signal.about, self._detail
        is_large = about.samples == "full" and detail != "full"
        if about.is_bulky and detail == "exact":
            is_large = self.file is not None and not self.file.taps
        if not (about.is_thinned or is_large):
            return True
        if t < self._due.get(key, 0):
            return False
        period = LARGE_PERIOD if is_large else self._period
        self._due[key] = (t // period + 1) * period
        return True


def _about(machines: Sequence[RecordedMachine], detail: str) -> str:
    """recording.json: what the messages do not say exactly, the mountings (pose_machine_sensor)."""
    mounting = {
        f"{m.name}.{slot}": {"position": pose.position.tolist(), "rotation": pose.rotation.tolist()}
        for m in machines
        for slot, pose in m.mounting.items()
    }
    about = {"format": RECORDING, "swath": __version__, "detail": detail, "mounting": mounting}
    return json.dumps(about, indent=2)
