"""Samples of a recording in the order of time, each at the moment it came out."""

from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import replace
from itertools import chain, islice
from typing import Any

from swath.core.abilities import Closes
from swath.core.component import Port
from swath.core.errors import InputError
from swath.core.frames import wrap_angle
from swath.record.read.files import Log
from swath.record.samples import MSGTYPE, SUFFIX, is_same_block, signal_type, unpack
from swath.signals import MachineState, Signal
from swath.signals.flat import build, flat_fields, read

Timed = tuple[int, Signal]  # (published [ns], sample)
Record = tuple[str, int, Any]  # (topic, log time [ns], message)
Pass = Callable[[Collection[str]], Iterator[Record]]
WAITING = 256  # messages that one reader may be behind the others


class Demux:
    """One pass through a recording for several readers; each has a queue of what it has not read yet.

    Who falls more than WAITING messages behind the others, or never reads, loses its queue: it goes through
    the recording by itself from then on. open_pass: messages of some topics, as of a log
    """

    def __init__(self, open_pass: Pass, topics: Collection[str]) -> None:
        self._open = open_pass
        self._records = open_pass(topics)
        self._waiting: dict[str, list[_Queue]] = {}
        self._own: list[Iterator[Record]] = []

    def read(self, *topics: str) -> Iterator[Record]:
        """(topic, log time [ns], message) of some topics; to be called before the first message is read."""
        mine = _Queue(topics)
        for topic in topics:
            self._waiting.setdefault(topic, []).append(mine)
        return self._read(mine)

    def close(self) -> None:
        """Close the file."""
        for records in (self._records, *self._own):
            if isinstance(records, Closes):
                records.close()

    def _read(self, mine: "_Queue") -> Iterator[Record]:
        while not mine.is_alone:
            while mine.records:
                mine.given += 1
                yield mine.records.popleft()
            for record in self._records:
                for waiting in self._waiting.get(record[0], ()):
                    waiting.add(record)
                if mine.records:
                    break
            else:
                if not mine.is_alone:
                    return
        own = self._open(mine.topics)
        self._own.append(own)
        yield from islice(own, mine.given, None)


class _Queue:
    """What one reader has not read yet. given: messages that it has read; is_alone: it fell behind."""

    def __init__(self, topics: Collection[str]) -> None:
        self.topics = topics
        self.records: deque[Record] = deque()
        self.given = 0
        self.is_alone = False

    def add(self, record: Record) -> None:
        """Add one more, where it can wait."""
        if len(self.records) >= WAITING:
            self.is_alone = True
            self.records.clear()
        if not self.is_alone:
            self.records.append(record)


class Feed:
    """The samples of one output, one read ahead. times on the clock of the log [ns].

    gaps: (begin, length) of those above the limit [ns]; without one, above three times the usual interval
    shift: taken from all times, so that the run's 0 is where it should be
    """

    def __init__(self, samples: Iterable[Timed], *, shift: int = 0, gap_limit: int | None = None) -> None:
        self._samples = iter(samples)
        self._shift, self._limit = shift, gap_limit
        self._usual = 0
        self.gaps: list[tuple[int, int]] = []
        self.unordered_count = 0
        self.last: Timed | None = None
        self.next = self._pull(None)

    def until(self, t: int) -> list[Timed]:
        """The samples published up to t [ns] that were not given out yet."""
        found = []
        while self.next is not None and self.next[0] <= t:
            self.last = self.next
            found.append(self.last)
            self.next = self._pull(self.last)
        return found

    def _pull(self, before: Timed | None) -> Timed | None:
        for published, sample in self._samples:
            at = published - self._shift
            if before is not None and at < before[0]:
                self.unordered_count += 1
                continue
            if before is not None:
                self._watch(before[0], at - before[0])
            return at, (replace(sample, t=sample.t - self._shift) if self._shift else sample)
        return None

    def _watch(self, begin: int, length: int) -> None:
        limit = 3 * self._usual if self._limit is None else self._limit
        if limit and length > limit:
            self.gaps.append((begin, length))
        elif length > 0:  # a running median: a step towards each interval
            step = max(1, abs(length - self._usual) // 8)
            self._usual = (
                length if not self._usual else self._usual + (step if length > self._usual else -step)
            )


def own_outputs(log: Log, slot: str) -> dict[str, bool]:
    """Outputs of a slot (`combine.lidar`) that a recording of swath holds, and whether sample by sample."""
    prefix = f"/{slot.replace('.', '/')}/"
    found: dict[str, bool] = {}
    for topic, kind in log.topics().items():
        if topic.startswith(prefix) and "/" not in (name := topic.removeprefix(prefix)):
            if kind == MSGTYPE:
                found[name.removesuffix(SUFFIX)] = True
            else:
                found.setdefault(name, False)
    return found


def exact_topic(slot: str, output: str) -> str:
    """Where the samples of an output lie bit for bit."""
    return f"/{slot.replace('.', '/')}/{output}{SUFFIX}"


def exact_outputs(log: Log) -> dict[str, str]:
    """What a recording holds bit for bit: topic -> `slot.output`."""
    topics = [topic for topic, kind in log.topics().items() if kind == MSGTYPE]
    return {topic: topic.removesuffix(SUFFIX).strip("/").replace("/", ".") for topic in topics}


def exact_samples(blocks: Iterator[tuple[str, int, Any]]) -> Iterator[Timed]:
    """The samples in blocks; they come in the order in which they were published."""
    for _, _, block in blocks:
        yield from unpack(block)


def unlike(a: Iterator[Record], b: Iterator[Record]) -> tuple[Iterator[Record], Iterator[Record]]:
    """The blocks of samples of two recordings from the first one on that differs from the other's."""
    for one, other in zip(a, b, strict=False):
        if not is_same_block(one[2], other[2]):
            return chain([one], a), chain([other], b)
    return iter(()), iter(())


def exact_port(log: Log, slot: str, output: str) -> Port:
    """The port of a recorded output. InputError where the type of its samples is not known here."""
    topic = exact_topic(slot, output)
    for _, _, block in log.messages((topic,)):
        try:
            return Port(output, signal_type(block.signal))
        except KeyError:
            expected = "expected a sample type of swath, or of a Python file that this scenario uses"
            raise InputError("recording", block.signal, expected, file=log.path) from None
    raise InputError("recording", topic, "expected samples, there are none", file=log.path)


def between(a: Signal, b: Signal, t: int) -> Signal:
    """The sample at t [ns] between two others, linear; flags, whole numbers and arrays are those of `a`."""
    span = b.t - a.t
    share = min(max((t - a.t) / span, 0.0), 1.0) if span > 0 else 0.0
    values: dict[str, Any] = {}
    for name, field in flat_fields(type(a)).items():
        first = read(a, name)
        if field.kind != "real":
            values[name] = first
            continue
        step = read(b, name) - first
        if field.unit == "rad":
            step = float(wrap_angle(step))
        values[name] = first + share * step
    return build(type(a), t, values)


def rebased(samples: Iterator[Timed], begin: int) -> Iterator[Timed]:
    """MachineStates from the last one before the log time `begin` [ns] on, the distance counted from it."""
    before: tuple[int, MachineState] | None = None
    zero: float | None = None
    for published, sample in samples:
        assert isinstance(sample, MachineState)
        if published <= begin:
            before = (published, sample)
            continue
        if zero is None:
            zero = sample.distance if before is None else before[1].distance
            if before is not None:
                yield before[0], replace(before[1], distance=0.0)
        yield published, replace(sample, distance=sample.distance - zero)
    if zero is None and before is not None:
        yield before[0], replace(before[1], distance=0.0)
