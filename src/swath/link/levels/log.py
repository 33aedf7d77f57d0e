"""Level `log`: a slot plays what was recorded, from a run.mcap or from anybody's bag.

From our own run.mcap every sample comes back bit for bit at the moment it was published. From any other
recording, messages become samples as `record/read/messages.py` says; a sample comes out at the first step
after its message was received.

In which frame samples of somebody else's recording are is checked by what they show: gravity, and the ground.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby, islice, starmap
from math import cos, hypot, isfinite, nan
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.abilities import LOG_OVER, Ending
from swath.core.component import Inputs, Outputs, Port, State
from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.portable import product
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import DEG
from swath.documents.witness import Pair, judge
from swath.record import positioning_messages as positioning
from swath.record.message_factory import OPTICAL_FRAME
from swath.record.read import feed as feeds
from swath.record.read.channel_log import KIND as CHANNEL
from swath.record.read.feed import Demux, Feed, Record, Timed
from swath.record.read.fields import Context, number_at
from swath.record.read.files import Log, open_log
from swath.record.read.fixes import TangentPlane, ToLocal, field_plane, read_fixes, states_of_fixes
from swath.record.read.frames import GROUND, Links, frame_of, own_mounting, static_links, static_mounting
from swath.record.read.leaps import Leaps
from swath.record.read.messages import maker_for, message_names
from swath.sensing.mount import Mount
from swath.signals import F64, Fix, Image, Inertial, MachineState, Odometry, Scan, Signal
from swath.signals.flat import build, flat_fields
from swath.signals.radar import RadarTargets
from swath.signals.setup import LinkSetup

GRAVITY = 9.81  # m/s2
NEAR_GRAVITY = 0.15  # of it, by which a mean force may be off: bias, scale, braking
UPRIGHT_DEG = 45.0  # no machine at work leans as far
DATUM_M = 0.5  # heights that differ by less from the terrain's differ by their errors
CONSTANT_M = 1.0  # from the 5th to the 95th percentile: what differs by more is no other datum
LOOKED = 30_000  # samples of a recording in which turns are looked for: 5 minutes of 100 Hz
TURN_S, LEAST_TURN = (
    2.0,
    10.0 * DEG,
)  # windows in which turns are compared [s], and of them all, at least [rad]
TURNS_ALIKE = 0.1, 0.5  # share by which turns may differ: noted, refused
TURNS_SEEN = 0.9  # correlation of turns that are the same, in another unit
FASTEST_TURN = 1.5  # of a machine at work [rad/s]
UNKNOWN_SD_M = 3.5  # of the height of a receiver without corrections (docs/explanation/sensors.md)
# Where the force of an upright machine points in the unit's axes -> what turns them to forward, left, up.
LIKELY = {
    (2, 1): "z up, but turned by `mount` or /tf_static: `mount: {at: axle, pitch_deg: 0}`",
    (2, -1): "z down, as in NED or forward, right, down: `mount: {at: axle, roll_deg: 180, pitch_deg: 0}`",
    (0, 1): "x up: `mount: {at: axle, pitch_deg: -90}`",
    (0, -1): "x down: `mount: {at: axle, pitch_deg: 90}`",
    (1, 1): "y up: `mount: {at: axle, roll_deg: 90, pitch_deg: 0}`",
    (1, -1): "y down: `mount: {at: axle, roll_deg: -90, pitch_deg: 0}`",
}


def check_gravity(key: str, samples: Iterable[Signal], rotation: F64 | None) -> None:
    """InputError where the mean specific force is none of a machine that stands upright.

    key: for the message; rotation: of pose_machine_sensor, (3, 3), None = the axes are the machine's. An
    inertial unit measures the force that carries it, upward: +9.81 in z of x forward, y left, z up (REP 145).
    """
    rows = [(s.force_x, s.force_y, s.force_z) for s in samples if isinstance(s, Inertial)]
    known = np.array([row for row in rows if np.isfinite(row).all()])
    if len(known) == 0:
        return
    own = known.mean(axis=0)
    force = own if rotation is None else product(rotation, own)
    size = hypot(*force)
    seen = "{:.2f}, {:.2f}, {:.2f}".format(*force)
    if abs(size - GRAVITY) > NEAR_GRAVITY * GRAVITY:
        raise InputError(f"{key}.force", seen, f"expected {GRAVITY} m/s2 upward in the mean; {_unit(size)}")
    if force[2] >= cos(UPRIGHT_DEG * DEG) * size:
        return
    axis = int(np.argmax(np.abs(own)))
    likely = LIKELY[axis, 1 if own[axis] > 0 else -1]
    if abs(own[axis]) < cos(UPRIGHT_DEG * DEG) * size:
        likely = "aslant: `mount` says how it sits"
    raise InputError(
        f"{key}.force", seen, f"expected +{GRAVITY} in z (x forward, y left, z up); it is {likely}"
    )


def _unit(size: float) -> str:
    if abs(size - 1.0) < NEAR_GRAVITY:
        return "it is in g: `scale: {inertial.force_x: 9.81, inertial.force_y: 9.81, inertial.force_z: 9.81}`"
    return "gravity is left out of it" if size < 1.0 else "it is in another unit: `scale`"


def turning(samples: Sequence[Inertial], track: Sequence[MachineState], rotation: F64 | None) -> Pair:
    """The turns that an inertial unit measured against those of a track, over windows of TURN_S; of a unit
    without a track, against what machines do.

    rotation: of pose_machine_sensor, (3, 3), None = the axes are the machine's
    """
    key, scale = "inertial.rate_z", ", ".join(f"inertial.rate_{n}: {DEG:.6f}" for n in "xyz")
    table = np.array([(s.t / NS, s.rate_x, s.rate_y, s.rate_z) for s in samples]).reshape(-1, 4)
    table = table[np.isfinite(table).all(axis=1)]
    driven = np.array([(s.t / NS, s.pose.euler()[2]) for s in track]).reshape(-1, 2)
    both = [rows[:, 0] for rows in (table, driven) if len(rows)]
    at = np.arange(max(t[0] for t in both), min(t[-1] for t in both), TURN_S) if len(table) else np.zeros(0)
    if len(at) < 3:
        return Pair(key, "", nan, nan)
    rate = product(table[:, 1:], np.array([0.0, 0.0, 1.0]) if rotation is None else rotation[2])
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(table[:, 0]))])
    seen = np.diff(np.interp(at, table[:, 0], angle))
    if not len(driven):
        fastest = float(np.abs(seen).max()) / TURN_S
        entry = f"no machine turns so: in deg/s, `scale: {{{scale}}}`"
        return Pair(key, f"turns of {fastest:.2f} rad/s", fastest, FASTEST_TURN, FASTEST_TURN, entry)
    true = np.diff(np.interp(at, driven[:, 0], np.unwrap(driven[:, 1])))
    a, b = seen - seen.mean(), true - true.mean()
    alike = float(product(a, b)) / max(float(np.hypot.reduce(a) * np.hypot.reduce(b)), 1e-300)
    if np.hypot.reduce(true) < LEAST_TURN or alike < TURNS_SEEN:
        return Pair(key, "", nan, nan)
    factor = float(product(seen, true) / product(true, true))
    is_degrees = abs(factor * DEG - 1.0) < TURNS_ALIKE[1]
    entry = f"in deg/s: `scale: {{{scale}}}`" if is_degrees else "`scale`, or `mount`"
    shown = f"turns are {factor:.3g} times those of the positions"
    return Pair(key, shown, abs(factor - 1.0), *TURNS_ALIKE, entry)


@dataclass(frozen=True)
class Lift:
    """How heights lie against the terrain. above: in the mean [m]; low, high: 5th and 95th percentile.

    ground: height of the terrain at x, y
    """

    above: float
    low: float
    high: float
    ground: Callable[[F64, F64], F64]

    @property
    def is_constant(self) -> bool:
        """Whether another zero of heights explains it."""
        return self.high - self.low <= CONSTANT_M

    def note(self, *, is_mended: bool) -> str:
        """What the user should know; is_mended: samples are put where they belong by `lifted`."""
        side = "above" if self.above > 0 else "below"
        far = f"{abs(self.above):.1f} m {side} the terrain ({self.low:.1f} to {self.high:.1f})"
        note = f"heights: the track lies {far}"
        if self.is_constant:
            done = "; taken off" if is_mended else ""
            return f"{note}: another datum of heights (ellipsoid, geoid), or the antenna's height{done}"
        done = "; put on the terrain" if is_mended else ""
        return f"{note}: it was not recorded on this terrain{done}"

    def lifted(self, sample: Signal) -> Signal:
        """A MachineState on the terrain."""
        if not isinstance(sample, MachineState):
            return sample
        x, y, z = sample.pose.position
        z = z - self.above if self.is_constant else self.ground(np.array([x]), np.array([y]))[0]
        return replace(sample, pose=Pose(np.array([x, y, z]), sample.pose.rotation))


def lift_of(
    samples: Iterable[Signal], ground: Callable[[F64, F64], F64], antenna: float = 0.0
) -> Lift | None:
    """How a track lies over the terrain; None where it lies on it, as far as its errors let that be seen.

    antenna: height above ground of what fixes are of [m]
    """
    rows = [row for s in samples if np.isfinite(row := _place(s, antenna)).all()]
    if not rows:
        return None
    x, y, z, sd = np.array(rows).T
    low, middle, high = (float(v) for v in np.percentile(z - ground(x, y), (5, 50, 95)))
    slack = 4.0 * float(np.median(sd))
    if abs(middle) <= DATUM_M + slack and high - low <= CONSTANT_M + 2.0 * slack:
        return None
    return Lift(middle, low, high, ground)


def _place(sample: Signal, antenna: float) -> tuple[float, float, float, float]:
    """x, y, z on the ground and sd of the height [m]; nan where there is none."""
    if isinstance(sample, Fix):
        sd = sample.vertical_sd if isfinite(sample.vertical_sd) else UNKNOWN_SD_M
        return sample.x, sample.y, sample.z - antenna, sd
    if isinstance(sample, MachineState):
        x, y, z = (float(v) for v in sample.pose.position)
        return x, y, z, 0.0
    return nan, nan, nan, nan


FIX = "sensor_msgs/msg/NavSatFix"
BESIDE: dict[type[Signal], str] = {
    Scan: "_points",
    Fix: positioning.BESIDE,
}  # suffix of topics with more detail than the output's own


@dataclass(frozen=True)
class GeoOrigin:
    """Where local (0, 0, 0) lies, on WGS 84.

    lat_deg: to the north
    lon_deg: to the east
    height_m: above the ellipsoid
    """

    lat_deg: Annotated[float, Ge(-90), Le(90)]
    lon_deg: Annotated[float, Ge(-180), Le(180)]
    height_m: Annotated[float, Ge(-1000), Le(10000)] = 0.0


@dataclass(frozen=True)
class Params:
    """file: .mcap, .bag, .db3, .mf4, .blf or .asc; folder: of a run or of a rosbag 2; one of the two.

    slot: machine.slot that was recorded, where it is called otherwise than here (our own recordings)
    topics: output: topic, or output.number: topic:path.in.message (other recordings)
    constants: output.number: value, for numbers that no topic has
    values: the same, its older name
    scale: output.number: factor, where a message has other units than SI and radians, after the known unit of
        a channel
    start_s: where in the recording the run starts, from its first message
    clock: a sample comes out when its message was received, or at its stamp
    between: two samples the older one is held, or plain numbers are interpolated
    end: the run ends after the last sample of a topic, or holds it until the log ends
    gap_s: longer ones are reported (default: three times the usual interval)
    frame: that of the messages to play, where a topic has several (default: that of the first)
    mount: of the sensor (default: as recorded)
    origin: of NavSatFix positions (default: the first one)
    field_folder: or that of a field folder
    antenna_m: x, y, z of the receiver on the machine (default: as recorded, or by /tf_static)
    overlap_m: how far a recorded steering law held the header end out over the cut ground
    """

    file: str | None = None
    folder: str | None = None
    slot: str | None = None
    topics: dict[str, str] = field(default_factory=dict)
    constants: dict[str, bool | float] = field(default_factory=dict)
    values: dict[str, bool | float] = field(default_factory=dict)
    scale: dict[str, float] = field(default_factory=dict)
    start_s: Annotated[float, Ge(0), Le(1e7)] = 0.0
    clock: Literal["received", "stamp"] = "received"
    between: Literal["hold", "interpolate"] = "hold"
    end: Literal["topic", "log"] = "topic"
    gap_s: Annotated[float, Gt(0), Le(1e6)] | None = None
    frame: str | None = None
    mount: Mount | None = None
    origin: GeoOrigin | None = None
    field_folder: str | None = None
    antenna_m: tuple[float, float, float] | None = None
    overlap_m: Annotated[float, Ge(-1), Le(3)] = 0.0

    @property
    def fixed(self) -> dict[str, bool | float]:
        """`constants`, under either name."""
        return {**self.values, **self.constants}


@dataclass(frozen=True)
class Source:
    """Where an output comes from. topics: one, or those of its numbers; numbers: name -> (topic, path)."""

    port: Port
    topics: tuple[str, ...]
    is_exact: bool = False
    numbers: Mapping[str, tuple[str, str]] = field(default_factory=dict)


def recording_path(params: Params, base: Path) -> Path:
    """The recording. InputError unless there is exactly one of file and folder."""
    given = [text for text in (params.file, params.folder) if text is not None]
    if len(given) != 1:
        raise InputError("file", params.file, "expected either file or folder")
    return base / given[0]


def choose_sources(
    params: Params, setup: LinkSetup, log: Log, types: Mapping[str, str], recorded: str
) -> list[Source]:
    """What the outputs come from. InputError where the recording has nothing for them."""
    if params.topics:
        return _mapped(params, setup, types)
    found: list[Source] = []
    ports = {p.name: p for p in setup.outputs}
    context = Context(setup.control.machine.wheelbase)
    outputs = feeds.own_outputs(log, recorded)
    for name, is_exact in outputs.items():
        if is_exact:
            port = ports.get(name) or feeds.exact_port(log, recorded, name)
            found.append(Source(port, (feeds.exact_topic(recorded, name),), is_exact=True))
    for name, port in ports.items():
        near = [n for n in (name + BESIDE.get(port.signal, ""), name) if n in outputs]
        if near and not outputs.get(name):
            topic = f"/{recorded.replace('.', '/')}/{near[0]}"
            if maker_for(port.signal, types[topic], context) is not None:
                found.append(Source(port, (topic,)))
    if not found:
        fitting = sorted(
            types, key=lambda t: not any(_can_be(p.signal, types[t], context) for p in ports.values())
        )
        listed = ", ".join(f"{t} ({types[t].rpartition('/')[2]})" for t in fitting) or "nothing"
        expected = f"expected topics for {', '.join(ports)}, the recording has no {recorded}; it has {listed}"
        raise InputError("topics", None, expected, file=log.path)
    return found


def _mapped(params: Params, setup: LinkSetup, types: Mapping[str, str]) -> list[Source]:
    """The outputs that `topics` names, in the slot's order."""
    ports = {p.name: p for p in setup.outputs}
    context = Context(setup.control.machine.wheelbase)
    whole: dict[str, str] = {}
    numbers: dict[str, dict[str, tuple[str, str]]] = {}
    for key in (*params.topics, *params.fixed):
        name, _, number = key.partition(".")
        if name not in ports:
            raise InputError("topics", key, f"expected output or output.number; outputs: {', '.join(ports)}")
        if number and number not in flat_fields(ports[name].signal):
            listed = ", ".join(flat_fields(ports[name].signal))
            raise InputError("topics", key, f"expected one of {listed} after {name}.")
    for key, text in params.topics.items():
        topic, _, path = text.partition(":")
        name, _, number = key.partition(".")
        if topic not in types:
            signal = ports[name].signal
            fitting = sorted(types, key=lambda t: not _can_be(signal, types[t], context))
            raise InputError("topics", topic, f"expected one of {', '.join(fitting) or 'none'}")
        if number:
            _check_unit(key, topic, types[topic], flat_fields(ports[name].signal)[number].unit, params)
            numbers.setdefault(name, {})[number] = (topic, path or "data")
        else:
            signal = ports[name].signal
            if not _can_be(signal, types[topic], context):
                expected = (
                    f"expected a topic of {', '.join(message_names(signal))}, or {name}.NUMBER: TOPIC:PATH"
                )
                raise InputError("topics", f"{topic} ({types[topic]})", expected)
            whole[name] = topic
    if both := sorted(set(whole) & set(numbers)):
        raise InputError("topics", both[0], "expected a topic for the output or for its numbers, not both")
    for name, given in numbers.items():
        fixed = numbers_of(name, params.fixed)
        lacking = [
            f.name
            for f in flat_fields(ports[name].signal).values()
            if f.default is None and f.name not in given and f.name not in fixed
        ]
        if lacking:
            raise InputError("topics", name, f"expected topics or constants for {', '.join(lacking)} too")
    made = {n: Source(ports[n], (t,)) for n, t in whole.items()}
    made |= {
        n: Source(ports[n], tuple(dict.fromkeys(t for t, _ in given.values())), numbers=given)
        for n, given in numbers.items()
    }
    return [made[name] for name in ports if name in made]


def _check_unit(key: str, topic: str, kind: str, unit: str, params: Params) -> None:
    """InputError where a channel measures something else, or neither it nor `scale` says what."""
    said = kind.removeprefix(CHANNEL)
    if said == kind or key in params.scale or (said or "1") == (unit or "1"):
        return
    expected = f"expected a channel in {unit or '1'}, or what is turned into it by `scale: {{{key}: FACTOR}}`"
    raise InputError("topics", f"{topic} in {said or 'no unit'}", expected, file=params.file)


def _can_be(signal: type[Signal], msgtype: str, context: Context) -> bool:
    """Whether messages of a type can be made into samples."""
    return (msgtype == FIX and signal is MachineState) or maker_for(signal, msgtype, context) is not None


def numbers_of(port: str, given: Mapping[str, bool | float]) -> dict[str, bool | float]:
    """The values of `output.number: value` that belong to an output, by number."""
    lead = f"{port}."
    return {key.removeprefix(lead): value for key, value in given.items() if key.startswith(lead)}


def to_local(params: Params, base: Path) -> ToLocal | None:
    """Metres of longitude and latitude: of a field folder or a plane; None: a plane at the first fix."""
    if params.field_folder is not None:
        return field_plane(base / params.field_folder)
    o = params.origin
    return None if o is None else TangentPlane(o.lon_deg, o.lat_deg, o.height_m)


MOUNTED = (Scan, RadarTargets, Image, Fix, Inertial)  # samples of sensors whose place control knows
FRAMED = (*MOUNTED, MachineState, Odometry)  # of these a frame says of which sensor, or machine, they are
CHECKED = 3000  # samples of a signal that say in which frame it is
LATE_S = 1.0  # the first sample may come this much after the start [s]


class LogPlayer:
    """Plays the outputs of a slot.

    mounting: pose_machine_sensor, where it is known; optical: pose of a recorded camera's optical frame
    ends_at: the time [ns] from which on there is nothing to play, None while there is; ending: says so
    notes: what the user should know
    overlap: of the header end, where a steering law is played [m]
    """

    inputs: tuple[Port, ...] = ()

    def __init__(self, params: Params, setup: LinkSetup) -> None:
        self.params, self.setup, self.overlap = params, setup, params.overlap_m
        self.log: Log = open_log(recording_path(params, setup.base))
        self.recorded = params.slot or setup.name
        self._types = self.log.topics()
        self._sources = choose_sources(params, setup, self.log, self._types, self.recorded)
        self.outputs = tuple(s.port for s in self._sources)
        self._shift = self.log.begin() if any(not s.is_exact for s in self._sources) else 0
        self._shift += round(params.start_s * NS)
        self._period = round(setup.control.period * NS)
        local, machine = to_local(params, setup.base), setup.machine_name
        self._links, self._frame = self._tree()
        self._context = Context(setup.control.machine.wheelbase, local, self._links, machine)
        self._fixes: dict[str, list[Timed]] = {}
        self._leaps: dict[str, Leaps] = {}
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
        played = self.recorded if self._is_own else ", ".join(self._topics)
        found = [f"{name}: form: plays {played} of {self.log.path}", *self._told]
        if self._is_own and not all(s.is_exact for s in self._sources):
            rounded = ", ".join(s.port.name for s in self._sources if not s.is_exact)
            found.append(f"{name}: form: {rounded} from standard messages, which round and leave out")
        if p.values:
            found.append(f"{name}: form: `values` is now `constants`, as in level fmu")
        if p.between == "interpolate":
            found.append(f"{name}: derived: interpolated between recorded samples")
        if self._skipped:
            found.append(
                f"{name}: unused: {self._skipped} samples came faster than rate_hz and were left out"
            )
        for source, made in zip(self._sources, self._feeds, strict=True):
            if made.gaps:
                begin, length = max(made.gaps, key=lambda g: g[1])
                longest = f"the longest {length / NS:.2f} s at {begin / NS:.2f} s"
                found.append(f"{name}.{source.port.name}: lost: {len(made.gaps)} gaps in the log, {longest}")
            if made.unordered_count:
                text = f"timeline: {made.unordered_count} samples out of order were left out"
                found.append(f"{name}.{source.port.name}: {text}")
        noted = {**self._context.notes, **self.log.notes}
        for leaps in self._leaps.values():
            noted |= leaps.notes
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

    def _tree(self) -> tuple[Links, str]:
        """/tf_static of somebody else's recording, and the frame of the messages that are played."""
        others = [s for s in self._sources if not s.is_exact]
        if not others:
            return {}, ""
        source = next((s for s in others if s.port.signal in MOUNTED), others[0])
        links, first = static_links(self.log, source.topics[0])
        return links, self.params.frame or frame_of(first)

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
        lie. InputError where that cannot be.
        """
        for source in self._sources:
            kind, name = source.port.signal, source.port.name
            if kind is Inertial and not source.is_exact:
                turn = None if self.mounting is None else self.mounting.rotation
                check_gravity(name, self._some(source), turn)
                pair = turning(self._some(source, LOOKED), self._track_beside(), turn)
                self._told += [f"{self.setup.slot}: {note}" for note in judge([pair])]
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

    def _track_beside(self) -> list[Any]:
        """How the machine turned by what else is in the recording: poses, else positions."""
        kinds = ("Odometry", "PoseStamped", "PoseWithCovarianceStamped", "NavSatFix")
        found = [
            (kinds.index(k), t) for t, of in self._types.items() if (k := of.rpartition("/")[2]) in kinds
        ]
        try:
            return self._some(Source(Port("state", MachineState), (min(found)[1],)), LOOKED) if found else []
        except InputError:  # a machine that stands has no course
            return []

    def _some(self, source: Source, most: int = CHECKED) -> list[Any]:
        """The first samples from where the run starts; what is not readable is counted when it is played."""
        demux = Demux(open_log(self.log.path).messages, source.topics)
        late = (s for t, s in self._samples(source, demux) if t >= self._shift)
        found = list(islice(late, most))
        demux.close()
        return found

    def end_reason(self, t: int) -> str:
        """Why the run ends at t [ns]: the log has nothing more to play."""
        return (
            self.ending if self.ends_at is not None and t + 1 >= self.ends_at else ""
        )  # a step may be 1 ns short

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
                of = f" of frame {self.params.frame}" if self.params.frame else ""
                expected = f"expected messages{of} in the recording"
                raise InputError("topics", where, expected, file=self.log.path)
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
            said = f"the log of {', '.join(s.port.name for s in done)} ended at {last / NS:.2f} s"
            self.ending = Ending(said, LOG_OVER)

    def _samples(self, source: Source, demux: Demux) -> Iterator[Timed]:
        """The samples of an output on the clock of the log."""
        records, context = demux.read(*source.topics), self._context.again()
        if source.is_exact:
            samples = feeds.exact_samples(records)
        elif source.numbers:
            samples = self._from_numbers(source, records, context)
        elif self._types[source.topics[0]] == FIX and source.port.signal is MachineState:
            samples = iter(self._track(source.topics[0], context))
        else:
            make = maker_for(source.port.signal, self._types[source.topics[0]], context)
            assert make is not None
            records = self._of_one_frame(records) if source.port.signal in FRAMED else records
            made = ((t, make(message, t)) for _, t, message in records)
            samples = ((t, sample) for t, sample in made if sample is not None)
        if not source.is_exact and (source.port.signal is Fix or self._types[source.topics[0]] == FIX):
            leaps = self._leaps[source.port.name] = Leaps()
            samples = starmap(leaps.take, samples)
        if self.params.clock == "stamp" and not source.is_exact:
            samples = ((sample.t, sample) for _, sample in samples)
        if source.port.signal is MachineState and self.params.start_s > 0:
            samples = feeds.rebased(samples, self._shift)
        factors = numbers_of(source.port.name, self.params.scale)
        samples = _scaled(samples, factors) if factors and not source.numbers else samples
        lift = self._lifts.get(source.port.name)
        return samples if lift is None else ((t, lift.lifted(sample)) for t, sample in samples)

    def _of_one_frame(self, records: Iterator[Record]) -> Iterator[Record]:
        """The records of one frame: several sensors may write on one topic, and several machines."""
        frame = self.params.frame
        for topic, t, message in records:
            own = frame_of(message, own=True) or frame_of(message)
            frame = frame or own
            if own in ("", frame):
                yield topic, t, message
            else:
                note = (
                    f"sources: messages of {own} on {topic} left out beside those of {frame}: `frame: {own}`"
                )
                self._context.note(f"{note} plays them")

    def _from_numbers(self, source: Source, records: Iterator[Record], context: Context) -> Iterator[Timed]:
        """A sample whenever some of its numbers came, once all have."""
        name = source.port.name
        known: dict[str, Any] = numbers_of(name, self.params.fixed)
        for t, records_of_t in groupby(records, key=lambda record: record[1]):
            for topic, _, message in records_of_t:
                for number in [n for n, (where, _) in source.numbers.items() if where == topic]:
                    path = source.numbers[number][1]
                    try:
                        value = number_at(message, path)
                    except (AttributeError, TypeError, ValueError):
                        expected = f"expected a number at {path!r} of {self._types[topic]}"
                        raise InputError("topics", f"{topic}:{path}", expected, file=self.log.path) from None
                    known[number] = value * self.params.scale.get(f"{name}.{number}", 1.0)
            if all(number in known for number in source.numbers):
                yield t, build(source.port.signal, context.stamp(message, t), known)

    def _track(self, topic: str, context: Context) -> list[Timed]:
        if topic not in self._fixes:
            fixes = read_fixes(self._of_one_frame(self.log.messages((topic,))), context)
            local = to_local(self.params, self.setup.base)
            is_played = any(topic in source.topics for source in self._sources)
            antenna = self.params.antenna_m or (self._antenna_of(topic) if is_played else (0.0, 0.0, 0.0))
            self._fixes[topic] = states_of_fixes(fixes, local, antenna, self._context.wheelbase)
        return self._fixes[topic]

    def _antenna_of(self, topic: str) -> tuple[float, float, float]:
        """Place of an antenna by /tf_static; where that does not say, the machine's origin lies below it."""
        found = self._static_mounting()
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
        found = None if source.is_exact else self._static_mounting()
        if found is None and source.port.signal is Scan:
            expected = "expected where the sensor sits, /tf_static of the recording does not say"
            raise InputError("mount", None, expected)
        return found

    def _static_mounting(self) -> Pose | None:
        frame = self._frame
        found = static_mounting(self._links, frame, self.setup.machine_name)
        if found is None:
            return None
        ground, pose = found
        x, y, z = pose.position
        where = f"{x:.2f}, {y:.2f}, {z:.2f} m in {ground}"
        more = "" if ground.endswith(GROUND[0]) else ", taken to lie on the ground"
        self._told.append(f"{self.setup.slot}: derived: {frame} is at {where} by /tf_static{more}")
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
    "what was recorded: run.mcap, MCAP, rosbag 1 and 2, MF4, BLF, ASC",
    cost="30 us per sample, 0.1 ms per scan",
    tolerance="from run.mcap bit for bit; from other messages as exact as these",
    is_link=True,
)
