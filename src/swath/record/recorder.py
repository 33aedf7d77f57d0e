"""The recorder: an observer of the graph that writes tracks.parquet and run.mcap."""

import json
from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, repeat
from operator import itemgetter
from pathlib import Path
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
from swath.record.tracks import Column, Tracks, first_in_each, read_tracks, write_tracks
from swath.signals import Signal

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
SELDOM = NS * 3600  # between two looks where nobody waits


class Recorder:
    """Writes a run into its folder while it goes; call it with (slot, t, outputs).

    folder: exists already. machines: whose slots (`name.slot`) are recorded, and the scene with them; slots
        of other names are not
    extra: per machine name, further columns of tracks.parquet; only: columns that are read, None = all
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
        only: Collection[str] | None = None,
        detail: str = "exact",
        scenario: str = "",
    ) -> None:
        self.folder = folder
        self._machines, self._more, self._only = machines, extra or {}, only
        self._is_late = all(c.value is None for columns in self._more.values() for c in columns)
        self.file = McapFile(folder / RECORDING_FILE) if detail != "none" else None
        sources = [*machines, replace(machines[0], name=SCENE, mounting={}, outputs={})]
        self._messengers = {m.name: Messenger(m, self.file) for m in sources} if self.file else {}
        self._clock_due = 0
        self._detail = detail
        self._is_closed = False
        self._sinks: dict[tuple[str, str], _Sink] = {}
        self._full: list[Blocks] = []
        self._t = -1  # of the newest sample that is written [ns]
        self._waiting: deque[_Waiting] = deque()  # samples that are still to be written
        self._is_deferred = False
        self.look: Callable[[], None] = no_look
        if self.file is not None:
            self.file.attach(ABOUT, "application/json", _about(machines, detail).encode())
            if scenario:
                self.file.attach(SCENARIO, "application/yaml", scenario.encode())

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Record what `slot` published at t [ns]."""
        self.take(Seen.of_one(slot, t, outputs))

    @property
    def is_late(self) -> bool:
        """No column is what an evaluator holds at the moment."""
        return self._is_late

    @property
    def beat(self) -> int:
        """How long it may be from look to look [ns]."""
        if self.file is not None and self.file.taps:
            return HEARD_LATEST // 2 if self._is_deferred else HEARD_LATEST
        return LATEST // 2 if self._is_deferred else SELDOM

    def take(self, seen: Seen) -> None:
        """Record what slots published since the last call, in order."""
        with unstopped():
            for name, tracks in self._tracks.items():
                tracks.take(seen.of_machine(name))
            if self.file is not None and seen.blocks:
                blocks = sorted(seen.blocks, key=lambda block: int(block.orders[0]))
                self._waiting += sorted(chain.from_iterable(map(self._samples, blocks)), key=itemgetter(0))
                until = self._waiting[-1][1] - (self.beat if self._is_deferred else 0)
                while self._waiting and self._waiting[0][1] <= until:
                    self.write_next()

    def _samples(self, block: Block) -> Iterable["_Waiting"]:
        """The samples of a block, which are to be written."""
        key, n, made = (block.slot, block.output), len(block), list[Made]([()] * len(block))
        sink = self._sinks.get(key)
        if sink is None:
            sink = self._sinks[key] = self._sink(*key, block.sample(0))
        period = sink.period if self.file is not None and self.file.taps else sink.alone
        is_due, sink.due = first_in_each(period, block.times, sink.due)
        if sink.messenger is not None:
            which = is_due.nonzero()[0].tolist() if self._detail == "thinned" else range(n)
            sink.left_out += n - len(which)
            for k, own in zip(which, sink.messenger.rows(sink.part, block.output, block, which), strict=True):
                made[k] = own
        orders, times = block.orders.tolist(), block.times.tolist()
        return zip(orders, times, repeat(sink), repeat(block), range(n), is_due.tolist(), made)

    @property
    def tracks(self) -> dict[str, Tracks]:
        """Tracks of each machine."""
        self.look()
        return self._tracks

    @cached_property
    def _tracks(self) -> dict[str, Tracks]:
        more = self._more
        return {m.name: Tracks(m, PERIOD, tuple(more.get(m.name, ())), self._only) for m in self._machines}

    @property
    def left_out(self) -> str:
        """How many samples of a thinned recording have no message, by slot and output; "" = none."""
        self.look()
        counts = ((key, sink.left_out) for key, sink in self._sinks.items() if sink.left_out)
        return ", ".join(f"{count} of {'.'.join(key)}" for key, count in counts)

    def defer(self) -> None:
        """From now on `write_next` writes run.mcap, sample by sample; nothing waits longer than LATEST.

        Where taps hear the messages, HEARD_LATEST; they hear them in the same order. `write_waiting` before
        somebody acts on what was heard.
        """
        self._is_deferred = True

    def write_next(self) -> bool:
        """Write the oldest of the samples that wait; False where none does."""
        if not self._waiting:
            return False
        _, t, sink, block, k, is_due, made = self._waiting.popleft()
        if t > self._t:
            self._begin_tick(t)
        if (to := sink.messenger) is not None:
            to.file.is_heard = is_due
            if made is None:
                to.write(sink.part, block.output, t, block.sample(k))
            for topic, data in made or ():
                to.file.add(topic, t, data)
        if sink.blocks is not None:
            sink.blocks.take(t, block, k)
            if sink.blocks.is_full:
                self._full.append(sink.blocks)
        return True

    def _begin_tick(self, t: int) -> None:
        """Write the blocks that the last tick filled: not in that tick, which may hold a scan."""
        full, self._full, self._t = self._full, [], t
        for blocks in full:
            blocks.flush()
        if t >= self._clock_due and self.file is not None:
            self._tell_time(self.file, t)

    def write_waiting(self) -> None:
        """Write all that waits."""
        self.look()
        while self.write_next():
            pass

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
            sink = self._sinks[key] = self._empty_sink(key[0])
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
        with ExitStack() as rest:  # whatever fails before
            if self.file is not None:
                rest.callback(self.file.close)
                rest.callback(self._write_rest)
            if self._detail != "none":
                write_tracks(self.folder / TRACKS_FILE, list(self.tracks.values()))

    def _write_rest(self) -> None:
        self.write_waiting()
        for sink in self._sinks.values():
            if sink.blocks is not None:
                sink.blocks.flush()

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _tell_time(self, file: McapFile, t: int) -> None:
        """`/clock`, as often as the thinned messages."""
        period = BESIDE_PERIOD if self._detail == "thinned" and not file.taps else PERIOD
        self._clock_due, file.is_heard, make = (t // period + 1) * period, True, file.make
        kind = "rosgraph_msgs/msg/Clock"
        file.write("/clock", t, Draft(t, (), (), lambda: make(kind, clock=make.header(t, "").stamp)))

    def _sink(self, slot: str, output: str, signal: Signal) -> "_Sink":
        """What takes the samples of an output, of which this is the first."""
        sink = self._empty_sink(slot)
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

    def _empty_sink(self, slot: str) -> "_Sink":
        name, _, part = slot.partition(".")
        return _Sink(part, self._messengers.get(name))

    def _new_blocks(self, slot: str, output: str) -> Blocks:
        share = len(self._sinks) * PHASE % 1.0  # of a block: outputs write theirs in different ticks
        first = BLOCK_NS - int(share * BLOCK_NS)
        return Blocks(self.file, f"/{slot.replace('.', '/')}/{output}", first)


@dataclass(slots=True)
class _Sink:
    """Where the samples of an output go. part: its slot, without the machine.

    period: between two messages that taps hear [ns], 0 = all
    alone: between two of a thinned recording that nobody listens to
    due: when the next is
    left_out: samples without a message
    """

    part: str
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


Made = Sequence[tuple[str, bytes]] | None  # topics and bytes of a sample's messages; None: not yet made
# a sample that is to be written: its order, time [ns], place in its block, whether taps hear it
_Waiting = tuple[int, int, _Sink, Block, int, bool, Made]


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
