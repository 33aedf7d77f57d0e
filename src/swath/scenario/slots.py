"""The slots that a machine may have: which packages hold their levels, how often they run, what feeds them.

The order here is the order within one tick. A slot of a machine is an instance of a kind: `lidar`, or, where
a machine has several, `lidar_left` and `lidar_right`. Each kind lists wires by the name of the input port. A
level takes the wires to ports that it has; one to an optional port is left out where the level at the other
end does not send it. A scenario's `wires:` override them. Which slots a machine has unasked:
`machine_types.py`.

`CATALOGUE` is what a scenario may choose from: the levels of every slot, and the parts of a field.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from swath.core.component import Port
from swath.core.errors import InputError
from swath.core.estimate import band_of
from swath.core.registry import Registry
from swath.scenario.machine_types import MACHINE_TYPES, ORGANS
from swath.signals import (
    BoxSeen,
    CropAhead,
    CropEdge,
    CropFlow,
    CropStream,
    EngineState,
    FeedReading,
    FieldMap,
    Fix,
    GrainImage,
    GroundSpeed,
    GuidanceState,
    HeaderState,
    HeapState,
    Image,
    ImageBoxes,
    ImageShares,
    Inertial,
    LossReading,
    MachineLoad,
    MachineState,
    Objects,
    Odometry,
    OrganLoads,
    OrganSettings,
    OrganWork,
    PeerState,
    PoseEstimate,
    ReturnsReading,
    Scan,
    ScanTruth,
    SpeedCommand,
    Station,
    SteerCommand,
    SteerState,
    TrailerState,
    UnloadCommand,
    UnloadState,
    WheelState,
    WindowState,
    YieldReading,
)
from swath.signals.radar import RadarTargets


@dataclass(frozen=True)
class SlotKind:
    """One kind of slot.

    packages: where its levels lie
    level: the default one
    rate_hz: the default rate
    outputs: output ports that every level of it has
    more: output ports that some of its levels have
    wires: input port -> (slot kind, output port) of the same machine
    asked: ports of wires that only a part gets which declares them, or where a scenario's wires name them
    is_control: knows the geometry of the machine, never the truth
    is_plural: a machine may have several of it, each named `kind_something`
    is_exchangeable: its level may change while a run goes on, it keeps nothing of motion and masses
    link_adapter: `module:Class` that completes a part from elsewhere (FMU, ROS 2 node, log) in this slot
    """

    name: str
    packages: tuple[str, ...]
    level: str
    rate_hz: float
    outputs: tuple[Port, ...]
    wires: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    more: tuple[Port, ...] = ()
    asked: tuple[str, ...] = ()
    is_control: bool = False
    is_plural: bool = False
    is_exchangeable: bool = False
    link_adapter: str = ""


_STATE = {"state": ("motion", "state")}
_ODOMETRY = {"odometry": ("odometry", "odometry")}
PEER = "peer:"  # before a kind in `wires`: of the machine that the key `peer` names
_BOX = {f"peer_{n}": (PEER + k, n) for k, n in (("motion", "state"), ("motion", "trailer"), ("heap", "heap"))}
_OTHERS = {f"other_{i}": (f"peer_link_{i}", "peer") for i in (1, 2, 3, 4)}  # links to more machines

_sensor = partial(SlotKind, is_plural=True, is_exchangeable=True)
_of_control = partial(_sensor, is_control=True)


def _organ(name: str, level: str, streams: tuple[str, ...], wires: Mapping[str, tuple[str, str]]) -> SlotKind:
    """A slot in the way of the crop through a combine."""
    return SlotKind(
        name,
        (f"swath.machine.{name}",),
        level,
        10.0,
        (*(Port(stream, CropStream) for stream in streams), Port("work", OrganWork)),
        {**wires, "engine": ("powertrain", "engine"), "settings": ("settings", "settings")},
        more=(Port("actual", OrganSettings),),
        link_adapter=f"swath.machine.organ:linked_{name}",
    )


SLOTS: tuple[SlotKind, ...] = (
    SlotKind(
        "motion",
        ("swath.machine.motion",),
        "single_track",
        200.0,
        (Port("state", MachineState),),
        {
            "steering": ("steering", "steering"),
            "speed": ("speed", "command"),
            "drive": ("powertrain", "engine"),
            "load": ("process", "load"),
            "header": ("header", "height"),
            "cargo": ("heap", "heap"),
        },
        more=(Port("trailer", TrailerState), Port("wheels", WheelState)),
    ),
    SlotKind(
        "header",
        ("swath.machine.header",),
        "fixed_height",
        50.0,
        (Port("flow", CropFlow),),
        _STATE,
        more=(Port("height", HeaderState),),
    ),
    _organ("returns", "model", ("back",), {"fed": ("cleaning", "returned")}),
    _organ("feeder", "model", ("fed",), {"flow": ("header", "flow")}),
    _organ(
        "threshing", "model", ("over", "through"), {"fed": ("feeder", "fed"), "back": ("returns", "back")}
    ),
    _organ(
        "separation",
        "model",
        ("over", "through"),
        {"fed": ("threshing", "over"), "drum": ("threshing", "work"), **_STATE},
    ),
    _organ(
        "cleaning",
        "model",
        ("clean", "returned", "over"),
        {"pan": ("threshing", "through"), "more": ("separation", "through"), **_STATE},
    ),
    SlotKind(
        "process",
        ("swath.machine.process",),
        "constant",
        10.0,
        (Port("load", MachineLoad),),
        {
            **_STATE,
            "flow": ("header", "flow"),
            "engine": ("powertrain", "engine"),
            "unload": ("unload", "unload"),
            "straw": ("separation", "over"),
            "chaff": ("cleaning", "over"),
            "clean": ("cleaning", "clean"),
            "returned": ("cleaning", "returned"),
            **{organ: (organ, "work") for organ in ORGANS},
        },
        more=(Port("organs", OrganLoads),),
        link_adapter="swath.machine.process.straw_laying:LaidStraw",
    ),
    SlotKind(
        "unload",
        ("swath.machine.unload",),
        "auger",
        20.0,
        (Port("unload", UnloadState),),
        {**_STATE, "load": ("process", "load"), "command": ("cooperate", "command")},
    ),
    SlotKind(
        "heap",
        ("swath.machine.heap",),
        "height_map",
        5.0,
        (Port("heap", HeapState),),
        {"trailer": ("motion", "trailer")},
    ),
    SlotKind("dust", ("swath.machine.dust",), "plume", 10.0, (), {**_STATE, "flow": ("header", "flow")}),
    SlotKind(
        "powertrain",
        ("swath.machine.powertrain",),
        "hydrostat",
        20.0,
        (Port("engine", EngineState),),
        {**_STATE, "load": ("process", "load"), "organs": ("process", "organs")},
    ),
    _sensor(
        "crop_flow",
        ("swath.sensing.crop_flow",),
        "delayed",
        10.0,
        (Port("feed", FeedReading), Port("grain", YieldReading), Port("loss", LossReading)),
        {"load": ("process", "load"), "organs": ("process", "organs")},
        more=(Port("returns", ReturnsReading), Port("quality", GrainImage)),
    ),
    _sensor(
        "lidar",
        ("swath.sensing.lidar",),
        "plants",
        25.0,
        (Port("scan", Scan, unit="m", shape=(None,)), Port("truth", ScanTruth)),
        _STATE,
        more=(Port("window", WindowState),),
    ),
    _sensor(
        "camera",
        ("swath.sensing.camera",),
        "rays",
        5.0,
        (Port("image", Image),),
        _STATE,
        more=(Port("boxes", ImageBoxes), Port("shares", ImageShares)),
    ),
    _sensor(
        "odometry",
        ("swath.sensing.odometry",),
        "error",
        50.0,
        (Port("odometry", Odometry),),
        {**_STATE, "steering": ("steering", "steering"), "wheels": ("motion", "wheels")},
    ),
    _sensor(
        "ground_speed", ("swath.sensing.ground_speed",), "radar", 10.0, (Port("speed", GroundSpeed),), _STATE
    ),
    _sensor("radar", ("swath.sensing.radar",), "error", 20.0, (Port("targets", RadarTargets),), _STATE),
    _sensor("gnss", ("swath.sensing.gnss",), "error", 10.0, (Port("fix", Fix),), _STATE),
    _sensor(
        "imu",
        ("swath.sensing.imu",),
        "error",
        100.0,
        (Port("inertial", Inertial),),
        {**_STATE, "engine": ("powertrain", "engine")},
    ),
    _of_control(
        "pose",
        ("swath.control.pose",),
        "raw",
        50.0,
        (Port("pose", PoseEstimate),),
        {"fix": ("gnss", "fix"), "odometry": ("odometry", "odometry"), "inertial": ("imu", "inertial")},
    ),
    SlotKind(
        "peer_link",
        ("swath.sensing.peer_link",),
        "ideal",
        10.0,
        (Port("peer", PeerState),),
        {
            **_STATE,
            **_BOX,
            "peer_load": (PEER + "process", "load"),
            "peer_unload": (PEER + "unload", "unload"),
            "peer_station": (PEER + "cooperate", "station"),
        },
        is_plural=True,
        is_exchangeable=True,
    ),
    _sensor(
        "field_map",
        ("swath.sensing.field_map",),
        "error",
        5.0,
        (Port("map", FieldMap),),
        {
            **_STATE,
            "fix": ("gnss", "fix"),
            "passed": ("gnss", "fix"),
            "odometry": ("odometry", "odometry"),
            "grain": ("crop_flow", "grain"),
        },
    ),
    _of_control(
        "scan_filter",
        ("swath.control.scan_filter",),
        "peer_body",
        25.0,
        (Port("scan", Scan, unit="m", shape=(None,)),),
        {"scan": ("lidar", "scan"), "peer": ("peer_link", "peer"), **_ODOMETRY, **_OTHERS},
    ),
    _of_control(
        "edge",
        ("swath.control.edge", "swath.sensing.edge"),
        "likelihood_ratio",
        25.0,
        (Port("edge", CropEdge),),
        {
            **_STATE,
            "scan": ("lidar", "scan"),
            "image": ("camera", "image"),
            "odometry": ("odometry", "odometry"),
            "flow": ("header", "flow"),
            "inertial": ("imu", "inertial"),
        },
        asked=("image",),
    ),
    _of_control(
        "objects",
        ("swath.control.objects", "swath.sensing.objects"),
        "cluster",
        10.0,
        (Port("objects", Objects),),
        {
            **_STATE,
            "scan": ("lidar", "scan"),
            "image": ("camera", "image"),
            "targets": ("radar", "targets"),
            "odometry": ("odometry", "odometry"),
            "edge": ("edge", "edge"),
        },
        asked=("image",),
    ),
    _of_control(
        "ahead",
        ("swath.control.ahead",),
        "penetration",
        5.0,
        (Port("ahead", CropAhead),),
        {"scan": ("lidar", "scan")},
    ),
    _of_control(
        "box",
        ("swath.control.box", "swath.sensing.box"),
        "rim",
        5.0,
        (Port("box", BoxSeen),),
        {
            **_STATE,
            "scan": ("lidar", "scan"),
            "peer": ("peer_link", "peer"),
            "odometry": ("odometry", "odometry"),
            **_BOX,
        },
    ),
    SlotKind(
        "cooperate",
        ("swath.control.cooperate",),
        "one_spot",
        20.0,
        (),
        {
            "peer": ("peer_link", "peer"),
            "odometry": ("odometry", "odometry"),
            "load": ("process", "load"),
            "heap": ("heap", "heap"),
            "unload": ("unload", "unload"),
            "box": ("box", "box"),
            "seen": (PEER + "box", "box"),
            **_OTHERS,
        },
        more=(Port("station", Station), Port("command", UnloadCommand)),
        is_control=True,
        is_exchangeable=True,
    ),
    SlotKind(
        "steer",
        ("swath.control.steer",),
        "preview",
        50.0,
        (Port("command", SteerCommand),),
        {
            **_STATE,
            "edge": ("edge", "edge"),
            "odometry": ("odometry", "odometry"),
            "inertial": ("imu", "inertial"),
            "station": ("cooperate", "station"),
            "ground": ("ground_speed", "speed"),
            "pose": ("pose", "pose"),
        },
        more=(Port("guidance", GuidanceState),),
        is_control=True,
        is_exchangeable=True,
    ),
    SlotKind(
        "speed",
        ("swath.control.speed",),
        "constant",
        10.0,
        (Port("command", SpeedCommand),),
        {
            "odometry": ("odometry", "odometry"),
            "load": ("process", "load"),
            "edge": ("edge", "edge"),
            "feed": ("crop_flow", "feed"),
            "engine": ("powertrain", "engine"),
            "ahead": ("ahead", "ahead"),
            "station": ("cooperate", "station"),
            "objects": ("objects", "objects"),
            "map": ("field_map", "map"),
            "guidance": ("steer", "guidance"),
        },
        is_control=True,
        is_exchangeable=True,
    ),
    SlotKind(
        "settings",
        ("swath.control.settings",),
        "fixed",
        1.0,
        (Port("settings", OrganSettings),),
        {name: ("crop_flow", name) for name in ("loss", "feed", "grain", "returns", "quality")},
        is_control=True,
        is_exchangeable=True,
    ),
    SlotKind(
        "steering",
        ("swath.machine.steering",),
        "actuator",
        200.0,
        (Port("steering", SteerState),),
        {"command": ("steer", "command")},
    ),
)
SLOT_NAMES = tuple(s.name for s in SLOTS)
TRUTH = (MachineState, ScanTruth, TrailerState, WheelState)  # what control never sees


def kind_of(instance: str, slots: Sequence[SlotKind] = SLOTS) -> SlotKind | None:
    """The kind of a slot by the name of an instance: `lidar` and `lidar_left` are of kind lidar."""
    kinds = {s.name: s for s in slots}
    name = instance
    while name and not ((kind := kinds.get(name)) and is_instance(instance, kind)):
        name = name.rpartition("_")[0]
    return kinds.get(name)


def is_instance(name: str, kind: SlotKind) -> bool:
    """True when a slot of this name is of the kind."""
    return name == kind.name or (
        kind.is_plural and name.startswith(kind.name + "_") and name != kind.name + "_"
    )


FIELD_PACKAGES: dict[str, tuple[str, ...]] = {n: (f"swath.field.{n}",) for n in ("terrain", "stand")}
FIELD_LEVELS = {"terrain": "formula", "stand": "uniform"}

GONE_SLOTS = {  # of version 0.2, and what to use instead
    "job": "`steer: edge_or_path` with a path drives several passes, `swath fleet` whole fields",
}
INSTEAD = "`likelihood_ratio` is the detector, `otsu` the plain one"
GONE = {
    "heap.volume": "`cones` holds what a surface at the angle of repose holds",
    "field_map.earlier_pass": "`file` reads a grid of what was measured, `error` draws one",
    "box.gnss_link": "`rim` finds the box with a LiDAR",
    "cooperate.oscillate": "`by_profile` levels the heap by what it sees of it",
    "steer.station_or_path": "`station` keeps beside another machine, `path` follows a path",
    "speed.job": "`constant` with `guard: {when_lost: path}` goes on along a path",
    **{f"edge.{n}": INSTEAD for n in ("consensus", "filter", "max_likelihood", "mixture", "threshold")},
}
REGISTRY = Registry(
    {**FIELD_PACKAGES, **{s.name: s.packages for s in SLOTS}},
    links="swath.link.levels",
    linkable=SLOT_NAMES,
    gone=GONE,
)


@dataclass(frozen=True)
class Catalogue:
    """registry: levels by slot kind; slots: of a machine, in execution order.

    field_levels: the default level of `terrain` and `stand`
    parts: `edge`, `obstacles`, `boundary` and `weather` -> `module:NAME` of the type that describes one;
        `evaluators` and `bodies` -> of the functions that list them
    machine_types: type -> slot -> level of what a machine of the type has unasked
    """

    registry: Registry
    slots: tuple[SlotKind, ...]
    field_levels: Mapping[str, str]
    parts: Mapping[str, str]
    machine_types: Mapping[str, Mapping[str, str]]

    def part(self, name: str) -> Any:
        """The type of an edge, an obstacle, a boundary or the weather."""
        module, _, attribute = self.parts[name].partition(":")
        return getattr(import_module(module), attribute)

    def judged(self, own: Sequence[str] = (), base: Path | None = None) -> Any:
        """What evaluators make known: metrics, columns and events. own: those of a scenario, `file.py:Class`.

        InputError where one cannot be had.
        """
        return self.part("evaluators")(own, base)

    def default_level(self, kind: str) -> str:
        """The level that a slot, `terrain` or `stand` has when a scenario does not say."""
        return self.field_levels.get(kind) or self.slot(kind).level

    def slot(self, name: str) -> SlotKind:
        """The kind of slot of a name."""
        return next(s for s in self.slots if s.name == name)

    def kind_of(self, instance: str) -> SlotKind | None:
        """The kind of a slot by the name of an instance, such as `lidar_left`; None for no slot."""
        return kind_of(instance, self.slots)

    def estimate_of(self, key: str) -> tuple[float, float]:
        """The band of a key such as `combine.threshing.threshing_speed`. InputError where it has none."""
        owner, instance, *path = [*key.split("."), "", ""]
        kind = self.kind_of(instance)
        name = instance if owner == "field" else kind.name if kind is not None else ""
        for level in self.registry.names(name) if name in self.registry.packages else ():
            if band := band_of(self.registry.get(name, level).params, path[:-2]):
                return band.low, band.high
        raise InputError("key", key, "expected one with a band, as `swath levels SLOT` shows it")


PARTS = {
    "edge": "swath.field.edges.edge:Edge",
    "obstacles": "swath.field.solid.obstacles:Obstacle",
    "boundary": "swath.field.edges.edge:Boundary",
    "weather": "swath.field.weather:Weather",
    "evaluators": "swath.judge.catalogue:load_evaluators",
    "bodies": "swath.field.site_setup:known_as",
}
CATALOGUE = Catalogue(REGISTRY, SLOTS, FIELD_LEVELS, PARTS, MACHINE_TYPES)
