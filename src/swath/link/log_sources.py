"""Parameters of the level `log`, and the topics of a recording that they select."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

from swath.core.component import Port
from swath.core.errors import InputError
from swath.record import positioning_messages as positioning
from swath.record.read import feed as feeds
from swath.record.read.fields import Context
from swath.record.read.files import Log
from swath.record.read.messages import maker_for, message_names
from swath.record.read.tangent_plane import TangentPlane, ToLocal, field_plane
from swath.sensing.mount import Mount
from swath.signals import Fix, MachineState, Scan, Signal
from swath.signals.flat import flat_fields
from swath.signals.setup import LinkSetup

FIX = "sensor_msgs/msg/NavSatFix"
BESIDE: dict[type[Signal], str] = {
    Scan: "_points",
    Fix: positioning.BESIDE,
}  # suffix of topics with more detail than the output's own


@dataclass(frozen=True)
class GeoOrigin:
    """Where local (0, 0, 0) lies: lat_deg, lon_deg on WGS 84, height_m above its ellipsoid."""

    lat_deg: Annotated[float, Ge(-90), Le(90)]
    lon_deg: Annotated[float, Ge(-180), Le(180)]
    height_m: Annotated[float, Ge(-1000), Le(10000)] = 0.0


@dataclass(frozen=True)
class Params:
    """file: .mcap, .bag or .db3; folder: a run folder or the folder of a rosbag 2; one of the two

    slot: machine.slot that was recorded, where it is called otherwise than here (our own recordings)
    topics: output: topic, or output.number: topic:path.in.message (other recordings)
    constants: output.number: value, for numbers that no topic has; values: the same, its older name
    scale: output.number: factor, where a message has other units than SI and radians
    start_s: where in the recording the run starts, from its first message
    clock: a sample comes out when its message was received, or at its stamp
    between: two samples the older one is held, or plain numbers are interpolated
    end: the run ends after the last sample of a topic, or holds it until the log ends
    gap_s: longer ones are reported (default: three times the usual interval)
    mount: of the sensor (default: as recorded)
    origin: of NavSatFix positions (default: the first one); field_folder: or that of a field folder
    antenna_m: x, y, z of the receiver on the machine (default: as recorded, or by /tf_static)
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
    mount: Mount | None = None
    origin: GeoOrigin | None = None
    field_folder: str | None = None
    antenna_m: tuple[float, float, float] | None = None

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


def _can_be(signal: type[Signal], msgtype: str, context: Context) -> bool:
    """Whether messages of a type can be made into samples."""
    return (msgtype == FIX and signal is MachineState) or maker_for(signal, msgtype, context) is not None


def numbers_of(port: str, given: Mapping[str, bool | float]) -> dict[str, bool | float]:
    """Those of `output.number: value` that belong to an output, by number."""
    lead = f"{port}."
    return {key.removeprefix(lead): value for key, value in given.items() if key.startswith(lead)}


def to_local(params: Params, base: Path) -> ToLocal | None:
    """From longitude and latitude to the metres of a field folder or of a plane; None: at the first fix."""
    if params.field_folder is not None:
        return field_plane(base / params.field_folder)
    o = params.origin
    return None if o is None else TangentPlane(o.lon_deg, o.lat_deg, o.height_m)
