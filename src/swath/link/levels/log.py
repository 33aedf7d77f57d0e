"""Level `log`: a slot plays what was recorded, from a run.mcap or from anybody's bag.

From our own run.mcap every sample comes back bit for bit at the moment it was published. From any other
recording, messages become samples as `record/read/messages.py` says; a sample comes out at the first step
after its message was received.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.component import Inputs, Outputs, Port, State
from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.link.log_sources import (
    FIX,
    Params,
    Source,
    choose_sources,
    numbers_of,
    recording_path,
    to_local,
)
from swath.record.messages import OPTICAL_FRAME
from swath.record.read import feed as feeds
from swath.record.read.feed import Demux, Feed, Record, Timed
from swath.record.read.fields import Context, is_on_clock, number_at, stamp_in, stamp_of
from swath.record.read.files import Log, open_log
from swath.record.read.fixes import read_fixes, states_of_fixes
from swath.record.read.frame_checks import Lift, check_gravity, lift_of
from swath.record.read.frames import GROUND, own_mounting, static_links, static_mounting
from swath.record.read.messages import maker_for
from swath.signals import Fix, Image, Inertial, MachineState, Scan
from swath.signals.flat import build, flat_fields
from swath.signals.radar import RadarTargets
from swath.signals.setup import LinkSetup

MOUNTED = (Scan, RadarTargets, Image, Fix, Inertial)  # samples of sensors whose place control is told
CHECKED = 3000  # samples of a signal that say in which frame it is
LATE_S = 1.0  # the first sample may come this much after the start [s]


class LogPlayer:
    """Plays the outputs of a slot.

    mounting: pose_machine_sensor, where it is known; optical: pose of a recorded camera's optical frame
    ends_at: the time [ns] from which on there is nothing to play, None while there is; ending: says so
    notes: what the user should know
    """

    inputs: tuple[Port, ...] = ()

    def __init__(self, params: Params, setup: LinkSetup) -> None:
        self.params, self.setup = params, setup
        self.log: Log = open_log(recording_path(params, setup.base))
        self.recorded = params.slot or setup.name
        self._types = self.log.topics()
        self._sources = choose_sources(params, setup, self.log, self._types, self.recorded)
        self.outputs = tuple(s.port for s in self._sources)
        self._shift = self.log.begin() if any(not s.is_exact for s in self._sources) else 0
        self._shift += round(params.start_s * NS)
        self._period = round(setup.control.period * NS)
        self._context = Context(setup.control.machine.wheelbase, to_local(params, setup.base))
        self._fixes: dict[str, list[Timed]] = {}
        self._demux: Demux | None = None
        self._told: list[str] = []
        self._lifts: dict[str, Lift] = {}
        self.mounting = self._mounting()
        if (optical := own_mounting(self.log, self.recorded + OPTICAL_FRAME)) is not None:
            self.optical = optical
        self._log_end = self.log.end() - self._shift if params.end == "log" else 0
        self._check()
        self._check_samples()
        self._rewind()
        try:
            self._first()
        finally:
            self.close()

    @property
    def notes(self) -> list[str]:
        """What was played and how, gaps, what was left out."""
        p, name = self.params, self.setup.slot
        found = [
            f"{name}: plays {self.recorded if self._is_own else ', '.join(self._topics)} of {self.log.path}",
            *self._told,
        ]
        if self._is_own and not all(s.is_exact for s in self._sources):
            rounded = ", ".join(s.port.name for s in self._sources if not s.is_exact)
            found.append(f"{name}: {rounded} from standard messages, which round and leave out")
        if p.values:
            found.append(f"{name}: `values` is now `constants`, as in level fmu")
        if p.between == "interpolate":
            found.append(f"{name}: interpolated between recorded samples")
        if self._skipped:
            found.append(f"{name}: {self._skipped} samples came faster than rate_hz and were left out")
        for source, made in zip(self._sources, self._feeds, strict=True):
            if made.gaps:
                begin, length = max(made.gaps, key=lambda g: g[1])
                longest = f"the longest {length / NS:.2f} s at {begin / NS:.2f} s"
                found.append(f"{name}.{source.port.name}: {len(made.gaps)} gaps in the log, {longest}")
            if made.unordered_count:
                text = f"{made.unordered_count} samples out of order were left out"
                found.append(f"{name}.{source.port.name}: {text}")
        noted = {**self._context.notes, **self.log.notes}
        return found + [f"{name}: {note} ({n})" for note, n in noted.items()]

    def reset(self, stream: Stream) -> Outputs:
        """What was published up to the start; the first sample, where it comes a little later."""
        self._rewind()
        return self._first()

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """What was published in (t, t + dt], the newest; nothing where nothing was."""
        self._t = t + dt
        outputs: Outputs = {}
        for source, made in zip(self._sources, self._feeds, strict=True):
            found = made.until(self._t)
            self._skipped += max(len(found) - 1, 0)
            if self.params.between == "interpolate" and made.last is not None and made.next is not None:
                outputs[source.port.name] = feeds.between(made.last[1], made.next[1], self._t)
            elif found:
                outputs[source.port.name] = found[-1][1]
        self._look_ahead()
        return outputs

    @property
    def steps_any_length(self) -> bool:
        """At the end of a run it plays what came since its last step; in between it makes nothing up."""
        return self.params.between == "hold"

    def save(self) -> State:
        """How far it has come."""
        return {"t": self._t, "skipped": self._skipped}

    def load(self, state: State) -> None:
        """Back to a saved moment; the recording is read again from its beginning."""
        self._rewind()
        self._t, self._skipped = state["t"], state["skipped"]
        for made in self._feeds:
            made.until(self._t)
        self._look_ahead()

    def close(self) -> None:
        """Close the recording."""
        if self._demux is not None:
            self._demux.close()

    @property
    def reads(self) -> tuple[Path, ...]:
        """The recording."""
        return (self.log.path,)

    @property
    def _is_own(self) -> bool:
        return not self.params.topics

    @property
    def _topics(self) -> list[str]:
        return list(dict.fromkeys(t for s in self._sources for t in s.topics))

    def _check(self) -> None:
        """InputError for what can be known to be wrong before anything is read."""
        for source in self._sources:
            kind = source.port.signal
            arrays = [f.name for f in flat_fields(kind).values() if f.kind == "array"]
            if self.params.between == "interpolate" and arrays:
                what = f"the {', '.join(arrays)} of a {kind.__name__} cannot be interpolated"
                raise InputError("between", "interpolate", f"expected hold, {what}")
        outputs = {s.port.name: s.port.signal for s in self._sources}
        for name in self.params.scale:
            port, _, number = name.partition(".")
            if port not in outputs or number not in flat_fields(outputs[port]) or "." in number:
                raise InputError("scale", name, f"expected output.number; outputs: {', '.join(outputs)}")

    def _check_samples(self) -> None:
        """What the samples of another's recording say of their frame: which way gravity points, how high they
        lie. InputError where that cannot be."""
        for source in self._sources:
            kind, name = source.port.signal, source.port.name
            if kind is Inertial and not source.is_exact:
                turn = None if self.mounting is None else self.mounting.rotation
                check_gravity(name, self._some(source), turn)
            is_track = kind is MachineState or (kind is Fix and not source.is_exact)
            if is_track and self.setup.ground is not None:
                antenna = 0.0 if kind is MachineState or self.mounting is None else self.mounting.position[2]
                lift = lift_of(self._some(source), self.setup.ground, float(antenna))
                is_mended = kind is MachineState and not source.is_exact
                if lift is not None:
                    self._told.append(f"{self.setup.slot}.{name}: {lift.note(is_mended=is_mended)}")
                if lift is not None and is_mended:
                    self._lifts[name] = lift
        self._context.notes.clear()

    def _some(self, source: Source) -> list[Any]:
        """The first samples from where the run starts; what is not readable is counted when it is played."""
        demux = Demux(open_log(self.log.path).messages, source.topics)
        late = (s for t, s in self._samples(source, demux) if t >= self._shift)
        found = list(islice(late, CHECKED))
        demux.close()
        return found

    def end_reason(self, t: int) -> str:
        """Why the run ends at t [ns]: the log has nothing more to play."""
        return self.ending if self.ends_at is not None and t >= self.ends_at else ""

    def _rewind(self) -> None:
        self.close()
        self._context.notes.clear()
        self._t = self._skipped = 0
        self.ends_at: int | None = None
        self.ending = ""
        demux = self._demux = Demux(self.log.messages, self._topics)
        limit = None if self.params.gap_s is None else round(self.params.gap_s * NS)
        streams = [self._samples(source, demux) for source in self._sources]
        self._feeds = [Feed(s, shift=self._shift, gap_limit=limit) for s in streams]

    def _first(self) -> Outputs:
        """Every output at t = 0."""
        outputs: Outputs = {}
        late = round((self.params.gap_s or LATE_S) * NS)
        for source, made in zip(self._sources, self._feeds, strict=True):
            found = made.until(0)
            chosen = found[-1] if found else made.next
            where = ", ".join(source.topics)
            if chosen is None:
                raise InputError("topics", where, "expected messages in the recording", file=self.log.path)
            if found and made.next is None and self.params.start_s > 0 and self.params.end == "topic":
                expected = f"expected a start before the last message on {where}"
                raise InputError("start_s", self.params.start_s, expected)
            if chosen[0] > late:
                comes = f"near the start, it comes {chosen[0] / NS:.2f} s on"
                raise InputError(
                    "start_s", self.params.start_s, f"expected a first message on {where} {comes}"
                )
            sample = chosen[1]
            at = 0 if not found else max(sample.t, 0)
            outputs[source.port.name] = sample if sample.t == at else replace(sample, t=at)
        self._look_ahead()
        return outputs

    def _look_ahead(self) -> None:
        """When nothing comes after this step, the run ends before the next one."""
        if self.ends_at is not None:
            return
        exact = any(s.is_exact for s in self._sources)  # other messages beside exact samples may be thinned
        done = [
            s
            for s, made in zip(self._sources, self._feeds, strict=True)
            if made.next is None and s.is_exact == exact
        ]
        if self.params.end == "log":
            is_over = all(made.next is None for made in self._feeds) and self._t >= self._log_end
            done = done if is_over else []
        if done:
            self.ends_at = self._t + self._period
            last = min(made.last[0] for made in self._feeds if made.next is None and made.last is not None)
            self.ending = f"the log of {', '.join(s.port.name for s in done)} ended at {last / NS:.2f} s"

    def _samples(self, source: Source, demux: Demux) -> Iterator[Timed]:
        """The samples of an output on the clock of the log."""
        records = demux.read(*source.topics)
        records = records if source.is_exact else self._on_its_clock(records)
        if source.is_exact:
            samples = feeds.exact_samples(records)
        elif source.numbers:
            samples = self._from_numbers(source, records)
        elif self._types[source.topics[0]] == FIX and source.port.signal is MachineState:
            samples = iter(self._track(source.topics[0]))
        else:
            make = maker_for(source.port.signal, self._types[source.topics[0]], self._context)
            assert make is not None
            samples = ((t, make(message, t)) for _, t, message in records)
        if self.params.clock == "stamp" and not source.is_exact:
            samples = ((sample.t, sample) for _, sample in samples)
        if source.port.signal is MachineState and self.params.start_s > 0:
            samples = feeds.rebased(samples, self._shift)
        factors = numbers_of(source.port.name, self.params.scale)
        samples = _scaled(samples, factors) if factors and not source.numbers else samples
        lift = self._lifts.get(source.port.name)
        return samples if lift is None else ((t, lift.lifted(sample)) for t, sample in samples)

    def _on_its_clock(self, records: Iterator[Record]) -> Iterator[Record]:
        """The records; counts those whose stamp is of another clock than the log's."""
        for topic, t, message in records:
            stamp = stamp_in(message)
            if stamp is not None and not is_on_clock(stamp, t):
                self._context.note(f"stamps of {topic} are not on the clock of the log, its own time counts")
            yield topic, t, message

    def _from_numbers(self, source: Source, records: Iterator[tuple[str, int, Any]]) -> Iterator[Timed]:
        """A sample whenever one of its numbers came, once all have."""
        name = source.port.name
        known: dict[str, Any] = numbers_of(name, self.params.fixed)
        for topic, t, message in records:
            for number, (where, path) in source.numbers.items():
                if where == topic:
                    try:
                        value = number_at(message, path)
                    except (AttributeError, TypeError, ValueError):
                        expected = f"expected a number at {path!r} of {self._types[topic]}"
                        raise InputError("topics", f"{topic}:{path}", expected, file=self.log.path) from None
                    known[number] = value * self.params.scale.get(f"{name}.{number}", 1.0)
            if all(number in known for number in source.numbers):
                yield t, build(source.port.signal, stamp_of(message, t), known)

    def _track(self, topic: str) -> list[Timed]:
        if topic not in self._fixes:
            fixes = read_fixes(self._on_its_clock(self.log.messages((topic,))))
            local = to_local(self.params, self.setup.base)
            antenna = self.params.antenna_m or self._antenna_of(topic)
            self._fixes[topic] = states_of_fixes(fixes, local, antenna, self._context.wheelbase)
        return self._fixes[topic]

    def _antenna_of(self, topic: str) -> tuple[float, float, float]:
        """By /tf_static; where that does not say, below the antenna is the machine's origin."""
        found = self._static_mounting(topic)
        x, y, z = (0.0, 0.0, 0.0) if found is None else found.position.tolist()
        return x, y, z

    def _mounting(self) -> Pose | None:
        """As said here, as swath recorded it, or by /tf_static; a scanner must have one."""
        p, control = self.params, self.setup.control
        signals = {s.port.signal: s for s in self._sources}
        if p.mount is not None and p.antenna_m is not None:
            raise InputError("antenna_m", p.antenna_m, "expected mount or antenna_m, not both")
        if p.mount is not None:
            return p.mount.pose(control.machine, control.edge_side)
        if p.antenna_m is not None and Fix in signals:
            return Pose.from_euler(p.antenna_m)
        if (own := own_mounting(self.log, self.recorded)) is not None:
            return own
        source = next((signals[kind] for kind in MOUNTED if kind in signals), None)
        if source is None:
            return None
        found = None if source.is_exact else self._static_mounting(source.topics[0])
        if found is None and source.port.signal is Scan:
            expected = "expected where the sensor sits, /tf_static of the recording does not say"
            raise InputError("mount", None, expected)
        return found

    def _static_mounting(self, topic: str) -> Pose | None:
        links, first = static_links(self.log, topic)
        frame = str(getattr(getattr(first, "header", None), "frame_id", "")).lstrip("/")
        found = static_mounting(links, frame, self.setup.machine_name)
        if found is None:
            return None
        ground, pose = found
        x, y, z = pose.position
        where = f"{x:.2f}, {y:.2f}, {z:.2f} m in {ground}"
        more = "" if ground.endswith(GROUND[0]) else ", taken to lie on the ground"
        self._told.append(f"{self.setup.slot}: {frame} is at {where} by /tf_static{more}")
        return pose


def _scaled(samples: Iterator[Timed], factors: Mapping[str, float]) -> Iterator[Timed]:
    """Samples with some numbers times a factor, arrays in the type that they had."""
    for published, sample in samples:
        changed: dict[str, Any] = {}
        for name, factor in factors.items():
            value = getattr(sample, name)
            made = value * factor
            changed[name] = made.astype(value.dtype) if isinstance(made, np.ndarray) else made
        yield published, replace(sample, **changed)


LEVEL = Level(
    LogPlayer,
    Params,
    "what was recorded: run.mcap, MCAP, rosbag 1 and 2",
    cost="30 us per sample, 0.1 ms per scan",
    tolerance="from run.mcap bit for bit; from other messages as exact as these",
    is_link=True,
)
