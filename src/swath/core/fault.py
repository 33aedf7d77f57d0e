"""A fault between a component and those who read it: wrong values, and held, lost and late samples.

The component itself knows nothing of it. A sample keeps the time that it is valid for, however late it
leaves; what was sent at t = 0 passes, so that every reader has something to begin with.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

import numpy as np

from swath.core.component import KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.layout import quantities
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.signal import Quantity, Signal, span_of
from swath.core.units import UNITS

Window = tuple[float, float]
Values = Mapping[str, float]
BEAM_FIELDS = "ranges", "intensity"  # of a scan, lost with a beam


@dataclass(frozen=True, kw_only=True)
class Fault:
    """What goes wrong. scale, bias, noise (one sigma), stuck: by field and unit, such as `offset_m`.

    beam_loss, dead_beams: shares of the beams of a scan, others in each or always the same
    hold, silent: windows of time [s]
    loss: share of samples, lost for `burst` [s] together; latency [s]
    """

    scale: Values
    bias: Values
    noise: Values
    stuck: Values
    beam_loss: float
    dead_beams: float
    hold: Sequence[Window]
    silent: Sequence[Window]
    loss: float
    burst: float
    latency: float

    @property
    def keeps_time(self) -> bool:
        """Whether every sample leaves at the step that made it."""
        return not (self.silent or self.loss or self.latency)


NOTHING = Fault(
    scale={}, bias={}, noise={}, stuck={}, beam_loss=0.0, dead_beams=0.0, hold=(), silent=(), loss=0.0,
    burst=0.0, latency=0.0,
)  # fmt: skip


class FaultyOutput(KeepsState):
    """A fault at work on the outputs of one slot. InputError for a field that none of them has."""

    kept = ("_queue", "_sent")

    def __init__(self, fault: Fault, outputs: Sequence[Port]) -> None:
        self.fault = fault
        self._changes = {port.name: _changes(fault, port.signal) for port in outputs}
        _check(fault, outputs)
        self._stream = Stream(0, "")
        self._queue: list[tuple[int, Outputs]] = []
        self._sent: Outputs = {}

    @property
    def changes(self) -> bool:
        """Whether it may pass on anything else than what it is given."""
        return self.fault != NOTHING

    def reset(self, stream: Stream) -> None:
        """Begin anew. stream: of the slot."""
        self._stream = stream.child("fault")
        self._queue, self._sent = [], {}

    def pass_on(self, t: int, outputs: Outputs) -> Outputs:
        """What readers get at t [ns] of what the component sends then."""
        outputs = {name: self._wrong(name, t, sample) for name, sample in outputs.items()}
        if t == 0:
            self._sent = outputs
            return outputs
        if _within(self.fault.hold, t):
            outputs = {name: replace(sample, t=t) for name, sample in self._sent.items()}
        else:
            self._sent = {**self._sent, **outputs}
        if outputs and not self._is_lost(t):
            self._queue.append((t + round(self.fault.latency * NS), outputs))
        due = [sent for at, sent in self._queue if at <= t]
        self._queue = [(at, sent) for at, sent in self._queue if at > t]
        return {name: sample for sent in due for name, sample in sent.items()}

    def _wrong(self, name: str, t: int, sample: Signal) -> Signal:
        changed = {
            field: change(getattr(sample, field), self._stream.child(field), t)
            for field, change in self._changes[name].items()
        }
        return replace(sample, **changed) if changed else sample

    def _is_lost(self, t: int) -> bool:
        if _within(self.fault.silent, t):
            return True
        counter = t if self.fault.burst == 0.0 else t // round(self.fault.burst * NS)
        return bool(self.fault.loss and self._stream.child("loss").at(counter).uniform() < self.fault.loss)


Change = Callable[[Any, Stream, int], Any]  # (value, stream of the field, t) -> value


def _changes(fault: Fault, signal: type[Signal]) -> dict[str, Change]:
    """What happens to each field of a sample type that something happens to."""
    found: dict[str, Change] = {}
    for field, quantity in quantities(signal).items():
        by_key = dict(_keys(field, quantity))
        bias, noise, stuck = (
            next((given[key] * factor for key, factor in by_key.items() if key in given), None)
            for given in (fault.bias, fault.noise, fault.stuck)
        )
        scale = next((fault.scale[key] for key in (field, *by_key) if key in fault.scale), 1.0)
        is_beam = field in BEAM_FIELDS and (fault.beam_loss or fault.dead_beams)
        if scale != 1.0 or bias or noise or stuck is not None or is_beam:
            beams, span = fault if is_beam else None, span_of(field, quantity)
            found[field] = _change(scale, bias or 0.0, noise or 0.0, stuck, beams, span)
    return found


def _change(
    scale: float, bias: float, noise: float, stuck: float | None, beams: Fault | None, span: Window
) -> Change:
    """The change of a field, which stays within what it can hold."""

    def change(value: Any, stream: Stream, t: int) -> Any:
        wrong = value * scale + bias if stuck is None else value * 0.0 + stuck
        if noise:
            drawn = stream.at(t).standard_normal(np.shape(value))
            wrong = wrong + noise * drawn
        wrong = np.clip(wrong, *span) if isfinite(span[0]) or isfinite(span[1]) else wrong
        if beams is not None:
            wrong = np.where(_lost_beams(beams, stream, t, len(value))[:, None], np.nan, wrong)
        return wrong.astype(value.dtype) if isinstance(value, np.ndarray) else type(value)(wrong)

    return change


def _lost_beams(fault: Fault, stream: Stream, t: int, count: int) -> np.ndarray:
    """Which beams have no echo at t; those of one scan are the same whatever the field."""
    beams = Stream(stream.seed, stream.name.rpartition(".")[0] + ".beams")
    dead = beams.at(0).uniform(size=count) < fault.dead_beams
    return np.asarray(dead | (beams.child("each").at(t).uniform(size=count) < fault.beam_loss))


def _keys(field: str, quantity: Quantity) -> list[tuple[str, float]]:
    """Keys that a field has in a scenario, each with the factor to SI: of every unit of its kind."""
    own = next((u for u in UNITS.values() if u.factor == 1.0 and u.symbol == quantity.unit), None)
    if own is None or own.kind == "ratio":
        return [(field, 1.0)]
    return [(f"{field}_{key}", u.factor) for key, u in UNITS.items() if key and u.kind == own.kind]


def _check(fault: Fault, outputs: Sequence[Port]) -> None:
    fields = {f: q for port in outputs for f, q in quantities(port.signal).items() if f != "t"}
    known = {key for field, quantity in fields.items() for key, _ in _keys(field, quantity)}
    for name in ("scale", "bias", "noise", "stuck"):
        for key in getattr(fault, name):
            if key not in (known | set(fields) if name == "scale" else known):
                have = ", ".join(sorted(_keys(f, q)[0][0] for f, q in fields.items()))
                raise InputError(f"fault.{name}.{key}", None, f"expected a field that the slot sends: {have}")
    if (fault.beam_loss or fault.dead_beams) and not set(BEAM_FIELDS) & set(fields):
        raise InputError("fault.beam_loss_percent", None, "expected a slot that sends scans")


def _within(windows: Sequence[Window], t: int) -> bool:
    return any(first * NS <= t < last * NS for first, last in windows)
