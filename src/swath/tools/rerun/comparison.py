"""Compares a run with a recorded one, sample for sample."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from swath.core.schedule import NS
from swath.record.digest import Digest, encode
from swath.record.read.feed import Demux, exact_samples, exact_topic, own_outputs
from swath.record.read.files import Log
from swath.runtime.hooks import ActiveRun, RunHook
from swath.signals import Signal

ELSEWHEN = "was published at another time"


@dataclass
class SlotComparison:
    """How one slot compares. sample_count: samples compared.

    differs_at: time of the first difference [ns], None without one
    what: its output and fields
    digest, recorded: chained over the samples that were compared, here and in the recording
    """

    slot: str
    sample_count: int = 0
    differs_at: int | None = None
    what: str = ""
    digest: Digest = field(default_factory=Digest)
    recorded: Digest = field(default_factory=Digest)

    @property
    def is_identical(self) -> bool:
        """Every sample was the same, to the last bit."""
        return self.differs_at is None

    def note(self, t: int, what: str) -> None:
        """A difference; the first one counts."""
        if self.differs_at is None:
            self.differs_at, self.what = t, what


class RecordingComparison(RunHook):
    """Observes a run and compares every sample of some slots with a recording.

    slots: full names; only those that the recording holds sample by sample are compared
    """

    def __init__(self, log: Log, slots: Collection[str], *, played: Collection[str]) -> None:
        self.log, self.played = log, tuple(played)
        known = {slot: [o for o, exact in own_outputs(log, slot).items() if exact] for slot in slots}
        self.slots = {slot: SlotComparison(slot) for slot, outputs in known.items() if outputs}
        topics = {(s, o): exact_topic(s, o) for s in self.slots for o in known[s]}
        self._demux = Demux(log.messages, list(topics.values()))
        self._streams = {key: exact_samples(self._demux.read(topic)) for key, topic in topics.items()}
        self._early: dict[tuple[str, str], int] = {}  # published before the next recorded sample [ns]

    def begin(self, run: ActiveRun) -> None:
        """Observe the run."""
        run.observers.append(self)

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Take in what `slot` published at t [ns]."""
        for output, signal in outputs.items():
            if (key := (slot, output)) not in self._streams:
                continue
            recorded = next(self._streams[key], None)
            if recorded is None:
                continue  # beyond the end of the recording
            compared = self.slots[slot]
            if key in self._early:
                compared.note(self._early.pop(key), f"{output} {ELSEWHEN}")
            if recorded[0] > t:  # a part's shorter last step where the run ends before the recorded one, or
                self._early[key] = t  # a difference: the next sample, or the end, shows it
                continue
            compared.sample_count += 1
            if recorded[0] < t:
                compared.note(recorded[0], f"{output} {ELSEWHEN}")
            elif names := _differences(signal, recorded[1]):
                compared.note(t, f"{output}: {', '.join(names)}")
            compared.digest(slot, t, {output: signal})
            compared.recorded(slot, recorded[0], {output: recorded[1]})

    def summarize(self, t: int) -> dict[str, Any]:
        """What summary.json says, after the run has ended at t [ns]."""
        for (slot, output), early in self._early.items():
            if early < t:
                self.slots[slot].note(early, f"{output} {ELSEWHEN}")
        for key, stream in self._streams.items():
            if (left := next(stream, None)) is not None and left[0] <= t:
                self.slots[key[0]].note(left[0], f"{key[1]} was not published")
        self._demux.close()
        return {
            "rerun": {
                "recording": str(self.log.path),
                "played": list(self.played),
                "slots": {c.slot: _result(c) for c in self.slots.values()},
            }
        }


def _result(c: SlotComparison) -> dict[str, Any]:
    found: dict[str, Any] = {"identical": c.is_identical, "samples": c.sample_count}
    found |= {"digest": c.digest.hex, "recorded_digest": c.recorded.hex}
    if c.differs_at is not None:
        found |= {"differs_from_s": c.differs_at / NS, "differs_in": c.what}
    return found


def _differences(a: Signal, b: Signal) -> list[str]:
    if type(a) is not type(b):
        return [type(a).__name__]
    return [f.name for f in fields(a) if encode(getattr(a, f.name)) != encode(getattr(b, f.name))]
