"""The recorder: an observer of the graph that writes tracks.parquet and run.mcap."""

import json
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any

from swath import __version__
from swath.core.blocks import Block, Seen, no_look
from swath.core.errors import InputError
from swath.core.process.stopping import unstopped
from swath.core.schedule import NS
from swath.record.formats import ABOUT, RECORDING
from swath.record.mcap_file import McapFile
from swath.record.message_factory import Draft, RecordedMachine, plain_names
from swath.record.messenger import Messenger
from swath.record.samples import BLOCK_NS, Blocks, is_recordable
from swath.record.tracks import Column, Tracks, read_tracks, write_tracks
from swath.signals import Signal

Made = Sequence[tuple[str, bytes]] | None  # topics and bytes of a sample's messages; None: not yet made
SCENE = "scene"  # the obstacles of the field, which are recorded beside the machines
TRACKS_FILE, RECORDING_FILE = "tracks.parquet", "run.mcap"
SCENARIO = "scenario.yaml"  # attachment of run.mcap
PERIOD = NS // 50  # between two rows of tracks.parquet, or messages of fast outputs to who listens
BESIDE_PERIOD = NS // 10  # between two messages of an output in a thinned recording
BULKY_PERIOD = NS // 5  # the same of a scan
PHASE = 0.618  # of a block, from output to output: the golden section spreads any number of them
LARGE_PERIOD = NS * 2 // 5  # the same of a large truth
LATEST = NS // 10  # that a sample waits to be written, where it may wait
HEARD_LATEST = NS // 50  # the same where taps hear the messages


class Recorder:
    """Writes a run into its folder while it goes; call it with (slot, t, outputs).

    folder: exists already. machines: whose slots (`name.slot`) are recorded, and the scene with them; slots
        of other names are not
    extra: per machine name, further columns of tracks.parquet
    detail: `none`: no file, the tracks are in memory alone; `standard`: a message of every sample; `exact`:
        the samples bit for bit beside them; `full`: those of the large truth, too; `thinned`: as `exact` with
        messages at most 10 times a second, of scans 5 times, of large truth 2.5 times. Taps of the file hear
        fast outputs 50 times a second at most.
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
        detail: str = "exact",
        scenario: str = "",
    ) -> None:
        self.folder = folder
        self._machines, self._more = machines, extra or {}
        self.file = McapFile(folder / RECORDING_FILE) if detail != "none" else None
        sources = [*machines, replace(machines[0], name=SCENE, mounting={}, outputs={})]
        self._messengers = {m.name: Messenger(m, self.file) for m in sources} if self.file else {}
        self._clock_due = 0
        self._detail = detail
        self._is_closed = False
        self._sinks: dict[tuple[str, str], _Sink] = {}
        self._full: list[Blocks] = []
        self._t = -1  # of the newest samples [ns]
        self._waiting: deque[_Waiting] | None = None  # what is still to be written, None = nothing may wait
        self._latest = LATEST
        self.look: Callable[[], None] = no_look
        if self.file is not None:
            self.file.attach(ABOUT, "application/json", _about(machines, detail).encode())
            if scenario:
                self.file.attach(SCENARIO, "application/yaml", scenario.encode())

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Record what `slot` published at t [ns]."""
        waiting = self._waiting
        if waiting is None:
            self._begin_tick(t)
        else:
            waiting.append((t, None, "", None))
        for output, signal in outputs.items():
            sink = self._sinks.get((slot, output))
            if sink is None:
                sink = self._sinks[slot, output] = self._sink(slot, output, signal)
            if sink.tracks is not None:
                sink.tracks.take(t, sink.source, signal)
            if sink.messenger is None:
                continue
            if waiting is None:
                self._write(sink, output, t, signal)
            else:
                waiting.append((t, sink, output, signal))
        while waiting and waiting[0][0] <= t - self._latest:
            self.write_next()

    @property
    def is_late(self) -> bool:
        """Nobody hears the messages, none is written between ticks, no column changes with an evaluator."""
        every = (column for columns in self._more.values() for column in columns)
        is_live = any(column.later is None for column in every)
        return not is_live and self._waiting is None and not (self.file and self.file.taps)

    def take(self, seen: Seen) -> None:
        """Record what slots published since the last call, in order."""
        with unstopped():
            blocks = sorted(seen.blocks, key=lambda block: int(block.orders[0]))
            made = [(block, block.times.tolist(), *self._prepared(block)) for block in blocks]
            every = [(order, n, k) for n, b in enumerate(blocks) for k, order in enumerate(b.orders.tolist())]
            for _, n, k in sorted(every):
                block, times, sink, messages = made[n]
                self._begin_tick(times[k])
                if sink.tracks is not None:
                    sink.tracks.take_of(times[k], sink.source, block, k)
                if (to := sink.messenger) is None:
                    continue
                if (ready := messages[k]) is None:
                    to.write(sink.part, block.output, times[k], block.sample(k))
                for topic, data in ready or ():
                    to.file.add(topic, times[k], data)
                if sink.blocks is not None:
                    sink.blocks.take(times[k], block, k)
                    if sink.blocks.is_full:
                        self._full.append(sink.blocks)

    def _prepared(self, block: Block) -> tuple["_Sink", list[Made]]:
        """What takes the samples of a block, and the messages of each that are made already."""
        slot, output, times = block.slot, block.output, block.times.tolist()
        sink = self._sinks.get((slot, output))
        if sink is None:
            sink = self._sinks[slot, output] = self._sink(slot, output, block.sample(0))
        if sink.messenger is None:
            return sink, []
        due = [k for k, t in enumerate(times) if self._is_due(sink, t)]
        which = due if self._detail == "thinned" else range(len(times))
        sink.left_out += len(times) - len(which)
        found: list[Made] = [()] * len(times)
        for k, ready in zip(which, sink.messenger.rows(sink.part, output, block, which), strict=True):
            found[k] = ready
        return sink, found

    @property
    def tracks(self) -> dict[str, Tracks]:
        """Tracks of each machine."""
        self.look()
        return self._tracks

    @cached_property
    def _tracks(self) -> dict[str, Tracks]:
        return {m.name: Tracks(m, PERIOD, tuple(self._more.get(m.name, ()))) for m in self._machines}

    @property
    def left_out(self) -> str:
        """How many samples of a thinned recording have no message, by slot and output; "" = none."""
        self.look()
        left_out = [
            f"{sink.left_out} of {'.'.join(key)}" for key, sink in self._sinks.items() if sink.left_out
        ]
        return ", ".join(left_out)

    def defer(self) -> None:
        """From now on `write_next` writes run.mcap, sample by sample; nothing waits longer than LATEST.

        Where taps hear the messages, HEARD_LATEST; they hear them in the same order. `write_waiting` before
        somebody acts on what was heard.
        """
        if self.file is not None:
            self._waiting = deque()
            self._latest = HEARD_LATEST if self.file.taps else LATEST

    def write_next(self) -> bool:
        """Write the oldest of the samples that wait; False where none does."""
        if not self._waiting:
            return False
        t, sink, output, signal = self._waiting.popleft()
        if sink is None or signal is None:
            self._begin_tick(t)
        else:
            self._write(sink, output, t, signal)
        return True

    def _begin_tick(self, t: int) -> None:
        if self._full and t > self._t:
            self._write_blocks()
        self._t = t
        if t >= self._clock_due and self.file is not None:
            self._tell_time(self.file, t)

    def _write(self, sink: "_Sink", output: str, t: int, signal: Signal) -> None:
        """A sample into run.mcap."""
        if sink.messenger is not None and self.file is not None:
            self.file.is_heard = self._is_due(sink, t)
            if self.file.is_heard or self._detail != "thinned":
                sink.messenger.write(sink.part, output, t, signal)
            else:
                sink.left_out += 1
        if sink.blocks is not None:
            sink.blocks.add(t, signal)
            if sink.blocks.is_full:
                self._full.append(sink.blocks)

    def write_waiting(self) -> None:
        """Write all that waits."""
        self.look()
        while self.write_next():
            pass

    def _write_blocks(self) -> None:
        """Write the blocks that the last tick filled: not in that tick, which may hold a scan."""
        full, self._full = self._full, []
        for blocks in full:
            blocks.flush()

    def save(self) -> dict[str, Any]:
        """What is not in the files so far, and how much of them there is."""
        self.write_waiting()
        return {
            "tracks": {name: tracks.save() for name, tracks in self.tracks.items()},
            "messages": 0 if self.file is None else self.file.count,
            "makers": {name: messenger.save() for name, messenger in self._messengers.items()},
            "outputs": {key: sink.save() for key, sink in self._sinks.items()},
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
        for key, (timing, blocks) in state["outputs"].items():
            sink = self._sinks[key] = self._empty_sink(*key)
            sink.period, sink.alone, sink.due, sink.left_out = timing
            if blocks is not None:
                sink.blocks = self._new_blocks(*key)
                sink.blocks.load(blocks)
                self._full += [sink.blocks] if sink.blocks.is_full else []
        self._clock_due = state["clock_due"]

    def close(self) -> None:
        """Complete both files. Calling it again does nothing."""
        if self._is_closed:
            return
        self.look()
        self._is_closed = True
        try:
            if self._detail != "none":
                write_tracks(self.folder / TRACKS_FILE, list(self.tracks.values()))
        finally:
            if self.file is not None:
                try:
                    self.write_waiting()
                    for sink in self._sinks.values():
                        if sink.blocks is not None:
                            sink.blocks.flush()
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
        period = BESIDE_PERIOD if self._detail == "thinned" and not file.taps else PERIOD
        self._clock_due, file.is_heard = (t // period + 1) * period, True
        file.write("/clock", t, Draft(t, (), (), lambda: _clock(file, t)))

    def _sink(self, slot: str, output: str, signal: Signal) -> "_Sink":
        """What takes the samples of an output, of which this is the first."""
        sink = self._empty_sink(slot, output)
        about, detail = signal.about, self._detail
        sink.period = PERIOD if about.is_thinned else 0
        is_large = about.samples == "full"
        if is_large and detail != "full":
            sink.period = BULKY_PERIOD
        is_wanted = about.samples in ("exact", detail) and is_recordable(signal)
        is_small = about.is_thinned or plain_names(type(signal)) is not None
        if is_large:
            sink.alone = LARGE_PERIOD
        if sink.messenger is not None and detail != "standard" and is_wanted:
            sink.blocks = self._new_blocks(slot, output)
            sink.alone = BULKY_PERIOD if about.is_bulky else BESIDE_PERIOD if is_small else 0
        return sink

    def _empty_sink(self, slot: str, output: str) -> "_Sink":
        name, _, part = slot.partition(".")
        return _Sink(part, f"{part}.{output}", self._tracks.get(name), self._messengers.get(name))

    def _new_blocks(self, slot: str, output: str) -> Blocks:
        share = len(self._sinks) * PHASE % 1.0  # of a block: outputs write theirs in different ticks
        first = BLOCK_NS - int(share * BLOCK_NS)
        return Blocks(self.file, f"/{slot.replace('.', '/')}/{output}", first)

    def _is_due(self, sink: "_Sink", t: int) -> bool:
        """Whether a message is to be written."""
        period = sink.period if self.file is not None and self.file.taps else sink.alone
        if t < sink.due and period:
            return False
        sink.due = (t // period + 1) * period if period else 0
        return True


@dataclass(slots=True)
class _Sink:
    """Where the samples of an output go. part, source: its slot, and with the output, without the machine.

    period: between two messages that taps hear [ns], 0 = all
    alone: between two of a thinned recording that nobody listens to
    due: when the next is
    left_out: samples without a message
    """

    part: str
    source: str
    tracks: Tracks | None
    messenger: Messenger | None
    blocks: Blocks | None = None
    period: int = 0
    alone: int = 0
    due: int = 0
    left_out: int = 0

    def save(self) -> Any:
        """What it is, and the samples that wait for their block."""
        timing = self.period, self.alone, self.due, self.left_out
        return timing, None if self.blocks is None else self.blocks.save()


_Waiting = tuple[int, _Sink | None, str, Signal | None]  # None: a tick begins


def _clock(file: McapFile, t: int) -> Any:
    return file.make("rosgraph_msgs/msg/Clock", clock=file.make.header(t, "").stamp)


def _about(machines: Sequence[RecordedMachine], detail: str) -> str:
    """recording.json: what the messages do not say exactly, the mountings (pose_machine_sensor), the crop."""
    mounting = {
        f"{m.name}.{slot}": {"position": pose.position.tolist(), "rotation": pose.rotation.tolist()}
        for m in machines
        for slot, pose in m.mounting.items()
    }
    about = {"format": RECORDING, "swath": __version__, "detail": detail, "mounting": mounting}
    about |= {"crop": dict(machines[0].crop)}
    return json.dumps(about, indent=2)
